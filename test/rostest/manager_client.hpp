#pragma once

#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <optional>
#include <string>

#include "topic_recorder.hpp"

namespace ground_scale_vo {

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
  /// type: without the package.
  bool load(const std::string& type, const std::string& nodelet) const {
    nodelet::NodeletLoad service;
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

}  // namespace ground_scale_vo
