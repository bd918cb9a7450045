// A long drive through two pairs of nodelets in one manager. Every minute the images are black for
// two seconds, and subscribers of all outputs come and go: the memory of the manager does not grow,
// the path stays bounded, all values are finite and the scale stays correct.
//
// By default 700 frames as fast as they are processed; with GROUND_SCALE_VO_LONG (scripts/test
// --long) an hour in real time. The measurements of each tenth are in the log of the rostest.

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
#include <memory>
#include <mutex>
#include <string>
#include <utility>
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

constexpr std::int64_t kFirstStampNs = 1000000000000;
constexpr std::int64_t kPeriodNs = 100000000;             // 10 Hz
constexpr std::size_t kLongRun = 36000, kShortRun = 700;  // [frames]; long: an hour
/// Black images, in every minute.
constexpr std::size_t kMinute = 600, kBlackFirst = 300, kBlackFrames = 20;  // [frames]
/// Frames after which the subscribers come or go.
constexpr std::size_t kSubscribed = 250;
/// Frames before the first memory measurement that counts: in the long run all buffers are full by
/// then (the path, of 5000 poses, after about 7100 frames).
constexpr std::size_t kWarmUpLong = 8000, kWarmUpShort = 400;
constexpr std::size_t kTenths = 10;
/// Largest growth of the memory per frame [bytes]: in the long run far less than a frame of each
/// pair holds (pose, features), in the short run with the fluctuations of the allocator on top.
constexpr double kMaxGrowthLong = 200, kMaxGrowthShort = 8000;

/// From a standstill to a standstill, so that it can be driven there and back.
SyntheticDrive::Options reversibleDrive() {
  SyntheticDrive::Options options;
  options.frames = 120;
  options.camera_height = 1.65;  // as in the .test file
  options.speeds = {{0.5, 0}, {3.5, 9}, {8.4, 9}, {11.4, 0}};
  options.moving_cars = false;
  return options;
}

/// Index in the drive of the n-th image that the nodelets get: forwards and backwards in turn.
/// images: number of images of the drive.
std::size_t imageAt(std::size_t n, std::size_t images) {
  const std::size_t i = n % images;
  return n / images % 2 == 0 ? i : images - 1 - i;
}

