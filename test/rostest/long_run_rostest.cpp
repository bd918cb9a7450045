// A long drive through both nodelets with all outputs subscribed: the memory of the manager
// does not grow, the path stays bounded, all values are finite and the scale stays correct.
//
// Two minutes by default, an hour with GROUND_SCALE_VO_LONG (scripts/test --long). The
// measurements are in the log of the rostest.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <visualization_msgs/Marker.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <iostream>
#include <mutex>
#include <string>
#include <vector>

#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "node_probe.hpp"
#include "support/long_tests.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kCameraHeight = 1.65;
constexpr std::int64_t kStartNs = 1000000000000;
constexpr std::int64_t kPeriodNs = 100000000;              // 10 Hz
constexpr std::size_t kLongRun = 36000, kShortRun = 1200;  // [frames]: an hour, two minutes
/// The drive is played forwards and backwards in turn so many times; then the images jump from its
/// end to its start.
constexpr std::size_t kPassesBetweenCuts = 9;
/// Frames before the first memory measurement that counts: in the long run all buffers are full by
/// then (the path, of 5000 poses, after about 7100 frames). Frames between two measurements.
constexpr std::size_t kWarmUpLong = 8000, kWarmUpShort = 500, kMeasureEvery = 100;
/// Largest growth of the memory per frame [bytes]: in the long run far less than a frame holds
/// (pose, features), in the short run with the fluctuations of the allocator on top.
constexpr double kMaxGrowthLong = 100, kMaxGrowthShort = 4000;

/// From a standstill to a standstill, so that it can be driven there and back.
SyntheticDrive::Options driveOptions() {
  SyntheticDrive::Options options;
  options.frames = 120;
  options.camera_height = kCameraHeight;
  options.speeds = {{0.5, 0}, {3.5, 9}, {8.4, 9}, {11.4, 0}};
  options.moving_cars = false;
  return options;
}

/// Index in the drive of the n-th image that the nodelets get. images: number of images of the
/// drive.
std::size_t imageAt(std::size_t n, std::size_t images) {
  const std::size_t pass = n / images % kPassesBetweenCuts, i = n % images;
  return pass % 2 == 0 ? i : images - 1 - i;
}

/// Subscribes, as rviz would, and keeps only the last message.
template <typename Message>
class Listener {
 public:
  using ConstPtr = typename Message::ConstPtr;
  Listener(ros::NodeHandle& handle, const std::string& topic)
      : subscriber_(handle.subscribe<Message>(topic, 100, [this](const ConstPtr& message) {
          const std::lock_guard<std::mutex> lock(mutex_);
          last_ = message;
        })) {}
  ~Listener() { subscriber_.shutdown(); }
  bool connected() const { return subscriber_.getNumPublishers() > 0; }
  ConstPtr last() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return last_;
  }

 private:
  mutable std::mutex mutex_;
  ConstPtr last_;
  ros::Subscriber subscriber_;
};

/// Adds up the steps of the metric odometry and those of the ground truth, without the jumps from
/// the end of the drive to its start.
class PathComparison {
 public:
  explicit PathComparison(const SyntheticDrive& drive) : drive_(drive) {}

  void add(const nav_msgs::Odometry& odometry) {
    const auto n =
        static_cast<std::size_t>((toNanoseconds(odometry.header.stamp) - kStartNs) / kPeriodNs);
    const std::size_t image = imageAt(n, drive_.size());
    const Eigen::Isometry3d T_o_b = fromMsg(odometry.pose.pose);
    finite_ = finite_ && areFinite(T_o_b, odometry.pose.covariance, odometry.twist.covariance,
                                   odometry.twist.twist.linear.z);
    const std::size_t advance = image > last_image_ ? image - last_image_ : last_image_ - image;
    if (poses_++ > 0 && n == last_n_ + 1 && advance <= 1) {
      path_length_ += (T_o_b.translation() - last_.translation()).norm();
      true_distance_ += (drive_.frame(image).T_c0_c.translation() -
                         drive_.frame(last_image_).T_c0_c.translation())
                            .norm();
    }
    last_ = T_o_b;
    last_n_ = n;
    last_image_ = image;
  }
  bool finite() const { return finite_; }
  double ratio() const { return path_length_ / true_distance_; }
  double trueDistance() const { return true_distance_; }
  std::size_t poses() const { return poses_; }

 private:
  const SyntheticDrive& drive_;
  Eigen::Isometry3d last_ = Eigen::Isometry3d::Identity();
  std::size_t last_n_ = 0, last_image_ = 0, poses_ = 0;
  double path_length_ = 0, true_distance_ = 0;
  bool finite_ = true;
};

