#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>
#include <optional>

namespace ground_scale_vo {

/// The camera's poses within one map. Provides the direction of motion averaged over a distance,
/// for Eq. 3: the direction t_{t,t-1} of single frames varies by half a degree with the vehicle's
/// vibration, that of a chord over several frames does not.
class MotionHistory {
 public:
  static constexpr std::size_t kMaxPoses = 60;  ///< kept, the newest; six seconds at 10 Hz

  /// Straight line between two camera positions of the path.
  struct Chord {
    Eigen::Vector3d direction_c = Eigen::Vector3d::Zero();  ///< unit, along the motion, camera axes
    double length = 0;                                      ///< VO units, > 0
    Eigen::Vector3d turn_c = Eigen::Vector3d::Zero();  ///< rotation from its start to its end [rad]
  };

  /// Precondition: the same map as the poses before (reset() otherwise).
  void add(const Eigen::Isometry3d& T_w_c);

  /// Length of the polyline through all poses since reset() [VO units].
  double travelled() const { return travelled_; }
  /// Distance from the last pose to one that is not added yet [VO units]; 0 without a last pose.
  double distanceFromLast(const Eigen::Isometry3d& T_w_c) const;
  bool empty() const { return poses_.empty(); }
  /// Relative pose of the last frame as the paper's T_{t,t-1}: x_t = T x_{t-1}. Identity with
  /// fewer than two poses.
  Eigen::Isometry3d lastMotion() const;

  /// From the newest kept pose that lies at least min_length back along the path (or the oldest
  /// one) to the newest, in the newest camera's axes. In reverse it points backwards. Empty when
  /// there is no motion.
  std::optional<Chord> chord(double min_length) const;

  void reset();

 private:
  struct Pose {
    Eigen::Isometry3d T_w_c;
    double travelled;
  };
  std::deque<Pose> poses_;
  double travelled_ = 0;
};

}  // namespace ground_scale_vo
