#include "ground_scale_vo/ros/frame_continuity.hpp"

#include <limits>

namespace ground_scale_vo {

void FrameContinuity::receive(std::uint32_t sequence) {
  sequence_error_.clear();
  repeats_ = last_received_ == sequence ? repeats_ + 1 : 0;
  if (repeats_ > (sequence == 0 ? 1 : 0)) {  // 0 twice: two restarts, an image between them
    sequence_error_ = "sequence is " + std::to_string(sequence) +
                      " in two vo/frame in a row: the odometry must increase it with every image, "
                      "otherwise its restarts and lost frames are not detected";
  } else if (last_received_ && sequence > *last_received_) {
    const std::uint32_t gap = sequence - *last_received_ - 1;
    if (gap <= kMaxGap) {
      missing_ += gap;
    } else {
      sequence_error_ = "sequence of vo/frame jumps from " + std::to_string(*last_received_) +
                        " to " + std::to_string(sequence) + ": it must count the images";
    }
  }
  last_received_ = sequence;
}

std::string FrameContinuity::next(VoFrame& frame, const std::string& camera_frame,
                                  bool clock_jumped_back) {
  std::string reason;
  if (clock_jumped_back) {
    reason = "the clock jumped back";
  } else if (!camera_frame.empty() && !camera_frame_.empty() && camera_frame != camera_frame_) {
    reason = "the camera frame of vo/frame changed from \"" + camera_frame_ + "\" to \"" +
             camera_frame + "\"";
  }
  if (!camera_frame.empty()) camera_frame_ = camera_frame;
  if (!reason.empty()) startTrajectory();
  numberMap(frame);
  if (frame.status == VoStatus::kLost) return reason;  // it tells nothing about the map
  if (!map_id_) {
    frame.continuity = Continuity::kNewTrajectory;
  } else if (frame.map_id != *map_id_) {
    frame.continuity = Continuity::kNewMap;
  } else if (!isSameCamera(frame.camera, camera_)) {
    frame.continuity = Continuity::kOtherLens;
  }
  map_id_ = frame.map_id;
  camera_ = frame.camera;
  return reason;
}

void FrameContinuity::numberMap(VoFrame& frame) {
  if (last_sequence_ && frame.sequence < *last_sequence_) {
    map_id_offset_ = last_map_id_ + 1;
    if (continues_) map_of_unknown_rotation_ = frame.map_id + map_id_offset_;
  }
  continues_ = true;
  last_sequence_ = frame.sequence;
  frame.map_id += map_id_offset_;
  last_map_id_ = frame.map_id;
  if (frame.map_id == map_of_unknown_rotation_) {
    frame.map_start.rotation_sigma = std::numeric_limits<double>::infinity();
  }
}

}  // namespace ground_scale_vo
