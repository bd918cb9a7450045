// A long drive through both nodelets. Every minute the images are black for two seconds: the memory
// of the manager does not grow, all values are finite and the scale stays correct.
//
// By default 700 small frames as fast as they are processed; with GROUND_SCALE_VO_LONG an hour in
// real time. The measurements of each tenth are in the log of the rostest.

#include <iostream>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "manager_test.hpp"
#include "support/long_tests.hpp"

namespace gsv {
namespace {

constexpr std::int64_t kPeriodNs = 100000000;             // 10 Hz
constexpr std::size_t kLongRun = 36000, kShortRun = 700;  // [frames]; long: an hour
/// Black images, in every minute.
constexpr std::size_t kMinute = 600, kBlackFirst = 300, kBlackFrames = 20;  // [frames]
/// Frames before the first memory measurement that counts: in the long run all buffers are full by
/// then (the path, of 5000 poses, after about 7100 frames).
constexpr std::size_t kWarmUpLong = 8000, kWarmUpShort = 400;
/// Largest growth of the memory per frame [bytes]: in the long run far less than a frame holds
/// (pose, features), in the short run with the fluctuations of the allocator on top.
constexpr double kMaxGrowthLong = 200, kMaxGrowthShort = 8000;

/// From a standstill to a standstill, so that it can be driven there and back.
SyntheticDrive::Options reversibleDrive(SyntheticDrive::Options options) {
  options.frames = 120;
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

/// The n-th stamp, and the inverse.
ros::Time stampOf(std::size_t n) {
  return fromNanoseconds(1000000000000 + static_cast<std::int64_t>(n) * kPeriodNs);
}
std::size_t indexOf(const ros::Time& stamp) {
  return static_cast<std::size_t>((toNanoseconds(stamp) - toNanoseconds(stampOf(0))) / kPeriodNs);
}

/// Both nodelets on the drive, and what is measured of them.
struct LongPair : NodeletPair {
  LongPair(const ManagerClient& manager, const RenderedDrive& rendered)
      : NodeletPair(manager, rendered, ""), drive(rendered) {}

  /// Waits for the results of the frame and evaluates what has arrived.
  void collect(std::size_t n) {
    ASSERT_TRUE(waitForStamp(stampOf(n))) << "frame " << n;
    frames.clear();
    for (const auto& scale : scales.take()) {
      ASSERT_TRUE(areFinite(scale->scale, scale->sigma)) << "frame " << n;
    }
    for (const auto& pose : odometry.take()) add(*pose);
  }
  /// Adds up the steps of the metric odometry and the true ones, without gaps.
  void add(const nav_msgs::Odometry& pose) {
    const std::size_t n = indexOf(pose.header.stamp);
    const Eigen::Isometry3d T_o_b = fromMsg(pose.pose.pose);
    ASSERT_TRUE(
        areFinite(T_o_b, pose.pose.covariance, pose.twist.covariance, pose.twist.twist.linear.z));
    if (poses++ > 0 && n == last_n + 1) {
      path_length += (T_o_b.translation() - last.translation()).norm();
      true_distance += (truth(n) - truth(last_n)).norm();
    }
    last = T_o_b;
    last_n = n;
  }
  Eigen::Vector3d truth(std::size_t n) const {
    return drive.frame(imageAt(n, drive.size())).T_c0_c.translation();
  }

  const RenderedDrive& drive;
  Eigen::Isometry3d last = Eigen::Isometry3d::Identity();
  std::size_t last_n = 0, poses = 0;
  double path_length = 0, true_distance = 0;
};

class LongRun : public ManagerTest {};

TEST_F(LongRun, MemoryIsBoundedAndThePathLengthIsCorrect) {
  const bool is_long = runsLongTests();
  const std::size_t frames = is_long ? kLongRun : kShortRun;
  const std::size_t warm_up = is_long ? kWarmUpLong : kWarmUpShort;
  const RenderedDrive drive(reversibleDrive(is_long ? SyntheticDrive::Options() : smallDrive(120)));
  sensor_msgs::Image black = *drive.image(0, {});
  std::fill(black.data.begin(), black.data.end(), std::uint8_t{0});

  LongPair pair(manager_, drive);
  ASSERT_TRUE(pair.load());
  const pid_t manager = processOf(manager_.name()).value();

  double warm_mb = 0;
  const ros::WallTime start = ros::WallTime::now();
  for (std::size_t n = 0; n < frames; ++n) {
    if (is_long) {
      ros::WallTime::sleepUntil(start +
                                ros::WallDuration(1e-9 * kPeriodNs * static_cast<double>(n)));
    }
    pair.publishInfo(*drive.info(stampOf(n)));
    black.header.stamp = stampOf(n);
    if (isBlack(n)) {
      pair.publishImage(black);
    } else {
      pair.publishImage(imageAt(n, drive.size()), stampOf(n));
    }
    ASSERT_NO_FATAL_FAILURE(pair.collect(n));
    if (n + 1 == warm_up) warm_mb = processUsage(manager).rss_mb;
    if ((n + 1) % (frames / 10) == 0) {
      std::cout << "frame " << n + 1 << ": " << processUsage(manager).rss_mb
                << " MiB, path over ground truth " << pair.path_length / pair.true_distance
                << std::endl;
    }
  }
  const double bytes_per_frame = (processUsage(manager).rss_mb - warm_mb) * 1024 * 1024 /
                                 static_cast<double>(frames - warm_up);
  EXPECT_GT(pair.poses, frames * 8 / 10);
  EXPECT_LT(pair.poses, frames - kBlackFrames + 1);  // the losses take place
  EXPECT_NEAR(pair.path_length / pair.true_distance, 1, 0.03);
  if (!kSanitized) {
    EXPECT_LT(bytes_per_frame, is_long ? kMaxGrowthLong : kMaxGrowthShort);
  }
}

}  // namespace
}  // namespace gsv
