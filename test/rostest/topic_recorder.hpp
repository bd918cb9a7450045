#pragma once

#include <ros/master.h>
#include <ros/ros.h>
#include <ros/this_node.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "support/sanitizer.hpp"

namespace ground_scale_vo {

/// Longest wait for an event in a rostest [s].
constexpr double kTimeout = 60.0 * kTimeoutFactor;

/// True if one of the publishers of the topic sends it to a node whose name begins with
/// `receiver`, default: this node; publisher: only this one, empty: any. A subscriber counts as
/// connected (ros::Subscriber::getNumPublishers()) a moment before the publisher sends: roscpp
/// answers the subscriber first, and a message that it publishes in between is lost.
inline bool isSent(const std::string& topic, const std::string& publisher = "",
                   const std::string& receiver = ros::this_node::getName()) {
  XmlRpc::XmlRpcValue request, response, state;
  request[0] = ros::this_node::getName();
  if (!ros::master::execute("getSystemState", request, response, state, false)) return false;
  XmlRpc::XmlRpcValue& publishers = state[0];
  for (int i = 0; i < publishers.size(); ++i) {
    if (static_cast<std::string>(publishers[i][0]) != topic) continue;
    for (int k = 0; k < publishers[i][1].size(); ++k) {
      const std::string node = publishers[i][1][k];
      if (!publisher.empty() && node != publisher) continue;
      auto connections = callNode(node, "getBusInfo");
      if (!connections) continue;
      for (int c = 0; c < connections->size(); ++c) {
        // Id, node at the other end, direction, transport, topic, and more.
        XmlRpc::XmlRpcValue& connection = (*connections)[c];
        if (static_cast<std::string>(connection[1]).rfind(receiver, 0) == 0 &&
            static_cast<std::string>(connection[2]) == "o" &&
            static_cast<std::string>(connection[4]) == topic) {
          return true;
        }
      }
    }
  }
  return false;
}

/// Records all messages of a topic and waits for messages. Needs a spinner on another thread.
template <typename Message>
class TopicRecorder {
 public:
  using ConstPtr = typename Message::ConstPtr;

  TopicRecorder(ros::NodeHandle& handle, const std::string& topic)
      : subscriber_(handle.subscribe<Message>(topic, 10000, [this](const ConstPtr& message) {
          const std::lock_guard<std::mutex> lock(mutex_);
          messages_.push_back(message);
          changed_.notify_all();
        })) {}
  ~TopicRecorder() { subscriber_.shutdown(); }

  /// True if the predicate over all messages becomes true in time.
  bool wait(const std::function<bool(const std::vector<ConstPtr>&)>& predicate,
            double timeout = kTimeout) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(timeout),
                             [&] { return predicate(messages_); });
  }
  bool waitForCount(std::size_t count, double timeout = kTimeout) {
    return wait([count](const auto& messages) { return messages.size() >= count; }, timeout);
  }
  /// True if in time the newest message is one with this stamp.
  bool waitForStamp(const ros::Time& stamp, double timeout = kTimeout) {
    return wait(
        [&stamp](const auto& messages) {
          return !messages.empty() && messages.back()->header.stamp == stamp;
        },
        timeout);
  }

  std::vector<ConstPtr> messages() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }
  std::size_t count() { return messages().size(); }
  /// Throws std::out_of_range without messages.
  ConstPtr first() { return messages().at(0); }
  ConstPtr last() {
    const auto all = messages();
    return all.at(all.size() - 1);
  }
  /// The messages, which are cleared.
  std::vector<ConstPtr> take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return std::exchange(messages_, {});
  }
  void clear() { take(); }
  /// What is published from now on is recorded. publisher: by this node; empty: by one of them.
  bool connected(const std::string& publisher = "") const {
    return subscriber_.getNumPublishers() > 0 && isSent(subscriber_.getTopic(), publisher);
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ConstPtr> messages_;
  ros::Subscriber subscriber_;
};

/// Polls a condition without an event (connections, tf). True if it becomes true in time.
inline bool waitUntil(const std::function<bool()>& condition, double timeout = kTimeout) {
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(timeout);
  while (!condition()) {
    if (!ros::ok() || ros::WallTime::now() > deadline) return false;
    ros::WallDuration(0.01).sleep();
  }
  return true;
}

}  // namespace ground_scale_vo
