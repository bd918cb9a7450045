// two_vehicles.launch: both pairs of nodelets run, each in its own namespace. another_vo.launch:
// another odometry with pose and map points gets metric poses; VisualOdometry, run and published by
// this test, stands in for it. ground_truth_relay, which bag.launch starts, follows a looped bag.

#include <sensor_msgs/PointCloud.h>

#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "nodelet_pair.hpp"

namespace gsv {
namespace {

const char* const kImage = "/camera/image_raw";
const char* const kCameraInfo = "/camera/camera_info";

PinholeCamera smallCamera() { return {620, 188, 359.6, 359.6, 309.5, 93.5}; }

/// Publishes grey images of a camera until a scale arrives: then both nodelets have processed an
/// image. A publisher cannot see which nodelet of a manager is subscribed, so the first images may
/// be lost.
bool waitForScale(NodeletTopics& topics, const std::string& camera_frame) {
  topics.publishInfo(toCameraInfo(smallCamera()));
  sensor_msgs::Image image = *toMsg(cv::Mat(188, 620, CV_8UC1, cv::Scalar(100)), "mono8", {});
  image.header.frame_id = camera_frame;
  for (int s = 1; s <= kTimeout; ++s) {
    image.header.stamp = ros::Time(s);
    topics.publishImage(image);
    if (topics.scales.waitForCount(1, 1.0)) return true;
  }
  return false;
}

TEST(LaunchFiles, TwoVehiclesRunIndependently) {
  NodeletTopics first("/first", kImage, kCameraInfo), second("/second", kImage, kCameraInfo);
  ASSERT_TRUE(waitForScale(first, "first/camera"));
  EXPECT_EQ(second.frames.count(), 0u);
  ASSERT_TRUE(waitForScale(second, "second/camera"));
  // No message of one vehicle reaches the other.
  for (const auto& [topics, frame] :
       {std::pair(&first, "first/camera"), {&second, "second/camera"}}) {
    for (const auto& message : topics->frames.messages()) {
      EXPECT_EQ(message->header.frame_id, frame);
    }
    for (const auto& message : topics->scales.messages()) {
      EXPECT_EQ(message->header.frame_id, frame);
    }
  }
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

TEST(LaunchFiles, AnotherVoGetsMetricPoses) {
  ros::NodeHandle handle("other");
  const ros::Publisher odometries = handle.advertise<nav_msgs::Odometry>("another_vo/odometry", 10);
  const ros::Publisher clouds = handle.advertise<sensor_msgs::PointCloud>("another_vo/tracks", 10);
  NodeletTopics topics("/other", kImage, kCameraInfo);
  topics.publishInfo(toCameraInfo(smallCamera()));
  ASSERT_TRUE(waitUntil([&] {
    return odometries.getNumSubscribers() == 1 && clouds.getNumSubscribers() == 1 &&
           topics.frames.connected() && topics.scales.connected() && topics.odometry.connected();
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
    const auto header = headerAt(fromNanoseconds(frame.stamp_ns + 1000000000));
    ground_truth[header.stamp] = drive.frame(i).T_c0_c.translation();
    // The converter is connected once it publishes a frame; earlier messages may be lost.
    const std::size_t before = topics.frames.count();
    clouds.publish(mapPoints(frame, header));
    odometries.publish(toOdometryMsg(frame, header, "map"));
    is_connected =
        topics.frames.waitForCount(before + 1, is_connected ? kTimeout : 1.0) || is_connected;
  }
  const ros::Time last = ground_truth.rbegin()->first;
  ASSERT_TRUE(topics.scales.waitForStamp(last));
  ASSERT_TRUE(topics.odometry.waitForStamp(last));
  EXPECT_EQ(topics.frames.last()->header.frame_id, "camera");
  int measured = 0;
  for (const auto& scale : topics.scales.messages()) {
    measured += scale->status == ScaleEstimateMsg::OK;
  }
  EXPECT_GT(measured, 10);

  double length = 0, true_length = 0;
  const auto poses = topics.odometry.messages();
  ASSERT_GT(poses.size(), 20u);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto &a = *poses[i - 1], &b = *poses[i];
    length += (fromMsg(b.pose.pose).translation() - fromMsg(a.pose.pose).translation()).norm();
    true_length += (ground_truth.at(b.header.stamp) - ground_truth.at(a.header.stamp)).norm();
  }
  EXPECT_NEAR(length / true_length, 1, 0.025);
}

// A bag whose stamps start again, of which the odometry misses more this time.
TEST(LaunchFiles, TheGroundTruthOfALoopedBagIsAlignedAnew) {
  ros::NodeHandle handle("looped");
  const ros::Publisher tf = handle.advertise<tf2_msgs::TFMessage>("ground_truth/tf", 10);
  const ros::Publisher estimates = handle.advertise<nav_msgs::Odometry>("odometry", 10);
  TopicRecorder<nav_msgs::Odometry> aligned(handle, "/looped/ground_truth/odometry");
  TopicRecorder<nav_msgs::Path> path(handle, "/looped/ground_truth/path");
  ASSERT_TRUE(waitUntil([&] {
    return tf.getNumSubscribers() == 1 && estimates.getNumSubscribers() == 1 &&
           aligned.connected() && path.connected();
  }));
  // x of the aligned ground truth, which drives at 10 m/s.
  const auto alignedAt = [&](double time, double estimated_x) {
    const Eigen::Isometry3d T_g_c(Eigen::Translation3d(10 * time, 0, 0));
    const Eigen::Isometry3d T_o_c(Eigen::Translation3d(estimated_x, 0, 0));
    const ros::Time stamp(time);
    tf.publish(tfMessage(transformBetween("ground_truth", "ground_truth/camera", T_g_c), stamp));
    nav_msgs::Odometry estimate;
    estimate.header = headerAt(stamp, "odom");
    estimate.child_frame_id = "camera";
    estimate.pose.pose = toMsg(T_o_c);
    estimates.publish(estimate);
    return aligned.waitForStamp(stamp) ? aligned.last()->pose.pose.position.x : NAN;
  };
  EXPECT_DOUBLE_EQ(alignedAt(1, 0), 0);
  EXPECT_DOUBLE_EQ(alignedAt(5, 38), 40);
  EXPECT_DOUBLE_EQ(alignedAt(2, 0), 0);
  EXPECT_DOUBLE_EQ(alignedAt(4, 19), 20);
  EXPECT_TRUE(path.wait([](const auto& paths) { return paths.back()->poses.size() == 2; }));
}

}  // namespace
}  // namespace gsv
