#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "ground_scale_vo/input/camera.hpp"
#include "simulation/rendering/scene.hpp"

namespace ground_scale_vo::simulation {

/// The image of an ideal camera: no noise, no quantisation. Grey levels, CV_32F. Visibility is
/// sampled at 2 x 2 places per pixel; each surface within a pixel is shaded once, with its texture
/// filtered over the pixel.
cv::Mat render(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c);

}  // namespace ground_scale_vo::simulation
