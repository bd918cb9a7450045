#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Camera pose in metres. The odometry frame o has the axes of the camera (x right, y down, z
/// forward) and coincides with the first frame of the first map.
struct MetricPose {
  Eigen::Isometry3d T_o_c = Eigen::Isometry3d::Identity();
  /// Accumulated covariance of T_o_c in o axes, in the order of geometry_msgs/PoseWithCovariance:
  /// position [m^2], then rotation as a left perturbation exp(w) R [rad^2].
  Matrix6d covariance = Matrix6d::Zero();
  /// Mean velocity since the previous metric pose, in camera axes c: linear [m/s], then angular
  /// [rad/s]. Zero in the first frame of a map.
  Vector6d twist_c = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Zero();
  double distance = 0;  ///< travelled so far [m]
};

/// Accumulates metric increments: each rotation unchanged, each translation times the scale of its
/// frame. This is Eq. 10 for increments, so past poses never change.
///
/// The first metric frame of the first map appends the motion since the map's first frame with its
/// own scale. A later map continues from the last metric pose; the uncertainty of the unobserved
/// motion is added. A standstill that ends in a new map counts as unobserved, because a camera that
/// repeats one image looks the same. Without a VO pose nothing is appended.
///
/// Covariance: first-order propagation of (position, rotation, relative scale error). The scale
/// error is a first-order Gauss-Markov process in the distance, so the position error grows
/// linearly within its correlation length and with the square root beyond it.
class MetricTrajectory {
 public:
  struct Options {
    double rotation_sigma_per_sqrt_m = 0.0005;
    double direction_sigma = 0.005;
    double scale_correlation_m = 10.0;
    double new_map_position_sigma_per_s = 5.0;
    double new_map_rotation_sigma_per_s = 0.1;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("rotation_sigma_per_sqrt_m", self.rotation_sigma_per_sqrt_m, 0, 1,
            "[rad/sqrt(m)] random walk of the rotation");
      visit("direction_sigma", self.direction_sigma, 0, 1,
            "[rad] standard deviation of the direction of motion between two frames");
      visit("scale_correlation_m", self.scale_correlation_m, 1e-3, 1e6,
            "[m] correlation length of the scale error");
      visit("new_map_position_sigma_per_s", self.new_map_position_sigma_per_s, 0, 1e3,
            "[m/s] standard deviation of the unobserved velocity before a new map");
      visit("new_map_rotation_sigma_per_s", self.new_map_rotation_sigma_per_s, 0, 1e3,
            "[rad/s] standard deviation of the unobserved rotation rate before a new map");
    }
    /// Throws OptionError.
    void validate() const;
  };

  /// Throws OptionError.
  explicit MetricTrajectory(const Options& options);

  /// Appends one frame. Empty while scale.status is kUnknown or the frame is not tracking, and for
  /// an increment without a finite result, which is skipped.
  std::optional<MetricPose> append(const VoFrame& frame, const ScaleEstimate& scale);

  void reset();

 private:
  using Matrix7d = Eigen::Matrix<double, 7, 7>;
  void bridgeMaps(std::int64_t stamp_ns, double relative_sigma);
  void integrate(const Eigen::Isometry3d& T_last_now, double scale, double relative_sigma,
                 double dt);
  void propagateCovariance(const Eigen::Vector3d& step_o, double length, double relative_sigma);
  void setTwist(const Eigen::Isometry3d& T_last_now, const Eigen::Vector3d& step_last,
                double relative_sigma, double dt);
  Eigen::Matrix3d directionCovariance(const Eigen::Vector3d& step, double length) const;
  double rotationVariance(double length) const;

  Options options_;
  bool has_pose_ = false;
  MetricPose last_;
  Matrix7d covariance_ = Matrix7d::Zero();  ///< of position, rotation and relative scale error
  std::uint32_t last_map_id_ = 0;
  std::int64_t last_stamp_ns_ = 0;
  std::int64_t last_motion_stamp_ns_ = 0;  ///< of the last frame that was not at standstill
  Eigen::Isometry3d last_T_w_c_ = Eigen::Isometry3d::Identity();
};

}  // namespace ground_scale_vo
