// Publishes the ground truth of a bag in the estimate's odom frame: ground_truth/tf (the bag's tf,
// remapped by bag.launch) -> ground_truth/odometry and ground_truth/path. The two trajectories
// are aligned at the first metric pose.

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <deque>
#include <optional>

#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"
#include "ros/odometry_output.hpp"

namespace {

constexpr std::uint32_t kQueue = 1000;  // [messages]
// The defaults of ScaleRecovery's path_max_poses and path_spacing_m.
constexpr int kPathPoses = 5000;
constexpr double kPathSpacing = 0.5;     // [m]
constexpr std::size_t kMaxPending = 50;  // estimates that wait for their ground truth
constexpr double kClockJump = 1.0;       // stamps that go back by more belong to a looped bag [s]

class GroundTruthRelay {
 public:
  explicit GroundTruthRelay(ros::NodeHandle& handle)
      : path_(kPathPoses, kPathSpacing),
        odometry_publisher_(handle.advertise<nav_msgs::Odometry>("ground_truth/odometry", 100)),
        path_publisher_(handle.advertise<nav_msgs::Path>("ground_truth/path", 1)),
        tf_subscriber_(handle.subscribe<tf2_msgs::TFMessage>(
            "ground_truth/tf", kQueue,
            [this](const tf2_msgs::TFMessageConstPtr& message) { onTf(*message, false); })),
        tf_static_subscriber_(handle.subscribe<tf2_msgs::TFMessage>(
            "ground_truth/tf_static", kQueue,
            [this](const tf2_msgs::TFMessageConstPtr& message) { onTf(*message, true); })),
        odometry_subscriber_(
            handle.subscribe("odometry", kQueue, &GroundTruthRelay::onOdometry, this)) {}

 private:
  void onTf(const tf2_msgs::TFMessage& message, bool is_static) {
    ground_truth_.add(message, is_static);
    publishKnown();
  }

  void onOdometry(const nav_msgs::OdometryConstPtr& odometry) {
    const ros::Time& stamp = odometry->header.stamp;
    if ((last_stamp_ - stamp).toSec() > kClockJump) {
      T_odom_root_.reset();
      pending_.clear();
      path_.clear();
    }
    last_stamp_ = stamp;
    pending_.push_back(odometry);
    if (pending_.size() > kMaxPending) pending_.pop_front();
    publishKnown();
  }

  /// Publishes the ground truth of all pending estimates for which it is known by now.
  void publishKnown() {
    const auto publishIfKnown = [this](const nav_msgs::OdometryConstPtr& estimate) {
      const auto T_root_b = ground_truth_.pose(estimate->child_frame_id, estimate->header.stamp);
      if (!T_root_b) return false;
      if (!T_odom_root_) T_odom_root_ = gsv::fromMsg(estimate->pose.pose) * T_root_b->inverse();
      publish(*estimate, *T_odom_root_ * *T_root_b);
      return true;
    };
    pending_.erase(std::remove_if(pending_.begin(), pending_.end(), publishIfKnown),
                   pending_.end());
  }

  void publish(const nav_msgs::Odometry& estimate, const Eigen::Isometry3d& T_odom_b) {
    auto odometry = boost::make_shared<nav_msgs::Odometry>();
    odometry->header = estimate.header;
    odometry->child_frame_id = gsv::GroundTruthTf::groundTruthFrame(estimate.child_frame_id);
    odometry->pose.pose = gsv::toMsg(T_odom_b);
    odometry_publisher_.publish(odometry);
    if (path_.add(*odometry) && path_publisher_.getNumSubscribers() > 0) {
      path_publisher_.publish(path_.message());
    }
  }

  gsv::GroundTruthTf ground_truth_;
  gsv::BoundedPath path_;
  std::deque<nav_msgs::OdometryConstPtr> pending_;
  std::optional<Eigen::Isometry3d> T_odom_root_;
  ros::Time last_stamp_;
  ros::Publisher odometry_publisher_, path_publisher_;
  ros::Subscriber tf_subscriber_, tf_static_subscriber_, odometry_subscriber_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "ground_truth_relay");
  ros::NodeHandle handle;
  GroundTruthRelay relay(handle);
  ros::spin();
  return 0;
}
