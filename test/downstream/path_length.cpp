// A node with both: the messages of ground_scale_vo, and the types of its library.
#include <ground_scale_vo/ScaleEstimate.h>
#include <ground_scale_vo/VoFrame.h>
#include <ros/ros.h>

#include "ground_scale_vo/ros/conversions.hpp"

namespace {

/// [VO units] Travelled by the odometry that publishes vo/frame.
class PathLength {
 public:
  void add(const ground_scale_vo::VoFrame& message) {
    const gsv::VoFrame frame = gsv::fromMsg(message);
    if (frame.status != gsv::VoStatus::kTracking) return;
    length_ += (frame.T_w_c.translation() - last_).norm();
    last_ = frame.T_w_c.translation();
  }
  double length() const { return length_; }

 private:
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
  double length_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "path_length");
  ros::NodeHandle handle;
  PathLength path;
  const auto on_frame = [&path](const ground_scale_vo::VoFrame::ConstPtr& frame) {
    path.add(*frame);
  };
  const auto on_scale = [&path](const ground_scale_vo::ScaleEstimate::ConstPtr& message) {
    const gsv::ScaleEstimate scale = gsv::fromMsg(*message);
    if (scale.status == gsv::ScaleStatus::kUnknown) return;
    ROS_INFO_STREAM(scale.scale * path.length() << " m");
  };
  const ros::Subscriber frames =
      handle.subscribe<ground_scale_vo::VoFrame>("vo/frame", 10, on_frame);
  const ros::Subscriber scales =
      handle.subscribe<ground_scale_vo::ScaleEstimate>("scale", 10, on_scale);
  ros::spin();
}
