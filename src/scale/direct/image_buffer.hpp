#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo::direct {

constexpr int kReferences = 2;  ///< reference images per frame, at one and at two baselines

/// The lane region of an image, smoothed, with the pose of its camera.
struct RoadImage {
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units
  Vector6d readout_motion = Vector6d::Zero();               ///< see VoFrame
  cv::Rect roi;     ///< part of the image that is stored [px]; empty: none
  cv::Mat storage;  ///< CV_32F, of the roi's size; without gaps, which would cost cache misses

  /// Row v of the full image; valid for columns inside roi.
  const float* row(int v) const { return storage.ptr<float>(v - roi.y) - roi.x; }
};

/// A reference image and the motion from the current camera (c) to its camera (r):
/// x_r = R x_c + t.
struct Reference {
  void setMotion(const Eigen::Isometry3d& T_r_c);

  const RoadImage* image = nullptr;
  Vector6d readout_motion_c = Vector6d::Zero();  ///< of the current image
  Eigen::Matrix3f R;
  Eigen::Vector3f t;                 ///< VO units
  Eigen::Vector3f perpendicular[2];  ///< basis of the plane orthogonal to t, of the length of t
};

/// The current image and the last few earlier ones, from which reference images are chosen by their
/// distance.
class ImageBuffer {
 public:
  /// baseline_heights: from the current to the first reference image [camera heights].
  explicit ImageBuffer(double baseline_heights);

  void clear() { kept_ = 0; }
  bool empty() const { return kept_ == 0; }

  RoadImage& current() { return images_.front(); }
  const RoadImage& current() const { return images_.front(); }

  /// The kept images whose distances from the current one are nearest to one and two baselines;
  /// fewer when there are none in range. height: of the camera [VO units]. The result points into
  /// the buffer and is valid until keepCurrent().
  std::vector<Reference> selectReferences(double height) const;

  /// Between the current and the newest kept image [VO units]. Precondition: !empty().
  double stepLength() const;

  /// Moves the current image to the kept ones, unless it shows no road. It replaces the newest one
  /// when that one is close to its predecessor. height: of the camera [VO units].
  void keepCurrent(double height);

 private:
  std::vector<RoadImage> images_;  ///< the current one, then `kept_` earlier ones, newest first
  std::size_t kept_ = 0;
  double baseline_heights_;
};

}  // namespace ground_scale_vo::direct
