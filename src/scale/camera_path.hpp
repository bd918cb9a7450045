#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "scale/road.hpp"

namespace gsv {

/// A feature that lies on the road, in the axes of some camera c: of its frame, or of the window of
/// GPA. Its error lies along the ray from the camera that it was triangulated from.
struct GroundPoint {
  std::uint64_t id = 0;                                ///< of the feature
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();       ///< VO units
  Eigen::Vector3d origin_c = Eigen::Vector3d::Zero();  ///< centre of the observing camera
  double depth = 0;        ///< along that camera's optical axis [VO units], > 0
  double depth_sigma = 0;  ///< standard deviation of depth [VO units], > 0
};

/// The lane region of an image, smoothed.
struct RoadImage {
  cv::Rect roi;    ///< part of the image that is stored [px]; empty: none
  cv::Mat pixels;  ///< CV_32F, of the roi's size; without gaps, which would cost cache misses
  Vector6d readout_motion = Vector6d::Zero();  ///< see VoFrame
  double min_spacing = 0;                      ///< from an image that is kept beside it [VO units]
  int setting = 0;  ///< images of another camera or mask, with another number, are not comparable
};

/// The poses of one map in the order of the drive, and what each has seen of the road. All windows
/// over the past of a map are parts of it: the chord of the motion, the ground points of GPA, the
/// reference images of the direct measurement, and the pose above a piece of road. ScaleRecovery
/// alone writes into it. Distances are along the path [VO units].
class CameraPath {
 public:
  struct Pose : StampedPose {
    double travelled = 0;  ///< from the start of the path
    RoadPrior prior;
    std::vector<GroundPoint> ground_points;  ///< empty: none found
    RoadImage road;
  };

  /// Appends a pose of the same map, and returns it for the measurements of its frame.
  Pose& add(const StampedPose& pose);
  /// Keeps the image for the newest pose, and releases the images that no later frame needs as a
  /// reference: those of another setting, the oldest, and of the two before the newest the later
  /// one when they are closer than road.min_spacing.
  void keepRoad(const RoadImage& road);

  bool empty() const { return poses_.empty(); }
  /// The newest kMaxPoses, in the order of the drive.
  const std::deque<Pose>& poses() const { return poses_; }
  /// Precondition: not empty.
  const Pose& newest() const { return poses_.back(); }

  /// Distance from the newest pose to one that is not added; 0 without a pose.
  double distanceTo(const Eigen::Isometry3d& T_w_c) const;
  /// Of the newest pose as the paper's T_{t,t-1}: x_t = T x_{t-1}. Identity with fewer than two.
  Eigen::Isometry3d lastMotion() const;
  /// From the latest pose that lies at least min_length back (or the oldest one) to the newest, in
  /// the newest one's axes. In reverse it points backwards. Empty when there is no motion.
  std::optional<Chord> chord(double min_length) const;

  /// The pose nearest to p_w, of those at most max_length back: there the height above a plane
  /// through points about p_w is accurate. Precondition: not empty.
  const Pose& nearest(const Eigen::Vector3d& p_w, double max_length) const;

 private:
  static constexpr std::size_t kMaxPoses = 1000;  ///< bounds time and memory

  std::deque<Pose> poses_;
};

}  // namespace gsv
