#pragma once

#include <ros/time.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>

namespace gsv {

/// Ground-truth poses from the tf messages of a bag: of kitti_to_bag (ground_truth ->
/// ground_truth/<camera>), of kitti2bag (world -> camera_left, the camera camera_gray_left; world
/// -> base_link and the static chain to the cameras; in an older branch camera_init ->
/// camera_gray_left), or of any other tree.
class GroundTruthTf {
 public:
  /// Name of the ground-truth frame of a frame: a separate one, since a tf frame has one parent
  /// only.
  static std::string groundTruthFrame(const std::string& frame) { return "ground_truth/" + frame; }

  GroundTruthTf();

  void add(const tf2_msgs::TFMessage& message, bool is_static);

  /// T_root_frame [m] at the stamp; root is the root of its tree. Uses the ground-truth frame, or
  /// kitti2bag's name of the frame, if there is one. Empty if the frame is unknown, static, or has
  /// no transform at the stamp.
  std::optional<Eigen::Isometry3d> pose(const std::string& frame, const ros::Time& stamp) const;

 private:
  std::map<std::string, std::string> parents_;  ///< child -> parent
  std::map<std::string, bool> moving_;          ///< child: not static
  mutable tf2::BufferCore buffer_;
};

}  // namespace gsv
