#pragma once

#include <topic_tools/shape_shifter.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/scale/speed.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

// What ScaleRecovery receives: which frame continues which, which image belongs to it, and speeds.
namespace gsv {

/// What a received frame continues: the one place where the ROS side decides it (the table in
/// docs/design.md), from the numbers and names in vo/frame.
class FrameContinuity {
 public:
  /// Most frames that may be missing between two; more is an error of the sender.
  static constexpr std::uint32_t kMaxGap = 100000;

  /// The number of each frame that arrives, also of one that is refused later.
  void receive(std::uint32_t sequence);

  /// The next frame that is used: sets its continuity. Keeps map ids ascending when the odometry
  /// restarts and counts its maps from 0 again; the rotation to the first map of a restart is not
  /// known, because the odometry describes the motion since its own first image only. camera_frame:
  /// empty: not known. Returns why a new trajectory starts; empty: it continues, or is the first.
  std::string next(VoFrame& frame, const std::string& camera_frame, bool clock_jumped_back);

  /// A new trajectory starts with the next frame. If the odometry restarts there, too, the rotation
  /// since its first image is the one since the start of the trajectory.
  void startTrajectory() {
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
  /// Of the last frame of the trajectory that was not lost, or of its first; empty: it has none.
  std::optional<std::uint32_t> map_id_;
  PinholeCamera camera_;                                  ///< of the same frame
  std::optional<std::uint32_t> map_of_unknown_rotation_;  ///< the first one after a restart
};

/// Matches each odometry frame with the image of the same stamp; a frame without an image is
/// returned alone. A frame waits for its image only while images arrive: from an image until a
/// frame has waited for kWait in vain. Image: a pointer, null means none. Both are ordered by
/// arrival, because stamps may jump back.
template <typename Frame, typename Image>
class FrameImageSynchronizer {
 public:
  using Clock = std::chrono::steady_clock;  // the clock of a bag may stop

  static constexpr Clock::duration kWait = std::chrono::milliseconds(500);
  static constexpr std::size_t kMaxFrames = 10;  ///< that may wait

  /// max_images: stored; a full buffer drops its oldest image. Precondition: max_images > 0.
  explicit FrameImageSynchronizer(std::size_t max_images) : max_images_(max_images) {}

  void addImage(std::int64_t stamp_ns, Image image) {
    if (images_.size() == max_images_) images_.pop_front();
    images_.emplace_back(stamp_ns, std::move(image));
    images_arrive_ = true;
  }
  void addFrame(std::int64_t stamp_ns, Frame frame, Clock::time_point now) {
    frames_.push_back({stamp_ns, std::move(frame), now});
  }

  /// The oldest frame, with its image if there is one; empty if it still waits or there is none.
  /// Call it until it returns empty. Drops the images up to the frame. may_wait = false: a frame
  /// whose image is missing is returned at once, without it.
  std::optional<std::pair<Frame, Image>> next(Clock::time_point now, bool may_wait = true) {
    if (frames_.empty()) return std::nullopt;
    WaitingFrame& oldest = frames_.front();
    Image image = take(oldest.stamp_ns);
    if (!image) {
      if (now - oldest.since >= kWait) images_arrive_ = false;
      const bool image_lost = !images_.empty();  // take() has left only later images
      if (may_wait && images_arrive_ && !image_lost && frames_.size() <= kMaxFrames) {
        return std::nullopt;
      }
    }
    std::pair<Frame, Image> match(std::move(oldest.frame), std::move(image));
    frames_.pop_front();
    return match;
  }

  /// The stamps jumped back to this one: drops the images before the last one with this stamp, all
  /// if there is none. Precondition: no frame waits.
  void jumpBack(std::int64_t stamp_ns) {
    std::size_t kept = images_.size();
    while (kept > 0 && images_[kept - 1].first != stamp_ns) --kept;
    if (kept == 0) return images_.clear();
    images_.erase(images_.begin(), images_.begin() + static_cast<std::ptrdiff_t>(kept - 1));
  }

 private:
  struct WaitingFrame {
    std::int64_t stamp_ns;
    Frame frame;
    Clock::time_point since;
  };

  /// The image of this stamp; removes it and all before it. If there is none, removes the images
  /// with earlier stamps from the front.
  Image take(std::int64_t stamp_ns) {
    for (std::size_t i = 0; i < images_.size(); ++i) {
      if (images_[i].first != stamp_ns) continue;
      Image image = std::move(images_[i].second);
      images_.erase(images_.begin(), images_.begin() + static_cast<std::ptrdiff_t>(i + 1));
      return image;
    }
    while (!images_.empty() && images_.front().first < stamp_ns) images_.pop_front();
    return Image();
  }

  const std::size_t max_images_;
  std::deque<std::pair<std::int64_t, Image>> images_;  ///< with their stamps
  std::deque<WaitingFrame> frames_;
  bool images_arrive_ = false;  ///< false: frames do not wait for images
};

/// Converts the messages of the topic `speed`, whose type is found at run time.
class SpeedReader {
 public:
  /// unit: SpeedUnit::name; empty: m/s, as REP-103 says for the messages with a stamp. Throws
  /// OptionError.
  explicit SpeedReader(const std::string& unit);

  /// arrival: the stamp of a type without one. Throws DataError, whose sentence continues "speed on
  /// TOPIC": that of VelocityReader, a type without a speed, or a number without a unit.
  SpeedSample read(const topic_tools::ShapeShifter& message, ros::Time arrival);
  bool hasVehicleAxes() const { return velocities_.hasVehicleAxes(); }

 private:
  bool has_unit_;
  VelocityReader velocities_;
};

}  // namespace gsv
