#include "ground_scale_vo/ros/frame_parents.hpp"

#include <algorithm>
#include <set>

#include "ground_scale_vo/ros/frame_name.hpp"

namespace ground_scale_vo {

void FrameParents::add(const tf2_msgs::TFMessage& message, bool is_static, Clock::time_point now) {
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    Parent& parent = parents_[withoutLeadingSlashes(transform.child_frame_id)]
                             [withoutLeadingSlashes(transform.header.frame_id)];
    parent = {is_static, now};
  }
}

std::string FrameParents::otherParent(const std::string& frame, const std::string& parent,
                                      Clock::time_point now) const {
  const auto found = parents_.find(frame);
  if (found == parents_.end()) return {};
  for (const auto& [name, other] : found->second) {
    if (name != parent && (other.is_static || now - other.last <= kMemory)) return name;
  }
  return {};
}

std::string FrameParents::staticRoot(const std::string& frame) const {
  std::string root = frame;
  std::set<std::string> passed;  // a cycle is an error of the sender
  while (passed.insert(root).second) {
    const auto found = parents_.find(root);
    if (found == parents_.end()) break;
    const auto parent = std::find_if(found->second.begin(), found->second.end(),
                                     [](const auto& entry) { return entry.second.is_static; });
    if (parent == found->second.end()) break;
    root = parent->first;
  }
  return root;
}

}  // namespace ground_scale_vo
