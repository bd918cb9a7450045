// two_vehicles.launch: both pairs of nodelets run, each in its own namespace. live_camera.launch:
// the nodelets run with a height_file. another_vo.launch: another odometry with pose and map points
// gets metric poses; VisualOdometry, run and published by this test, stands in for it. Without a
// launch file: both nodelets run standalone, without a manager (group `alone` of
// launch_files_rostest.test).

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud.h>

#include <boost/make_shared.hpp>

#include "call_service.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {
namespace {

PinholeCamera smallCamera() { return {620, 188, 359.6, 359.6, 309.5, 93.5}; }

/// The camera of a vehicle, and the results of its pair of nodelets, in a namespace.
class Vehicle {
 public:
  explicit Vehicle(const std::string& name)
      : name_(name),
        handle_(name),
        images_(handle_.advertise<sensor_msgs::Image>("camera/image_raw", 1)),
        camera_infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera/camera_info", 1, true)),
        frames_(handle_, "vo/frame"),
        scales_(handle_, "scale") {}

  /// Publishes grey images until a scale arrives: then both nodelets have processed an image. A
  /// publisher cannot see which nodelet of a manager is subscribed, so the first images may be
  /// lost.
  bool waitForScale() {
    camera_infos_.publish(toCameraInfo(smallCamera()));
    sensor_msgs::Image image;
    image.header.frame_id = name_ + "/camera";
    image.encoding = "mono8";
    image.width = image.step = 620;
    image.height = 188;
    image.data.assign(620 * 188, 100);
    for (int s = 1; s <= kTimeout; ++s) {
      image.header.stamp = ros::Time(s);
      images_.publish(image);
      if (scales_.waitForCount(1, 1.0)) return true;
    }
    return false;
  }
  /// The parameter camera_height [m]; 0 without it.
  double height() {
    double height = 0;
    handle_.getParam("scale_recovery/camera_height", height);
    return height;
  }
  bool reset() { return callTrigger(handle_.resolveName("scale_recovery/reset")); }
  TopicRecorder<VoFrameMsg>& frames() { return frames_; }
  TopicRecorder<ScaleEstimateMsg>& scales() { return scales_; }

