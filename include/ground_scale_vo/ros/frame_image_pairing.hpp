#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// Gives each frame of an odometry the image of the same stamp. No frame is lost, all leave in the
/// order in which they came; one whose image does not come leaves without.
///
/// A frame waits for its image only while images flow: from the first image on, until a frame has
/// waited in vain for Limits::wait. Image: a pointer, null means none. The images' order is that of
/// their arrival, as the frames' is: their stamps may jump.
template <typename Frame, typename Image>
class FrameImagePairing {
 public:
  using Clock = std::chrono::steady_clock;  // a bag's clock may stand still

  struct Limits {
    std::size_t images = 30;  ///< kept; when it is full the oldest goes
    std::size_t frames = 10;  ///< that may wait
    Clock::duration wait = std::chrono::milliseconds(500);
  };
  struct Pair {
    Frame frame;
    Image image;
  };

  /// Precondition: limits.images > 0.
  explicit FrameImagePairing(const Limits& limits) : limits_(limits) {}

  void addImage(std::int64_t stamp_ns, Image image) {
    if (images_.size() == limits_.images) images_.pop_front();
    images_.push_back({stamp_ns, std::move(image)});
    flowing_ = true;
  }
  void addFrame(std::int64_t stamp_ns, Frame frame, Clock::time_point now) {
    frames_.push_back({stamp_ns, std::move(frame), now});
  }

  /// The oldest frame, unless it has to wait; to be called until it gives none. Images that are
  /// older than the frame go with it. may_wait: false, none waits any longer.
  std::optional<Pair> next(Clock::time_point now, bool may_wait = true) {
    if (frames_.empty()) return std::nullopt;
    WaitingFrame& oldest = frames_.front();
    Image image = take(oldest.stamp_ns);
    if (!image) {
      if (now - oldest.since >= limits_.wait) flowing_ = false;
      const bool lost = !images_.empty();  // take() has left only later ones
      if (may_wait && flowing_ && !lost && frames_.size() <= limits_.frames) return std::nullopt;
    }
    Pair pair{std::move(oldest.frame), std::move(image)};
    frames_.pop_front();
    return pair;
  }

  /// The frames' clock jumped back to this stamp: the images of the old clock go. To be called when
  /// no frame waits.
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

  /// The image of this stamp, which goes with all that came before it. Without one the images up to
  /// this stamp go.
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
  bool flowing_ = false;
};

}  // namespace ground_scale_vo