bool isBlack(std::size_t n) {
  return n % kMinute >= kBlackFirst && n % kMinute < kBlackFirst + kBlackFrames;
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

/// Adds up the steps of the metric odometry and those of the ground truth, without gaps.
class PathComparison {
 public:
  explicit PathComparison(const SyntheticDrive& drive) : drive_(drive) {}

  void add(const nav_msgs::Odometry& odometry, std::size_t n) {
    const Eigen::Isometry3d T_o_b = fromMsg(odometry.pose.pose);
    finite_ = finite_ && areFinite(T_o_b, odometry.pose.covariance, odometry.twist.covariance,
                                   odometry.twist.twist.linear.z);
    if (poses_++ > 0 && n == last_n_ + 1) {
      path_length_ += (T_o_b.translation() - last_.translation()).norm();
      true_distance_ += (position(n) - position(last_n_)).norm();
    }
    last_ = T_o_b;
    last_n_ = n;
  }
  bool finite() const { return finite_; }
  std::size_t poses() const { return poses_; }
  double pathLength() const { return path_length_; }
  double trueDistance() const { return true_distance_; }

 private:
  Eigen::Vector3d position(std::size_t n) const {
    return drive_.frame(imageAt(n, drive_.size())).T_c0_c.translation();
  }

  const SyntheticDrive& drive_;
  Eigen::Isometry3d last_ = Eigen::Isometry3d::Identity();
  std::size_t last_n_ = 0, poses_ = 0;
  double path_length_ = 0, true_distance_ = 0;
  bool finite_ = true;
};

/// Subscribers as rviz has them.
struct Display {
  Display(ros::NodeHandle& handle, const std::string& ns)
      : tracks(handle, ns + "/vo/image_tracks"),
        points(handle, ns + "/vo/points"),
        ground(handle, ns + "/ground_points"),
        path(handle, ns + "/path"),
        plane(handle, ns + "/ground_plane") {}
  bool connected() const {
    return tracks.connected() && points.connected() && ground.connected() && path.connected() &&
           plane.connected();
  }
  Listener<sensor_msgs::Image> tracks;
  Listener<sensor_msgs::PointCloud2> points, ground;
  Listener<nav_msgs::Path> path;
  Listener<visualization_msgs::Marker> plane;
};

/// The n-th stamp, and the inverse.
ros::Time stampOf(std::size_t n) {
  return fromNanoseconds(kFirstStampNs + static_cast<std::int64_t>(n) * kPeriodNs);
}
std::size_t indexOf(const ros::Time& stamp) {
  return static_cast<std::size_t>((toNanoseconds(stamp) - kFirstStampNs) / kPeriodNs);
}

/// A camera on the drive and both nodelets, in one namespace, and what is measured of them.
class Pair {
 public:
  Pair(ros::NodeHandle& handle, std::string ns, const SyntheticDrive& drive)
      : comparison(drive),
        handle_(handle),
        ns_(std::move(ns)),
        info_(toCameraInfo(drive.camera())),
        images_(handle.advertise<sensor_msgs::Image>(ns_ + "/image", 10)),
        infos_(handle.advertise<sensor_msgs::CameraInfo>(ns_ + "/camera_info", 10)),
        scales_(handle, ns_ + "/scale"),
        odometry_(handle, ns_ + "/odometry"),
        arrivals_(handle.subscribe<nav_msgs::Odometry>(
            ns_ + "/odometry", 100, [this](const nav_msgs::Odometry::ConstPtr& message) {
              const std::lock_guard<std::mutex> lock(mutex_);
              if (message->header.stamp != stampOf(published_)) return;
              latencies_ms_.push_back(1e3 * (ros::WallTime::now() - published_at_).toSec());
            })) {}
  ~Pair() { arrivals_.shutdown(); }

  bool connected() const {
    return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
           scales_.connected() && odometry_.connected() && arrivals_.getNumPublishers() > 0;
  }
  void setDisplay(bool on) {
    display_.reset();
    if (on) display_ = std::make_unique<Display>(handle_, ns_);
  }
  const Display* display() const { return display_.get(); }

  void publish(std::size_t n, const sensor_msgs::Image& content) {
    const auto image = boost::make_shared<sensor_msgs::Image>(content);
    image->header.stamp = stampOf(n);
    image->header.frame_id = "camera";
    const auto info = boost::make_shared<sensor_msgs::CameraInfo>(info_);
    info->header = image->header;
    infos_.publish(info);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      published_ = n;
      published_at_ = ros::WallTime::now();
    }
    images_.publish(image);
  }
  /// Waits for the results of the frame and evaluates what has arrived.
  void collect(std::size_t n) {
    ASSERT_TRUE(scales_.waitForStamp(stampOf(n))) << ns_ << " frame " << n;
    for (const auto& scale : scales_.take()) {
      ASSERT_TRUE(std::isfinite(scale->scale) && std::isfinite(scale->sigma)) << "frame " << n;
    }
    for (const auto& pose : odometry_.take()) comparison.add(*pose, indexOf(pose->header.stamp));
  }
  /// Latencies from image to odometry since the last call [ms].
  std::vector<double> takeLatencies() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return std::exchange(latencies_ms_, {});
  }

  PathComparison comparison;

 private:
  ros::NodeHandle& handle_;
  const std::string ns_;
  const sensor_msgs::CameraInfo info_;
  ros::Publisher images_, infos_;
  TopicRecorder<ScaleEstimateMsg> scales_;
  TopicRecorder<nav_msgs::Odometry> odometry_;
  std::unique_ptr<Display> display_;
  std::mutex mutex_;
  std::size_t published_ = 0;
  ros::WallTime published_at_;
  std::vector<double> latencies_ms_;
  ros::Subscriber arrivals_;
};

