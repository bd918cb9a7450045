#pragma once

#include <tf2_msgs/TFMessage.h>

#include <chrono>
#include <map>
#include <string>

namespace ground_scale_vo {

/// The parents of frames in the messages of tf and tf_static, to find out whether a frame that is
/// to be broadcast has another parent already. A tf tree allows one; tf2 does not report a second.
class FrameParents {
 public:
  using Clock = std::chrono::steady_clock;

  void add(const tf2_msgs::TFMessage& message, bool is_static, Clock::time_point now);

  /// The parent of the frame other than `parent`; empty: none, or not broadcast any more.
  std::string otherParent(const std::string& frame, const std::string& parent,
                          Clock::time_point now) const;
  /// The frame at the top of the chain of static transforms to this frame; the frame itself if
  /// there is none.
  std::string staticRoot(const std::string& frame) const;

  /// Time after the last message in which a transform on tf counts as broadcast.
  static constexpr Clock::duration kMemory = std::chrono::seconds(5);

 private:
  struct Parent {
    bool is_static;
    Clock::time_point last;
  };
  std::map<std::string, std::map<std::string, Parent>> parents_;  ///< child -> its parents
};

}  // namespace ground_scale_vo
