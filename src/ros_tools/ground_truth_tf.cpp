#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"

#include "ground_scale_vo/ros/conversions.hpp"

namespace gsv {
namespace {

/// [s] longer than any drive, so that nothing expires.
constexpr double kCacheTime = 1e6;
/// [frames] from a frame to its root; ends the search in a cyclic tree.
constexpr int kLongestChain = 100;

/// Name that kitti2bag gives to a camera in the ground truth of an odometry sequence; empty for
/// other frames.
std::string kitti2bagName(const std::string& frame) {
  return frame == "camera_gray_left" ? "camera_left" : "";
}

}  // namespace

GroundTruthTf::GroundTruthTf() : buffer_(ros::Duration(kCacheTime)) {}

void GroundTruthTf::add(const tf2_msgs::TFMessage& message, bool is_static) {
  for (geometry_msgs::TransformStamped transform : message.transforms) {
    transform.header.frame_id = withoutLeadingSlashes(transform.header.frame_id);
    transform.child_frame_id = withoutLeadingSlashes(transform.child_frame_id);
    if (!buffer_.setTransform(transform, "ground_truth", is_static)) continue;
    parents_[transform.child_frame_id] = transform.header.frame_id;
    moving_[transform.child_frame_id] = !is_static;
  }
}

std::optional<Eigen::Isometry3d> GroundTruthTf::pose(const std::string& frame,
                                                     const ros::Time& stamp) const {
  std::string target = withoutLeadingSlashes(frame);
  for (const std::string& other_name : {groundTruthFrame(target), kitti2bagName(target)}) {
    if (parents_.count(other_name) == 0) continue;
    target = other_name;
    break;
  }
  std::string root = target;
  bool moves = false;
  for (int i = 0; i < kLongestChain && parents_.count(root) != 0; ++i) {
    moves = moves || moving_.at(root);
    root = parents_.at(root);
  }
  if (!moves) return std::nullopt;
  try {
    return fromMsg(buffer_.lookupTransform(root, target, stamp).transform);
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

}  // namespace gsv
