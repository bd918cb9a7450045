#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// What a frame of vo/frame continues: the one place where ScaleRecovery decides it.
///
///   the clock jumps back          kNewTrajectory, from the first frame on
///   another camera, or ~reset     kNewTrajectory, whose first metric pose is zero
///   the odometry has restarted    kNewMap; the rotation to it is not known, because the odometry
///                                 describes the motion since its own first image only
///   another map_id                kNewMap
///   other intrinsics              kOtherLens
///   otherwise                     kSameMap
///
/// Each of them includes those below it.
class FrameContinuity {
 public:
  /// Most frames that may be missing between two; more is an error of the sender.
  static constexpr std::uint32_t kMaxGap = 100000;

  /// The number of each frame that arrives, also of one that is refused later.
  void receive(std::uint32_t sequence);

  /// The next frame that is used: sets its continuity. Keeps map ids ascending when the odometry
  /// restarts and counts its maps from 0 again. camera_frame: empty: not known. Returns why a new
  /// trajectory starts; empty: it continues.
  std::string next(VoFrame& frame, const std::string& camera_frame, bool clock_jumped_back);

  /// A new trajectory starts with the next frame. If the odometry restarts there, too, the rotation
  /// since its first image is the one since the start of the trajectory.
  void startTrajectory() {
    continues_ = false;
    map_id_.reset();
    map_of_unknown_rotation_.reset();
  }

  /// frame_id of the last frame that has one.
  const std::string& cameraFrame() const { return camera_frame_; }
  /// Frames that did not arrive.
  std::uint64_t missing() const { return missing_; }
  /// What is wrong with the last number, which does not count frames; empty: nothing.
  const std::string& sequenceError() const { return sequence_error_; }

 private:
  void numberMap(VoFrame& frame);

  std::optional<std::uint32_t> last_received_;
  std::uint32_t repeats_ = 0;  ///< of last_received_
  std::uint64_t missing_ = 0;
  std::string sequence_error_;

  std::string camera_frame_;
  std::optional<std::uint32_t> last_sequence_;
  std::uint32_t last_map_id_ = 0, map_id_offset_ = 0;
  std::optional<std::uint32_t> map_id_;                   ///< of the last frame that was not lost
  PinholeCamera camera_;                                  ///< of the same frame
  bool continues_ = false;                                ///< the trajectory has frames
  std::optional<std::uint32_t> map_of_unknown_rotation_;  ///< the first one after a restart
};

}  // namespace ground_scale_vo
