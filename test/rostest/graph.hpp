#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/master.h>
#include <ros/ros.h>
#include <ros/this_node.h>
#include <std_srvs/Trigger.h>

#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>

#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "support/sanitizer.hpp"
#include "support/test.hpp"

namespace gsv {

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

using Status = diagnostic_msgs::DiagnosticStatus;

/// The value of a key; empty if the status lacks it.
inline std::string valueIn(const Status& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return entry.value;
  }
  return {};
}
/// The same as a number; 0 if the status lacks it.
inline double numberIn(const Status& status, const std::string& key) {
  const std::string value = valueIn(status, key);
  return value.empty() ? 0 : std::stod(value);
}

/// Records the diagnostics of all nodelets. A nodelet is given without a leading slash.
class DiagnosticsRecorder : public TopicRecorder<diagnostic_msgs::DiagnosticArray> {
 public:
  explicit DiagnosticsRecorder(ros::NodeHandle& handle) : TopicRecorder(handle, "/diagnostics") {}

  /// True if a status of the nodelet arrives for which the predicate holds; otherwise it has the
  /// last status. from_now: not one that is recorded already.
  testing::AssertionResult waitForStatus(const std::string& nodelet,
                                         const std::function<bool(const Status&)>& predicate,
                                         bool from_now = true) {
    if (from_now) clear();
    Status last;
    const bool found = wait([&](const auto& reports) {
      for (const auto& report : reports) {
        for (const Status& status : report->status) {
          if (status.name.rfind(nodelet + ":", 0) != 0) continue;
          last = status;
          if (predicate(status)) return true;
        }
      }
      return false;
    });
    if (found) return testing::AssertionSuccess();
    testing::AssertionResult result = testing::AssertionFailure();
    result << "last status of " << nodelet << ": " << int(last.level) << " " << last.message;
    for (const auto& entry : last.values) result << "\n  " << entry.key << ": " << entry.value;
    return result;
  }
  /// A status with this level and a message that contains the text.
  testing::AssertionResult waitForSummary(const std::string& nodelet, std::int8_t level,
                                          const std::string& text, bool from_now = true) {
    return waitForStatus(
        nodelet,
        [&](const Status& status) {
          return status.level == level && status.message.find(text) != std::string::npos;
        },
        from_now);
  }
  /// A status with all of these values.
  testing::AssertionResult waitForValues(const std::string& nodelet,
                                         const std::map<std::string, std::string>& values) {
    return waitForStatus(nodelet, [&](const Status& status) {
      return std::all_of(values.begin(), values.end(), [&](const auto& value) {
        return valueIn(status, value.first) == value.second;
      });
    });
  }
  /// The next status of the nodelet.
  Status next(const std::string& nodelet) {
    Status next;
    EXPECT_TRUE(waitForStatus(nodelet, [&](const Status& status) {
      next = status;
      return true;
    }));
    return next;
  }
};

/// Calls a service; false if there is no answer, or one that reports a failure.
///
/// On a connection that stays open until the answer is read. The server closes that of
/// ros::service::call after its answer, and on a busy machine roscpp takes this for a failure of
/// the call before it has read the answer: github.com/ros/ros_comm/issues/1976.
template <typename Service>
bool callService(const std::string& name, Service& service) {
  constexpr bool kPersistent = true;
  return ros::NodeHandle().serviceClient<Service>(name, kPersistent).call(service);
}

/// The same with a service of type std_srvs/Trigger; true if it reports success.
inline bool callTrigger(const std::string& name) {
  std_srvs::Trigger trigger;
  return callService(name, trigger) && trigger.response.success;
}

/// Calls the services of a nodelet manager.
class ManagerClient {
 public:
  explicit ManagerClient(std::string name) : name_(std::move(name)) {}

  const std::string& name() const { return name_; }
  bool waitForServices() const {
    // ros::service::waitForService() never ends under use_sim_time without a clock.
    return waitUntil([this] { return ros::service::exists(name_ + "/load_nodelet", false); });
  }
  /// type: without the package. remapped: {from, to}, absolute names.
  bool load(const std::string& type, const std::string& nodelet,
            const std::vector<std::pair<std::string, std::string>>& remapped = {}) const {
    nodelet::NodeletLoad service;
    for (const auto& [from, to] : remapped) {
      service.request.remap_source_args.push_back(from);
      service.request.remap_target_args.push_back(to);
    }
    service.request.name = nodelet;
    service.request.type = "ground_scale_vo/" + type;
    return callService(name_ + "/load_nodelet", service) && service.response.success;
  }
  bool unload(const std::string& nodelet) const {
    nodelet::NodeletUnload service;
    service.request.name = nodelet;
    return callService(name_ + "/unload_nodelet", service) && service.response.success;
  }
  /// Number of loaded nodelets; empty if the manager does not answer.
  std::optional<std::size_t> loaded() const {
    nodelet::NodeletList service;
    if (!callService(name_ + "/list", service)) return std::nullopt;
    return service.response.nodelets.size();
  }

 private:
  std::string name_;
};

}  // namespace gsv
