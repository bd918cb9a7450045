// What missing images, other frame rates and crooked stamps do to the metric odometry.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::size_t kFrames = 120;
constexpr std::size_t kGap = 50;  // first missing image

/// A frame that was shown to the pipeline.
struct Shown {
  std::size_t index = 0;  ///< in the drive
  VoStatus vo_status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;
  std::optional<MetricPose> pose;
};

class TimeFaults : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    drive_ = std::make_unique<SyntheticDrive>(options(10, kFrames));
    for (std::size_t i = 0; i < kFrames; ++i) images_.push_back(drive_->image(i));
  }
  static void TearDownTestSuite() {
    drive_.reset();
    images_.clear();
  }

  static SyntheticDrive::Options options(double rate_hz, std::size_t frames) {
    SyntheticDrive::Options options;
    options.frames = static_cast<int>(frames);
    options.frame_rate_hz = rate_hz;
    options.stop_s = 0;
    return options;
  }
  static std::int64_t stampOf(std::size_t i) { return drive_->frame(i).stamp_ns; }

  static std::vector<Shown> run(const std::function<bool(std::size_t)>& is_shown,
                                const std::function<std::int64_t(std::size_t)>& stamp = stampOf) {
    OfflineRun::Options offline_options;
    offline_options.scale.camera_height = drive_->cameraHeight();
    OfflineRun offline(drive_->camera(), offline_options);
    std::vector<Shown> shown;
    for (std::size_t i = 0; i < kFrames; ++i) {
      if (!is_shown(i)) continue;
      const RunFrame& frame = offline.process(images_[i], stamp(i));
      shown.push_back({i, frame.vo_status, frame.map_id, offline.last().scale.pose});
      if (!shown.back().pose) continue;
      const MetricPose& pose = *shown.back().pose;
      EXPECT_TRUE(pose.T_o_c.matrix().allFinite() && pose.covariance.allFinite() &&
                  pose.twist_c.allFinite() && pose.twist_covariance.allFinite())
          << i;
    }
    return shown;
  }
  static bool all(std::size_t) { return true; }

  /// The ways from each metric pose to the next of the same map.
  struct Ways {
    double way = 0, true_way = 0;  ///< within maps [m]
    double worst_step = 0;         ///< largest error of one of them [m]
  };
  static Ways waysOf(const std::vector<Shown>& shown) {
    Ways ways;
    const Shown* last = nullptr;
    for (const Shown& now : shown) {
      if (!now.pose) continue;
      if (last != nullptr && last->map_id == now.map_id) {
        const double way = (now.pose->T_o_c.translation() - last->pose->T_o_c.translation()).norm();
        const double truth = trueWay(last->index, now.index);
        ways.way += way;
        ways.true_way += truth;
        ways.worst_step = std::max(ways.worst_step, std::abs(way - truth));
      }
      last = &now;
    }
    return ways;
  }
  static double trueWay(std::size_t a, std::size_t b) {
    return (drive_->frame(b).T_c0_c.translation() - drive_->frame(a).T_c0_c.translation()).norm();
  }

  static std::unique_ptr<SyntheticDrive> drive_;
  static std::vector<cv::Mat> images_;
};

std::unique_ptr<SyntheticDrive> TimeFaults::drive_;
std::vector<cv::Mat> TimeFaults::images_;

TEST_F(TimeFaults, ShortGapsAreBridgedInTheSameMap) {
  for (const std::size_t missing : {1u, 2u, 3u, 5u}) {
    const auto shown = run([&](std::size_t i) { return i < kGap || i >= kGap + missing; });
    for (const Shown& frame : shown) EXPECT_EQ(frame.map_id, 0u) << missing;
    const Ways ways = waysOf(shown);
    EXPECT_LT(std::abs(ways.way / ways.true_way - 1), 0.02) << missing;
    EXPECT_LT(ways.worst_step, 0.05 * 0.9 * static_cast<double>(missing + 1) + 0.1) << missing;
    EXPECT_TRUE(shown[kGap].pose) << missing;  // the first image after it
  }
}

