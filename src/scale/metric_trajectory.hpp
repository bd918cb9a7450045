#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <utility>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/scale/metric_pose.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/path_speed.hpp"

namespace gsv {

/// Accumulates metric increments: each rotation unchanged, each translation times the scale of its
/// frame (Eq. 10 for increments), with their covariance. In a young map all motion since the map's
/// first frame is multiplied by the newest scale. A later map continues from the last metric pose:
/// the gap is bridged. docs/explanation/how_it_works.md describes the model of the errors.
class MetricTrajectory {
 public:
  using Options = MetricTrajectoryOptions;

  explicit MetricTrajectory(const Options& options) : options_(options) {}

  /// Appends one frame. Call it for every frame, also without a pose or a scale. Empty while
  /// scale.status is kUnknown or the frame is not tracking, when scale.measurement says that its
  /// pose is not used (kVoNotTracking, kImplausibleMotion), and for an increment without a finite
  /// result, which is skipped.
  /// continuity: as decided by ScaleRecovery. A map that it starts in the middle of the odometry's
  /// one (a jump of the pose) does not count from MapStart.
  /// speeds: of the vehicle. They give the length of a gap between two maps; while they stand still
  /// (and scale.measurement is kStandstill), the pose stays although the images move.
  std::optional<MetricPose> append(const VoFrame& frame, Continuity continuity,
                                   const ScaleEstimate& scale,
                                   const SpeedTrack& speeds = SpeedTrack(0));

  /// frame: the first tracked frame of a map. Whether the motion since the map's own first frame
  /// (MapStart) is part of the trajectory: all frames since then were seen, and the map's world
  /// frame is the camera at that frame.
  bool countsFromStart(const VoFrame& frame) const;

 private:
  /// What is known of the map that the next tracked frame starts; kBefore: it starts none.
  enum class Start : std::uint8_t { kBefore, kUnseen, kSeen, kInItsMiddle };
  /// Of position, rotation, relative error of the scale, of the angle of rotation, and of the
  /// camera height, which is a constant factor of all scales; and of the distance travelled.
  using StateCovariance = Eigen::Matrix<double, 10, 10>;
  /// The map of the newest tracked frame. Its motion is counted from the reference frame: the map's
  /// first frame, or the first one seen.
  struct Map {
    Eigen::Isometry3d T_w_ref = Eigen::Isometry3d::Identity();
    std::int64_t ref_stamp_ns = 0;
    /// Rotation of the reference frame in the camera of the last metric pose, or in o before it.
    Eigen::Matrix3d R_last_ref = Eigen::Matrix3d::Identity();
    double rotation_variance = 0;  ///< of R_last_ref [rad^2]
    double travelled = 0;          ///< since the reference frame [VO units]
    bool metric = false;           ///< has a metric pose; the following fields are valid
    bool young = true;
    Eigen::Isometry3d T_o_ref = Eigen::Isometry3d::Identity();
    double distance_at_ref = 0;  ///< [m]
    /// T_w_ref, and T_w_c of the last frame, before the stop that lasts; empty: there is none. Used
    /// when it turns out that the speeds have failed and the vehicle moves.
    std::optional<std::pair<Eigen::Isometry3d, Eigen::Isometry3d>> before_stop;
  };
  std::optional<MetricPose> appendTracked(const VoFrame& frame, const ScaleEstimate& scale,
                                          const SpeedTrack& speeds);
  Map newMap(const VoFrame& frame) const;
  void anchorMap(const Eigen::Isometry3d& T_ref_c, const ScaleEstimate& scale, double dt,
                 const SpeedTrack& speeds);
  void bridgeGap(const std::optional<Eigen::Vector3d>& velocity_ref, double velocity_sigma,
                 const SpeedTrack& speeds);
  void rescaleYoungMap(const Eigen::Isometry3d& T_last_c, const Eigen::Isometry3d& T_ref_c,
                       const ScaleEstimate& scale);
  void integrate(const Eigen::Isometry3d& T_last_c, const ScaleEstimate& scale);
  void setLast(const StateCovariance& covariance);
  void propagateMotion(const Eigen::Isometry3d& T_last_c, const ScaleEstimate& scale,
                       double scale_correlation);
  void setVariance(int state, double variance);
  void setTwist(const Eigen::Isometry3d& T_last_c, const ScaleEstimate& scale, double dt);
  Eigen::Matrix3d stepCovariance(const Eigen::Vector3d& step_c, const ScaleEstimate& scale,
                                 double pose_share = 2) const;
  Eigen::Matrix3d directionCovariance(const Eigen::Vector3d& step) const;
  double rotationVariance(double length) const;

  Options options_;
  std::optional<std::int64_t> first_seen_ns_;  ///< stamp of the first frame
  Start start_ = Start::kUnseen;
  std::optional<Map> map_;
  StampedPose last_tracked_;  ///< of map_
  bool has_pose_ = false;
  MetricPose last_;
  StateCovariance covariance_ = StateCovariance::Zero();
  Matrix6d pose_covariance_c_ = Matrix6d::Zero();          ///< of the newest frame, in metres
  Eigen::Vector3d last_step_c_ = Eigen::Vector3d::Zero();  ///< to last_, in its axes [m]
  double last_step_s_ = 0;                                 ///< its duration; 0: not known
  Eigen::Vector3d velocity_c_ = Eigen::Vector3d::Zero();   ///< at last_: mean of two steps [m/s]
  double velocity_variance_ = 0;                           ///< sum of the axes
  std::int64_t last_refused_stamp_ns_ = 0;                 ///< of the last pose that was not used
  std::int64_t last_stamp_ns_ = 0;                         ///< of last_
  std::int64_t last_motion_stamp_ns_ = 0;  ///< of the last frame that was not at standstill
};

}  // namespace gsv