 private:
  std::string name_;
  ros::NodeHandle handle_;
  ros::Publisher images_, camera_infos_;
  TopicRecorder<VoFrameMsg> frames_;
  TopicRecorder<ScaleEstimateMsg> scales_;
};

TEST(TwoVehicles, BothPairsRunIndependently) {
  Vehicle first("first"), second("second");
  ASSERT_TRUE(first.waitForScale());
  EXPECT_TRUE(second.frames().messages().empty());
  ASSERT_TRUE(second.waitForScale());
  EXPECT_EQ(first.height(), 1.2);
  EXPECT_EQ(second.height(), 1.65);
  // No message of one vehicle reaches the other.
  for (const auto& [vehicle, frame] :
       {std::pair(&first, "first/camera"), {&second, "second/camera"}}) {
    for (const auto& message : vehicle->frames().messages()) {
      EXPECT_EQ(message->header.frame_id, frame);
    }
    for (const auto& message : vehicle->scales().messages()) {
      EXPECT_EQ(message->header.frame_id, frame);
    }
  }
  EXPECT_TRUE(first.reset());
  EXPECT_TRUE(second.reset());
}

TEST(Standalone, BothNodeletsRunWithoutAManager) {
  Vehicle alone("alone");
  EXPECT_TRUE(alone.waitForScale());
}

TEST(LiveCamera, TakesTheHeightFile) {
  Vehicle live("live");
  EXPECT_TRUE(live.waitForScale());
  EXPECT_EQ(live.height(), 1.6539);
}

/// The map points of a frame in the world of the odometry, and their pixels, as another odometry
/// publishes them.
sensor_msgs::PointCloud mapPoints(const VoFrame& frame, const std_msgs::Header& header) {
  sensor_msgs::PointCloud tracks;
  tracks.header = header;
  tracks.channels.resize(3);
  tracks.channels[0].name = "v";
  tracks.channels[1].name = "id";
  tracks.channels[2].name = "u";
  for (const TrackedFeature& feature : frame.features) {
    if (!feature.has_point) continue;
    const Eigen::Vector3d p_w = frame.T_w_c * feature.p_c.cast<double>();
    geometry_msgs::Point32 point;
    point.x = static_cast<float>(p_w.x());
    point.y = static_cast<float>(p_w.y());
    point.z = static_cast<float>(p_w.z());
    tracks.points.push_back(point);
    tracks.channels[0].values.push_back(feature.u.y());
    tracks.channels[1].values.push_back(static_cast<float>(feature.id));
    tracks.channels[2].values.push_back(feature.u.x());
  }
  return tracks;
}

TEST(AnotherVo, GetsMetricPoses) {
  ros::NodeHandle handle("other");
  const ros::Publisher odometries = handle.advertise<nav_msgs::Odometry>("another_vo/odometry", 10);
  const ros::Publisher clouds = handle.advertise<sensor_msgs::PointCloud>("another_vo/tracks", 10);
  const ros::Publisher infos =
      handle.advertise<sensor_msgs::CameraInfo>("camera/camera_info", 1, true);
  infos.publish(toCameraInfo(smallCamera()));
  TopicRecorder<VoFrameMsg> frames(handle, "vo/frame");
  TopicRecorder<ScaleEstimateMsg> scales(handle, "scale");
  TopicRecorder<nav_msgs::Odometry> metric(handle, "odometry");
  ASSERT_TRUE(waitUntil([&] {
    return odometries.getNumSubscribers() == 1 && clouds.getNumSubscribers() == 1 &&
           infos.getNumSubscribers() >= 1 && frames.connected() && scales.connected() &&
           metric.connected();
  }));

  SyntheticDrive::Options options;
  options.camera = smallCamera();
  options.frames = 45;
  options.stop_s = 0;
  const SyntheticDrive drive(options);
  VisualOdometry odometry(drive.camera(), {});
  std::map<ros::Time, Eigen::Vector3d> ground_truth;
  bool is_connected = false;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const VoFrame frame = odometry.process(drive.image(i), drive.frame(i).stamp_ns).frame;
    if (frame.status != VoStatus::kTracking) continue;
    std_msgs::Header header;
    header.stamp = fromNanoseconds(frame.stamp_ns + 1000000000);
    header.frame_id = "camera";
    ground_truth[header.stamp] = drive.frame(i).T_c0_c.translation();
    // The converter is connected once it publishes a frame; earlier messages may be lost.
    const std::size_t before = frames.messages().size();
    clouds.publish(mapPoints(frame, header));
    odometries.publish(toOdometryMsg(frame, header, "map"));
    is_connected = frames.waitForCount(before + 1, is_connected ? kTimeout : 1.0) || is_connected;
  }
  const ros::Time last = ground_truth.rbegin()->first;
  ASSERT_TRUE(scales.waitForStamp(last));
  ASSERT_TRUE(metric.waitForStamp(last));
  EXPECT_EQ(frames.messages().back()->header.frame_id, "camera");
  int measured = 0;
  for (const auto& scale : scales.messages()) measured += scale->status == ScaleEstimateMsg::OK;
  EXPECT_GT(measured, 10);

  double length = 0, true_length = 0;
  const auto poses = metric.messages();
  ASSERT_GT(poses.size(), 20u);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto& a = *poses[i - 1];
    const auto& b = *poses[i];
    length += (fromMsg(b.pose.pose).translation() - fromMsg(a.pose.pose).translation()).norm();
    true_length += (ground_truth.at(b.header.stamp) - ground_truth.at(a.header.stamp)).norm();
  }
  EXPECT_NEAR(length / true_length, 1, 0.025);
}

}  // namespace
}  // namespace ground_scale_vo
