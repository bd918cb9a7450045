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

namespace ground_scale_vo {

/// A feature of one frame that lies on the road.
struct GroundPoint {
  std::uint64_t id = 0;                           ///< of the feature
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();  ///< in its frame's camera [VO units], z > 0
  double depth_sigma = 0;                         ///< standard deviation of p_c.z [VO units]
};

/// The lane region of an image, smoothed.
struct RoadImage {
  cv::Rect roi;    ///< part of the image that is stored [px]; empty: none
  cv::Mat pixels;  ///< CV_32F, of the roi's size; without gaps, which would cost cache misses
  Vector6d readout_motion = Vector6d::Zero();  ///< see VoFrame
};

/// The cameras of one map in the order of the drive, and what each has seen of the road. All
/// windows over the past of a map are parts of it: the chord of the motion, the ground points of
/// GPA, the reference images of the direct measurement, and the camera above a piece of road.
/// Distances are along the path [VO units].
class CameraPath {
 public:
  struct Camera {
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
    std::int64_t stamp_ns = 0;
    double travelled = 0;  ///< from the start of the path to this camera
    RoadPrior prior;
    std::vector<GroundPoint> ground_points;  ///< empty: none found
    RoadImage road;
  };

  /// Appends a camera of the same map. stamp_ns: to compare the path with speeds.
  void add(const Eigen::Isometry3d& T_w_c, std::int64_t stamp_ns = 0);

  bool empty() const { return cameras_.empty(); }
  /// The newest kMaxCameras, in the order of the drive.
  const std::deque<Camera>& cameras() const { return cameras_; }
  std::deque<Camera>& cameras() { return cameras_; }
  /// Precondition: not empty.
  const Camera& newest() const { return cameras_.back(); }
  Camera& newest() { return cameras_.back(); }

  /// Distance from the newest camera to one that is not added; 0 without a camera.
  double distanceTo(const Eigen::Isometry3d& T_w_c) const;
  /// Relative pose of the newest camera as the paper's T_{t,t-1}: x_t = T x_{t-1}. Identity with
  /// fewer than two cameras.
  Eigen::Isometry3d lastMotion() const;
  /// From the latest camera that lies at least min_length back (or the oldest one) to the newest,
  /// in the newest camera's axes. In reverse it points backwards. Empty when there is no motion.
  std::optional<Chord> chord(double min_length) const;

  /// The camera nearest to p_w, of those at most max_length back. Precondition: not empty.
  ///
  /// The height of a camera above a plane is accurate where the points of the plane are: the error
  /// of the plane's normal, and of the assumption that the road is plane, grow with the distance.
  /// Of all cameras the newest is nearest to the road ahead of it. A camera that faces backwards
  /// sees road that it has passed, so an earlier one is nearer.
  const Camera& nearest(const Eigen::Vector3d& p_w, double max_length) const;

 private:
  static constexpr std::size_t kMaxCameras = 1000;  ///< bounds time and memory

  std::deque<Camera> cameras_;
};

}  // namespace ground_scale_vo
