#pragma once

#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <string>

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

}  // namespace ground_scale_vo
