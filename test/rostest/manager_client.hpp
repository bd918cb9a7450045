#pragma once

#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>

#include <map>
#include <optional>
#include <string>

#include "call_service.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {

/// Calls the services of a nodelet manager.
class ManagerClient {
 public:
  explicit ManagerClient(std::string name) : name_(std::move(name)) {}

  const std::string& name() const { return name_; }
  bool waitForServices() const {
    return ros::service::waitForService(name_ + "/load_nodelet",
                                        static_cast<std::int32_t>(1000 * kTimeout));
  }
  /// type: without the package. remaps: from global name to global name.
  bool load(const std::string& type, const std::string& nodelet,
            const std::map<std::string, std::string>& remaps = {}) const {
    nodelet::NodeletLoad service;
    service.request.name = nodelet;
    service.request.type = "ground_scale_vo/" + type;
    for (const auto& [from, to] : remaps) {
      service.request.remap_source_args.push_back(from);
      service.request.remap_target_args.push_back(to);
    }
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