/// Memory and processor time of the manager after a frame.
struct Measurement {
  std::size_t frame;
  ProcessUsage usage;
};

void print(const std::vector<Measurement>& measurements) {
  std::cout << "frames, memory [MiB], processor time per frame since the last line [ms]\n";
  const std::size_t step = std::max<std::size_t>(1, measurements.size() / 12);
  for (std::size_t k = step; k < measurements.size(); k += step) {
    const Measurement &from = measurements[k - step], &to = measurements[k];
    std::cout << to.frame << ", " << to.usage.rss_mb << ", "
              << 1e3 * (to.usage.cpu_s - from.usage.cpu_s) /
                     static_cast<double>(to.frame - from.frame)
              << "\n";
  }
}

TEST(LongRun, MemoryIsBoundedAndThePathLengthIsCorrect) {
  const bool is_long = runsLongTests();
  const std::size_t frames = is_long ? kLongRun : kShortRun;
  const SyntheticDrive drive(driveOptions());
  std::vector<sensor_msgs::ImagePtr> messages;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    messages.push_back(
        cv_bridge::CvImage({}, sensor_msgs::image_encodings::MONO8, drive.image(i)).toImageMsg());
  }

  ros::NodeHandle handle;
  ros::Publisher images = handle.advertise<sensor_msgs::Image>("image", 10);
  ros::Publisher infos = handle.advertise<sensor_msgs::CameraInfo>("camera_info", 10);
  TopicRecorder<ScaleEstimateMsg> scales(handle, "scale");
  TopicRecorder<nav_msgs::Odometry> odometry(handle, "odometry");
  Listener<VoFrameMsg> vo_frames(handle, "vo/frame");
  Listener<nav_msgs::Path> path(handle, "path");
  Listener<sensor_msgs::Image> tracks(handle, "vo/image_tracks");
  Listener<sensor_msgs::PointCloud2> points(handle, "vo/points"), ground(handle, "ground_points");
  Listener<visualization_msgs::Marker> plane(handle, "ground_plane");
  ASSERT_TRUE(waitUntil([&] {
    return images.getNumSubscribers() > 0 && infos.getNumSubscribers() > 0 && scales.connected() &&
           odometry.connected() && vo_frames.connected() && path.connected() &&
           tracks.connected() && points.connected() && ground.connected() && plane.connected();
  })) << "the nodelets did not come up";
  const NodeProbe manager("/manager");

  PathComparison comparison(drive);
  std::vector<Measurement> measurements;
  for (std::size_t n = 0; n < frames; ++n) {
    const auto image = boost::make_shared<sensor_msgs::Image>(*messages[imageAt(n, drive.size())]);
    image->header.stamp = fromNanoseconds(kStartNs + static_cast<std::int64_t>(n) * kPeriodNs);
    image->header.frame_id = "camera";
    const auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(drive.camera()));
    info->header = image->header;
    infos.publish(info);
    images.publish(image);
    ASSERT_TRUE(scales.waitForStamp(image->header.stamp)) << "frame " << n;
    for (const auto& scale : scales.take()) {
      ASSERT_TRUE(std::isfinite(scale->scale) && std::isfinite(scale->sigma)) << "frame " << n;
    }
    for (const auto& pose : odometry.take()) comparison.add(*pose);
    if ((n + 1) % kMeasureEvery == 0) measurements.push_back({n + 1, manager.usage()});
  }
  print(measurements);
  std::cout << "metric poses " << comparison.poses() << " of " << frames << ", "
            << comparison.trueDistance() << " m, odometry over ground truth " << comparison.ratio()
            << "\n";

  EXPECT_TRUE(comparison.finite());
  EXPECT_GT(comparison.poses(), frames * 8 / 10);
  EXPECT_NEAR(comparison.ratio(), 1, 0.03);
  ASSERT_TRUE(path.last());
  EXPECT_LE(path.last()->poses.size(), 5000u);  // path_max_poses
  const Measurement &warm =
                        measurements[(is_long ? kWarmUpLong : kWarmUpShort) / kMeasureEvery - 1],
                    &last = measurements.back();
  const double bytes_per_frame = (last.usage.rss_mb - warm.usage.rss_mb) * 1024 * 1024 /
                                 static_cast<double>(last.frame - warm.frame);
  std::cout << bytes_per_frame << " bytes of growth per frame\n";
  if (!kSanitized) {
    EXPECT_LT(bytes_per_frame, is_long ? kMaxGrowthLong : kMaxGrowthShort);
  }
}

}  // namespace
}  // namespace ground_scale_vo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "long_run_rostest");
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