// Nothing of the old view is left: the status says so, and the covariance of the next pose takes in
// what was not seen. What is measured is right before and after.
TEST_F(TimeFaults, LongGapsAreSaidAndNeverAWrongWay) {
  for (const std::size_t missing : {10u, 25u, 50u}) {
    const auto shown = run([&](std::size_t i) { return i < kGap || i >= kGap + missing; });
    bool said = false;
    std::optional<std::size_t> before, after;  // the poses on both sides of the gap
    for (std::size_t k = 0; k < shown.size(); ++k) {
      if (k >= kGap && shown[k].vo_status != VoStatus::kTracking) said = true;
      if (!shown[k].pose) continue;
      if (k < kGap) before = k;
      if (k >= kGap && !after && shown[k].map_id > 0) after = k;
      if (k >= kGap && shown[k].map_id == 0) {
        ADD_FAILURE() << "a pose in the old map after " << missing << " missing images";
      }
    }
    EXPECT_TRUE(said) << missing;
    ASSERT_TRUE(before && after) << missing;
    const MetricPose& old_pose = *shown[*before].pose;
    const MetricPose& new_pose = *shown[*after].pose;
    EXPECT_LT((new_pose.T_o_c.translation() - old_pose.T_o_c.translation()).norm(), 1e-9);
    const double unseen = trueWay(shown[*before].index, shown[*after].index);
    const double sigma = std::sqrt(new_pose.covariance.topLeftCorner<3, 3>().trace());
    EXPECT_GT(sigma, unseen / 2) << missing;
    EXPECT_EQ(new_pose.twist_c.norm(), 0) << missing;
    const Ways ways = waysOf(shown);
    EXPECT_GT(ways.true_way, 30) << missing;
    EXPECT_LT(std::abs(ways.way / ways.true_way - 1), 0.03) << missing;
  }
}

TEST_F(TimeFaults, FiveAndThirtyImagesASecond) {
  const Ways slow = waysOf(run([](std::size_t i) { return i % 2 == 0; }));
  EXPECT_GT(slow.true_way, 80);
  EXPECT_LT(std::abs(slow.way / slow.true_way - 1), 0.02);

  const SyntheticDrive fast(options(30, 90));
  OfflineRun::Options offline_options;
  offline_options.scale.camera_height = fast.cameraHeight();
  OfflineRun offline(fast.camera(), offline_options);
  std::optional<MetricPose> first;
  std::size_t first_index = 0;
  double speed_error = 0;
  for (std::size_t i = 0; i < fast.size(); ++i) {
    offline.process(fast.image(i), fast.frame(i).stamp_ns);
    const std::optional<MetricPose>& pose = offline.last().scale.pose;
    if (!pose) continue;
    if (!first) {
      first = pose;
      first_index = i;
    } else {
      speed_error =
          std::max(speed_error, std::abs(pose->twist_c.head<3>().norm() - fast.frame(i).speed));
    }
  }
  ASSERT_TRUE(first);
  EXPECT_EQ(offline.record().lostEvents(), 0u);
  const double way =
      (offline.last().scale.pose->T_o_c.translation() - first->T_o_c.translation()).norm();
  const double truth = (fast.frame(fast.size() - 1).T_c0_c.translation() -
                        fast.frame(first_index).T_c0_c.translation())
                           .norm();
  EXPECT_GT(truth, 15);
  EXPECT_LT(std::abs(way / truth - 1), 0.03);
  EXPECT_LT(speed_error, 1.5);  // [m/s] of 9
}

// Images that are stamped when they arrive, two by two: the velocity between the two of a pair is
// far too high, and must not carry the next pose away.
TEST_F(TimeFaults, BunchedStampsDoNotCarryThePoseAway) {
  for (const std::int64_t apart_ns : {1000, 1000000, 20000000}) {
    const auto shown = run(
        all, [&](std::size_t i) { return i % 2 == 1 ? stampOf(i - 1) + apart_ns : stampOf(i); });
    const Ways ways = waysOf(shown);
    EXPECT_GT(ways.true_way, 80) << apart_ns;
    EXPECT_LT(std::abs(ways.way / ways.true_way - 1), 0.02) << apart_ns;
    EXPECT_LT(ways.worst_step, 0.7) << apart_ns;
  }
}

// A bag with a pause: the images go on where they ended, the clock does not.
TEST_F(TimeFaults, APauseIsBridged) {
  for (const std::int64_t pause_s : {20, 3600}) {
    const auto shown = run(
        all, [&](std::size_t i) { return stampOf(i) + (i >= kGap ? pause_s * 1000000000 : 0); });
    const Ways ways = waysOf(shown);
    EXPECT_GT(ways.true_way, 80) << pause_s;
    EXPECT_LT(std::abs(ways.way / ways.true_way - 1), 0.02) << pause_s;
    for (const Shown& frame : shown) {
      EXPECT_EQ(frame.map_id, 0u) << pause_s;
      if (!frame.pose) continue;
      EXPECT_LT(frame.pose->twist_c.head<3>().norm(), 12) << pause_s;
      if (frame.index == kGap) {
        EXPECT_LT(frame.pose->twist_c.head<3>().norm(), 1) << pause_s;
      }
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
