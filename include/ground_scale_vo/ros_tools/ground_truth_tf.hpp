#pragma once

#include <ros/time.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>

namespace ground_scale_vo {

/// The true motion of a frame, from the tf messages of a bag: of kitti_to_bag
/// (ground_truth -> ground_truth/<camera>), of kitti2bag (camera_init -> camera_gray_left, or
/// world -> base_link and the static chain to the cameras), or any other tree.
class GroundTruthTf {
 public:
  /// The name of the true twin of a frame, so that the two are not one frame with two parents.
  static std::string twinOf(const std::string& frame) { return "ground_truth/" + frame; }

  GroundTruthTf();

  void add(const tf2_msgs::TFMessage& message, bool is_static);
  void clear();

  /// T_root_frame [m] at the stamp; root is the top of the frame's tree. The frame's twin is used
  /// when there is one. Empty when the tree does not know the frame, has it fixed to its root, or
  /// does not reach the stamp.
  std::optional<Eigen::Isometry3d> pose(const std::string& frame, const ros::Time& stamp) const;

 private:
  std::map<std::string, std::string> parents_;  ///< child -> parent
  std::map<std::string, bool> moving_;          ///< child: not static
  mutable tf2::BufferCore buffer_;
};

}  // namespace ground_scale_vo
