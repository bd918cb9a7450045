#pragma once

#include "ground_scale_vo/scale/scale_estimate.hpp"

namespace gsv {

/// An estimate with the camera height and its standard deviation [m] that follow from speeds.
inline ScaleEstimate learned(double height, double sigma) {
  ScaleEstimate scale;
  scale.camera_height = height;
  scale.camera_height_sigma = sigma;
  return scale;
}

}  // namespace gsv
