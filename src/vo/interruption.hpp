#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>

#include "ground_scale_vo/vo/two_view.hpp"
#include "vo/descriptor_matching.hpp"

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

/// Images with texture but without a pose, since the last frame with a pose.
class Interruption {
 public:
  Interruption(const PinholeCamera& camera, const TwoView::Options& options)
      : camera_(camera), two_view_(options) {}

  /// rotation: from the last frame with a pose to this image, if known. corners: of this image.
  void addImage(const std::optional<RelativeRotation>& rotation, Descriptors corners);
  void end();

  int images() const { return images_; }
  /// To the last of them, from the last frame with a pose.
  const RotationChain& rotation() const { return rotation_; }

  /// Rotation between two images by their descriptors; empty when too few of them match.
  std::optional<RelativeRotation> rotationBetween(const Descriptors& a, const Descriptors& b) const;

 private:
  const PinholeCamera camera_;
  const TwoView two_view_;
  int images_ = 0;
  std::optional<Descriptors> last_;
  RotationChain rotation_;
};

}  // namespace ground_scale_vo
