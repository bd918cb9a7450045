#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {

/// The way of the camera within one map. Gives the direction of motion averaged over a distance,
/// for Eq. 3: one frame's own t_{t,t-1} wobbles by half a degree, a chord over several frames does
/// not.
class MotionHistory {
 public:
  struct Options {
    int max_frames = 60;  ///< poses kept
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("max_frames", self.max_frames, 2, 100000, "[frames] poses kept");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Chord {
    Eigen::Vector3d direction_c = Eigen::Vector3d::Zero();  ///< unit, along the motion, camera axes
    double length = 0;                                      ///< VO units, > 0
    Eigen::Vector3d turn_c = Eigen::Vector3d::Zero();  ///< rotation from its start to its end [rad]
  };

  explicit MotionHistory(const Options& options);

  /// Precondition: the same map as the poses before (reset() otherwise).
  void add(const Eigen::Isometry3d& T_w_c);

  /// Length of the polyline through all poses since reset() [VO units].
  double travelled() const { return travelled_; }
  /// From the last pose but one to the last [VO units]; 0 with fewer than two poses.
  double lastStep() const { return last_step_; }
  /// Of a pose that is not added yet, from the last one [VO units]; 0 when there is none.
  double distanceFromLast(const Eigen::Isometry3d& T_w_c) const;
  bool empty() const { return poses_.empty(); }
  /// Relative pose of the last frame as the paper's T_{t,t-1}: x_t = T x_{t-1}. Identity with
  /// fewer than two poses.
  Eigen::Isometry3d lastMotion() const;

  /// From the newest kept pose that lies at least min_length back along the way (or the oldest one)
  /// to the last, in the last camera's axes. Signed: in reverse it still points where the camera
  /// goes. Empty when there is no motion.
  std::optional<Chord> chord(double min_length) const;

  void reset();

 private:
  struct Pose {
    Eigen::Isometry3d T_w_c;
    double travelled;
  };
  Options options_;
  std::deque<Pose> poses_;
  double travelled_ = 0;
  double last_step_ = 0;
};

}  // namespace ground_scale_vo
