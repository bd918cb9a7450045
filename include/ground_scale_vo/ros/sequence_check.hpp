#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace ground_scale_vo {

/// Counts the frames that are missing from the sequence numbers of vo/frame, and reports numbers
/// that do not count frames.
class SequenceCheck {
 public:
  /// Most frames that may be missing between two; more is an error of the sender.
  static constexpr std::uint32_t kMaxGap = 100000;

  void add(std::uint32_t sequence) {
    error_.clear();
    repeats_ = last_ && sequence == *last_ ? repeats_ + 1 : 0;
    if (repeats_ > (sequence == 0 ? 1 : 0)) {  // 0 twice: two restarts, an image between them
      error_ = "sequence is " + std::to_string(sequence) +
               " in two vo/frame in a row: the odometry must increase it with every image, "
               "otherwise its restarts and lost frames are not detected";
    } else if (last_ && sequence > *last_) {
      const std::uint32_t gap = sequence - *last_ - 1;
      if (gap <= kMaxGap) {
        missing_ += gap;
      } else {
        error_ = "sequence of vo/frame jumps from " + std::to_string(*last_) + " to " +
                 std::to_string(sequence) + ": it must count the images";
      }
    }
    last_ = sequence;
  }

  std::uint64_t missing() const { return missing_; }
  /// What is wrong with the last number; empty: nothing.
  const std::string& error() const { return error_; }

 private:
  std::optional<std::uint32_t> last_;
  std::uint32_t repeats_ = 0;  ///< of last_
  std::uint64_t missing_ = 0;
  std::string error_;
};

}  // namespace ground_scale_vo
