#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Camera pose in metres. `o` has the camera's axes (x right, y down, z forward) and lies at the
/// first frame of the first map.
struct MetricPose {
  Eigen::Isometry3d T_o_c = Eigen::Isometry3d::Identity();
  /// Accumulated covariance of T_o_c: position in o axes [m^2], then rotation as a small rotation
  /// about o's axes [rad^2] (the order of geometry_msgs/PoseWithCovariance).
  Matrix6d covariance = Matrix6d::Zero();
  /// Since the previous metric pose, in camera axes c: v [m/s], w [rad/s]; zero in a map's first.
  Vector6d twist_c = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Zero();
  double distance = 0;  ///< travelled so far [m]
};

/// Chains metric increments: rotation as it is, translation times the frame's scale (Eq. 10,
/// applied to increments, so the past never moves).
///
/// First metric frame of the first map: the way from the map's first frame is scaled by this
/// frame's scale. A later map goes on from the last metric pose without a step, and adds the
/// uncertainty of what was missed; a standstill that ends in a new map counts as missed, for the
/// camera may as well have repeated one image. While the odometry has no pose, nothing is appended.
class MetricTrajectory {
 public:
  struct Options {
    double rotation_sigma_per_sqrt_m = 0.0005;  ///< random walk of rotation [rad/sqrt(m)]
    double direction_sigma = 0.005;             ///< of a frame's direction of motion [rad]
    double scale_correlation_m = 10.0;          ///< scale errors agree over this distance [m]
    double new_map_position_sigma_per_s = 5.0;  ///< unseen motion while lost [m/s]
    double new_map_rotation_sigma_per_s = 0.1;  ///< unseen rotation while lost [rad/s]
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("rotation_sigma_per_sqrt_m", self.rotation_sigma_per_sqrt_m, 0, 1,
            "[rad/sqrt(m)] random walk of rotation");
      visit("direction_sigma", self.direction_sigma, 0, 1,
            "[rad] of a frame's direction of motion");
      visit("scale_correlation_m", self.scale_correlation_m, 1e-3, 1e6,
            "[m] scale errors agree over this way");
      visit("new_map_position_sigma_per_s", self.new_map_position_sigma_per_s, 0, 1e3,
            "[m/s] unseen motion while lost");
      visit("new_map_rotation_sigma_per_s", self.new_map_rotation_sigma_per_s, 0, 1e3,
            "[rad/s] unseen rotation while lost");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit MetricTrajectory(const Options& options);

  /// Empty while scale.status is kUnknown or the frame is not tracking, and for an increment that
  /// leads to no finite pose, which is left out.
  std::optional<MetricPose> append(const VoFrame& frame, const ScaleEstimate& scale);

  void reset();

 private:
  using Matrix7d = Eigen::Matrix<double, 7, 7>;
  void move(const Eigen::Isometry3d& T_last_now, double scale, double relative_sigma, double dt);

  Options options_;
  bool has_pose_ = false;
  MetricPose last_;
  Matrix7d covariance_ = Matrix7d::Zero();  ///< of T_o_c and of the relative error of the scale
  std::uint32_t last_map_id_ = 0;
  std::int64_t last_stamp_ns_ = 0;
  std::int64_t moving_stamp_ns_ = 0;  ///< of the last frame that was no standstill
  Eigen::Isometry3d last_T_w_c_ = Eigen::Isometry3d::Identity();
};

}  // namespace ground_scale_vo
