#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// The axis about which a vehicle turns, in camera axes: the road's normal, also of a camera that
/// is mounted so that no road can be measured. Unlike a measured plane it does not tell up from
/// down.
class TurnAxis {
 public:
  /// Rotation of the camera of the next frame of a map.
  void add(std::uint32_t map_id, const Eigen::Matrix3d& R_w_c);
  /// Unit, with the sign that has the smaller angle to the camera's up; empty: it has not turned
  /// enough.
  std::optional<Eigen::Vector3d> upward() const;

 private:
  std::uint32_t map_id_ = 0;
  std::optional<Eigen::Matrix3d> start_;  ///< R_w_c
  Eigen::Matrix3d scatter_ = Eigen::Matrix3d::Zero();
  int turns_ = 0;
};

/// The mounting as tf has it.
struct MountingOnTf {
  std::string base_frame, camera_frame;
  Eigen::Vector3d up_c;  ///< z axis of the base in camera axes, unit
};

/// One sentence if the mounting of the camera is beyond the supported pitch and roll or contradicts
/// the road; empty: neither, or not known well enough yet. measured: of the latest frame.
/// turn_axis_c: TurnAxis::upward(). on_tf: empty: the base is the camera, or the camera moves on
/// it.
std::string mountingWarning(const ScaleRecovery::Output& measured,
                            const std::optional<Eigen::Vector3d>& turn_axis_c,
                            const std::optional<MountingOnTf>& on_tf);

/// The camera height as a file that `calibrate_height` would write, with the measured mounting.
/// Throws DataError, one sentence, if speeds have not taught it with an error (95 %) of at most 5
/// %. given_sigma: of a given height [m], 0 without one.
std::string learnedHeightYaml(const ScaleRecovery::Output& measured, double given_sigma);

}  // namespace ground_scale_vo
