#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>

#include "ground_scale_vo/vo/two_view.hpp"

namespace ground_scale_vo {

/// Rotation over several images, as the product of the rotations between pairs of them.
class RotationChain {
 public:
  /// The camera turns from an image 1 to an image 2; empty: by an unknown rotation.
  void append(const std::optional<RelativeRotation>& rotation) {
    if (rotation) R_first_last_ = R_first_last_ * rotation->R_2_1.transpose();
    sigma_ =
        rotation ? std::hypot(sigma_, rotation->sigma) : std::numeric_limits<double>::infinity();
  }
  const Eigen::Matrix3d& R_first_last() const { return R_first_last_; }
  double sigma() const { return sigma_; }  ///< per axis [rad]; infinite: unknown

 private:
  Eigen::Matrix3d R_first_last_ = Eigen::Matrix3d::Identity();
  double sigma_ = 0;
};

}  // namespace ground_scale_vo
