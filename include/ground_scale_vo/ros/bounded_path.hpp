#pragma once

#include <geometry_msgs/PoseStamped.h>

#include <cstddef>
#include <vector>

namespace ground_scale_vo {

/// A path of bounded length for drawing: poses at least a spacing apart; when it is full every
/// second one goes and the spacing doubles, so an hour's drive is as long as a minute's.
class BoundedPath {
 public:
  /// Preconditions: max_poses >= 2, spacing_m >= 0.
  BoundedPath(std::size_t max_poses, double spacing_m);

  /// True when the pose was kept.
  bool add(const geometry_msgs::PoseStamped& pose);
  void clear();
  const std::vector<geometry_msgs::PoseStamped>& poses() const { return poses_; }

 private:
  const std::size_t max_poses_;
  const double first_spacing_m_;
  double spacing_m_;
  std::vector<geometry_msgs::PoseStamped> poses_;
};

}  // namespace ground_scale_vo