/// Prints a line for each tenth of the run.
class TenthsTable {
 public:
  TenthsTable() {
    std::cout << "frames, memory [MiB], processor time per frame and pair [ms], 99th percentile of "
                 "the latency [ms], path over ground truth of each pair\n";
  }
  void add(std::size_t frames, const ProcessUsage& usage, const std::vector<Pair*>& pairs) {
    std::vector<double> latencies;
    std::string ratios;
    before_.resize(pairs.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const std::vector<double> some = pairs[k]->takeLatencies();
      latencies.insert(latencies.end(), some.begin(), some.end());
      const PathComparison& now = pairs[k]->comparison;
      ratios += ", " + std::to_string((now.pathLength() - before_[k].first) /
                                      (now.trueDistance() - before_[k].second));
      before_[k] = {now.pathLength(), now.trueDistance()};
    }
    std::sort(latencies.begin(), latencies.end());
    const double p99 = latencies.empty() ? NAN : latencies[latencies.size() * 99 / 100];
    const auto runs = static_cast<double>((frames - frames_) * pairs.size());
    std::cout << frames << ", " << usage.rss_mb << ", " << 1e3 * (usage.cpu_s - cpu_s_) / runs
              << ", " << p99 << ratios << std::endl;
    frames_ = frames;
    cpu_s_ = usage.cpu_s;
  }

 private:
  std::size_t frames_ = 0;
  double cpu_s_ = 0;
  std::vector<std::pair<double, double>> before_;  // path length, true distance of each pair [m]
};

TEST(LongRun, MemoryIsBoundedAndThePathLengthIsCorrect) {
  const bool is_long = runsLongTests();
  const std::size_t frames = is_long ? kLongRun : kShortRun;
  const std::size_t warm_up = is_long ? kWarmUpLong : kWarmUpShort;
  const SyntheticDrive drive(reversibleDrive());
  std::vector<sensor_msgs::ImagePtr> images;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    images.push_back(
        cv_bridge::CvImage({}, sensor_msgs::image_encodings::MONO8, drive.image(i)).toImageMsg());
  }
  sensor_msgs::Image black = *images.front();
  std::fill(black.data.begin(), black.data.end(), std::uint8_t{0});

  ros::NodeHandle handle;
  Pair first(handle, "", drive), second(handle, "second", drive);
  const std::vector<Pair*> pairs{&first, &second};
  first.setDisplay(true);
  ASSERT_TRUE(waitUntil([&] {
    return first.connected() && second.connected() && first.display()->connected();
  })) << "the nodelets did not come up";
  const NodeProbe manager("/manager");

  TenthsTable table;
  double warm_mb = 0;
  const ros::WallTime start = ros::WallTime::now();
  for (std::size_t n = 0; n < frames; ++n) {
    if (is_long) {
      ros::WallTime::sleepUntil(start +
                                ros::WallDuration(1e-9 * kPeriodNs * static_cast<double>(n)));
    }
    const sensor_msgs::Image& image = isBlack(n) ? black : *images[imageAt(n, images.size())];
    for (Pair* pair : pairs) pair->publish(n, image);
    for (Pair* pair : pairs) ASSERT_NO_FATAL_FAILURE(pair->collect(n));
    if (n > 0 && n % kSubscribed == 0) {
      const bool of_first = n / kSubscribed % 2 == 0;
      first.setDisplay(of_first);
      second.setDisplay(!of_first);
    }
    if (n + 1 == warm_up) warm_mb = manager.usage().rss_mb;
    if ((n + 1) % (frames / kTenths) == 0) table.add(n + 1, manager.usage(), pairs);
  }
  const double bytes_per_frame =
      (manager.usage().rss_mb - warm_mb) * 1024 * 1024 / static_cast<double>(frames - warm_up);
  std::cout << bytes_per_frame << " bytes of growth per frame\n";

  for (const Pair* pair : pairs) {
    const PathComparison& comparison = pair->comparison;
    std::cout << "metric poses " << comparison.poses() << " of " << frames << ", "
              << comparison.trueDistance() << " m\n";
    EXPECT_TRUE(comparison.finite());
    EXPECT_GT(comparison.poses(), frames * 8 / 10);
    EXPECT_LT(comparison.poses(), frames - kBlackFrames + 1);  // the losses take place
    EXPECT_NEAR(comparison.pathLength() / comparison.trueDistance(), 1, 0.03);
  }
  const Display& display = first.display() ? *first.display() : *second.display();
  ASSERT_TRUE(display.path.last());
  EXPECT_LE(display.path.last()->poses.size(), 5000u);  // path_max_poses
  if (!kSanitized) {
    EXPECT_LT(bytes_per_frame, is_long ? kMaxGrowthLong : kMaxGrowthShort);
  }
}

}  // namespace
}  // namespace ground_scale_vo
