#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// Matches each odometry frame with the image of the same stamp. Unlike message_filters, it drops
/// no frame and keeps their order: a frame without an image is returned alone.
///
/// A frame waits for its image only while images arrive: from an image until a frame has waited for
/// Limits::wait in vain, and again from the next image on. Image: a pointer, null means none.
/// Images are ordered by arrival, as frames are, because stamps may jump back.
template <typename Frame, typename Image>
class FrameImageSynchronizer {
 public:
  using Clock = std::chrono::steady_clock;  // the clock of a bag may stop

  struct Limits {
    std::size_t images = 30;  ///< stored; a full buffer drops its oldest image
    std::size_t frames = 10;  ///< that may wait
    Clock::duration wait = std::chrono::milliseconds(500);
  };
  struct Match {
    Frame frame;
    Image image;
  };

  /// Precondition: limits.images > 0.
  explicit FrameImageSynchronizer(const Limits& limits) : limits_(limits) {}

  void addImage(std::int64_t stamp_ns, Image image) {
    if (images_.size() == limits_.images) images_.pop_front();
    images_.push_back({stamp_ns, std::move(image)});
    images_arrive_ = true;
  }
  void addFrame(std::int64_t stamp_ns, Frame frame, Clock::time_point now) {
    frames_.push_back({stamp_ns, std::move(frame), now});
  }

  /// The oldest frame, with its image if there is one; empty if it still waits or there is none.
  /// Call it until it returns empty. Drops the images up to the frame. may_wait = false: a frame
  /// whose image is missing is returned at once, without it.
  std::optional<Match> next(Clock::time_point now, bool may_wait = true) {
    if (frames_.empty()) return std::nullopt;
    WaitingFrame& oldest = frames_.front();
    Image image = take(oldest.stamp_ns);
    if (!image) {
      if (now - oldest.since >= limits_.wait) images_arrive_ = false;
      const bool image_lost = !images_.empty();  // take() has left only later images
      if (may_wait && images_arrive_ && !image_lost && frames_.size() <= limits_.frames) {
        return std::nullopt;
      }
    }
    Match match{std::move(oldest.frame), std::move(image)};
    frames_.pop_front();
    return match;
  }

  /// The stamps jumped back to this one: drops the images before the last one with this stamp, all
  /// if there is none. Precondition: no frame waits.
  void jumpBack(std::int64_t stamp_ns) {
    std::size_t kept = images_.size();
    while (kept > 0 && images_[kept - 1].stamp_ns != stamp_ns) --kept;
    if (kept == 0) return images_.clear();
    images_.erase(images_.begin(), images_.begin() + static_cast<std::ptrdiff_t>(kept - 1));
  }

 private:
  struct StoredImage {
    std::int64_t stamp_ns;
    Image image;
  };
  struct WaitingFrame {
    std::int64_t stamp_ns;
    Frame frame;
    Clock::time_point since;
  };

  /// The image of this stamp; removes it and all before it. If there is none, removes the images
  /// with earlier stamps from the front.
  Image take(std::int64_t stamp_ns) {
    for (std::size_t i = 0; i < images_.size(); ++i) {
      if (images_[i].stamp_ns != stamp_ns) continue;
      Image image = std::move(images_[i].image);
      images_.erase(images_.begin(), images_.begin() + static_cast<std::ptrdiff_t>(i + 1));
      return image;
    }
    while (!images_.empty() && images_.front().stamp_ns < stamp_ns) images_.pop_front();
    return Image();
  }

  const Limits limits_;
  std::deque<StoredImage> images_;
  std::deque<WaitingFrame> frames_;
  bool images_arrive_ = false;  ///< false: frames do not wait for images
};

}  // namespace ground_scale_vo
