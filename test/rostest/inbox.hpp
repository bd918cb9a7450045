#pragma once

#include <ros/ros.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "support/sanitizer.hpp"

namespace ground_scale_vo {

/// Longest wait for anything in a rostest [s].
constexpr double kPatience = 60.0 * kSlower;

/// All messages of a topic so far, and a way to wait for them. Needs a spinner on other threads.
template <typename Message>
class Inbox {
 public:
  using ConstPtr = typename Message::ConstPtr;

  Inbox(ros::NodeHandle& handle, const std::string& topic)
      : subscriber_(handle.subscribe<Message>(topic, 10000, [this](const ConstPtr& message) {
          const std::lock_guard<std::mutex> lock(mutex_);
          messages_.push_back(message);
          changed_.notify_all();
        })) {}
  ~Inbox() { subscriber_.shutdown(); }

  /// True when the predicate over all messages came true in time.
  bool wait(const std::function<bool(const std::vector<ConstPtr>&)>& predicate,
            double patience = kPatience) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(patience),
                             [&] { return predicate(messages_); });
  }
  bool waitForCount(std::size_t count, double patience = kPatience) {
    return wait([count](const auto& messages) { return messages.size() >= count; }, patience);
  }
  /// True when a message with this stamp came in time.
  bool waitForStamp(const ros::Time& stamp, double patience = kPatience) {
    return wait(
        [&stamp](const auto& messages) {
          return !messages.empty() && messages.back()->header.stamp == stamp;
        },
        patience);
  }

  std::vector<ConstPtr> messages() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }
  /// The same, and forgets them.
  std::vector<ConstPtr> take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return std::exchange(messages_, {});
  }
  void clear() { take(); }
  bool connected() const { return subscriber_.getNumPublishers() > 0; }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ConstPtr> messages_;
  ros::Subscriber subscriber_;
};

/// Polls what has no event of its own (connections, tf). True when it came true in time.
inline bool waitUntil(const std::function<bool()>& condition, double patience = kPatience) {
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(patience);
  while (!condition()) {
    if (!ros::ok() || ros::WallTime::now() > deadline) return false;
    ros::WallDuration(0.01).sleep();
  }
  return true;
}

}  // namespace ground_scale_vo
