// The metric odometry with missing images, other frame rates and irregular stamps.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "simulation/scenario_evaluation.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"

namespace gsv {
namespace {

constexpr std::size_t kFrames = 120;
constexpr std::size_t kGap = 50;  // index of the first missing image

/// A frame that the pipeline has processed.
struct ProcessedFrame {
  std::size_t index = 0;  ///< in the drive
  VoStatus vo_status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;
  std::optional<MetricPose> pose;
};

SyntheticDrive::Options optionsWith(double rate_hz, std::size_t frames) {
  SyntheticDrive::Options options = mediumImages();
  options.frames = static_cast<int>(frames);
  options.frame_rate_hz = rate_hz;
  options.stop_s = 0;
  return options;
}

/// The drive of all tests but one.
const SyntheticDrive& drive() {
  static const SyntheticDrive kDrive(optionsWith(10, kFrames));
  return kDrive;
}
std::int64_t stampOf(std::size_t i) { return drive().frame(i).stamp_ns; }

/// Runs the pipeline over the images that are present, with these stamps [ns].
std::vector<ProcessedFrame> run(const std::function<bool(std::size_t)>& is_present,
                                const std::function<std::int64_t(std::size_t)>& stamp = stampOf) {
  static const std::vector<cv::Mat> kImages = renderDrive(drive());
  OfflineRun offline(drive().camera(), optionsFor(drive().cameraHeight()));
  std::vector<ProcessedFrame> frames;
  for (std::size_t i = 0; i < kFrames; ++i) {
    if (!is_present(i)) continue;
    const RunFrame& frame = offline.process(kImages[i], stamp(i));
    frames.push_back({i, frame.vo_status, frame.map_id, offline.last().scale.pose});
    if (!frames.back().pose) continue;
    const MetricPose& pose = *frames.back().pose;
    EXPECT_TRUE(pose.T_o_c.matrix().allFinite() && pose.covariance.allFinite() &&
                pose.twist_c.allFinite() && pose.twist_covariance.allFinite())
        << i;
  }
  return frames;
}
/// Without `missing` images from `gap` on.
std::function<bool(std::size_t)> isPresentAround(std::size_t gap, std::size_t missing) {
  return [=](std::size_t i) { return i < gap || i >= gap + missing; };
}
std::vector<ProcessedFrame> runWithGap(std::size_t missing) {
  return run(isPresentAround(kGap, missing));
}
bool isAlwaysPresent(std::size_t) { return true; }

double trueDistance(std::size_t a, std::size_t b) {
  return distanceBetween(drive().frame(a).T_c0_c, drive().frame(b).T_c0_c);
}

/// Sums over the steps from each metric pose to the next one of the same map.
struct PathLengths {
  double estimated = 0, ground_truth = 0;  ///< [m]
  double max_step_error = 0;               ///< [m]

  explicit PathLengths(const std::vector<ProcessedFrame>& frames) {
    const ProcessedFrame* last = nullptr;
    for (const ProcessedFrame& now : frames) {
      if (!now.pose) continue;
      if (last != nullptr && last->map_id == now.map_id) {
        const double step = distanceBetween(last->pose->T_o_c, now.pose->T_o_c);
        const double true_step = trueDistance(last->index, now.index);
        estimated += step;
        ground_truth += true_step;
        max_step_error = std::max(max_step_error, std::abs(step - true_step));
      }
      last = &now;
    }
  }
  double relativeError() const { return std::abs(estimated / ground_truth - 1); }
};

// Missing images (after ten of them, descriptor matching finds the features again), half the rate,
// and images that arrive in pairs and are stamped on arrival: the velocity within a pair is far too
// high, and must not enter the prediction of the next pose, also not over a gap.
TEST(TimeFaults, KeepTheMapAndTheDistance) {
  const auto inPairs = [](std::int64_t apart_ns) {
    return [=](std::size_t i) { return i % 2 == 1 ? stampOf(i - 1) + apart_ns : stampOf(i); };
  };
  const struct Case {
    const char* name;
    std::vector<ProcessedFrame> frames;
    double max_step_error;  ///< [m]
  } kCases[] = {            // 5 % of the distance over the gap, at 0.9 m per frame, and 0.1 m.
                {"one missing", runWithGap(1), 0.19},
                {"three missing", runWithGap(3), 0.28},
                {"five missing", runWithGap(5), 0.37},
                {"ten missing", runWithGap(10), 10},
                {"half the rate", run([](std::size_t i) { return i % 2 == 0; }), 10},
                {"pairs 1 us apart", run(isAlwaysPresent, inPairs(1000)), 0.7},
                {"pairs 20 ms apart", run(isAlwaysPresent, inPairs(20000000)), 0.7},
                {"gap within a pair", run(isPresentAround(kGap + 1, 8), inPairs(20000000)), 10},
                {"gap after a pair", run(isPresentAround(kGap, 8), inPairs(1000)), 10}};
  for (const Case& c : kCases) {
    SCOPED_TRACE(c.name);
    for (const ProcessedFrame& frame : c.frames) EXPECT_EQ(frame.map_id, 0u);
    const PathLengths lengths(c.frames);
    EXPECT_GT(lengths.ground_truth, 80);
    EXPECT_LT(lengths.relativeError(), 0.02);
    EXPECT_LT(lengths.max_step_error, c.max_step_error);
  }
}

// After the gap hardly any feature of the image before it is visible. The status reports this, and
// the unobserved motion is bridged. All steps are accurate, also one to a pose that is found in the
// old map.
TEST(TimeFaults, LongGapsAreReportedWithoutFalseMotion) {
  for (const std::size_t missing : {25u, 50u}) {
    SCOPED_TRACE(missing);
    const auto frames = runWithGap(missing);
    bool is_reported = false;
    std::optional<std::size_t> before, after;  // the poses on both sides of the gap
    for (std::size_t k = 0; k < frames.size(); ++k) {
      if (k >= kGap && frames[k].vo_status != VoStatus::kTracking) is_reported = true;
      if (!frames[k].pose) continue;
      if (k < kGap) before = k;
      if (k >= kGap && !after && frames[k].map_id > 0) after = k;
    }
    EXPECT_TRUE(is_reported);
    ASSERT_TRUE(before && after);
    const MetricPose& old_pose = *frames[*before].pose;
    const MetricPose& new_pose = *frames[*after].pose;
    // The gap is bridged with the velocities before and after it.
    const double bridged = distanceBetween(old_pose.T_o_c, new_pose.T_o_c);
    const double unobserved = trueDistance(frames[*before].index, frames[*after].index);
    const double sigma = std::sqrt(new_pose.covariance.topLeftCorner<3, 3>().trace());
    EXPECT_NEAR(bridged, unobserved, std::min(2 * sigma, 0.3 * unobserved));
    EXPECT_NEAR(new_pose.twist_c.head<3>().norm(), 9, 1.5);
    const PathLengths lengths(frames);
    EXPECT_GT(lengths.ground_truth, 30);
    EXPECT_LT(lengths.relativeError(), 0.03);
    EXPECT_LT(lengths.max_step_error, 0.05 * 0.9 * static_cast<double>(missing + 1));
  }
}

TEST(TimeFaults, ThirtyImagesPerSecondGiveTheSameDistanceAndSpeed) {
  const SyntheticDrive fast(optionsWith(30, 90));
  OfflineRun offline(fast.camera(), optionsFor(fast.cameraHeight()));
  Eigen::Isometry3d T_o_first = Eigen::Isometry3d::Identity(), T_c0_first = T_o_first;
  bool has_pose = false;
  for (std::size_t i = 0; i < fast.size(); ++i) {
    offline.process(fast.image(i), fast.frame(i).stamp_ns);
    const std::optional<MetricPose>& pose = offline.last().scale.pose;
    if (!pose) continue;
    if (has_pose) {
      EXPECT_NEAR(pose->twist_c.head<3>().norm(), fast.frame(i).speed, 1.5) << i;
      continue;
    }
    has_pose = true;
    T_o_first = pose->T_o_c;
    T_c0_first = fast.frame(i).T_c0_c;
  }
  ASSERT_TRUE(has_pose && offline.last().scale.pose);
  EXPECT_EQ(offline.record().lostEvents(), 0u);
  const double true_distance = distanceBetween(T_c0_first, fast.frame(fast.size() - 1).T_c0_c);
  EXPECT_GT(true_distance, 15);
  EXPECT_NEAR(distanceBetween(T_o_first, offline.last().scale.pose->T_o_c), true_distance,
              0.03 * true_distance);
}

// A bag that was paused while recording: the images continue where they stopped, the clock does
// not.
TEST(TimeFaults, APauseIsBridged) {
  for (const std::int64_t pause_s : {20, 3600}) {
    SCOPED_TRACE(pause_s);
    const auto frames = run(isAlwaysPresent, [&](std::size_t i) {
      return stampOf(i) + (i >= kGap ? pause_s * 1000000000 : 0);
    });
    const PathLengths lengths(frames);
    EXPECT_GT(lengths.ground_truth, 80);
    EXPECT_LT(lengths.relativeError(), 0.02);
    for (const ProcessedFrame& frame : frames) {
      EXPECT_EQ(frame.map_id, 0u);
      if (!frame.pose) continue;
      EXPECT_LT(frame.pose->twist_c.head<3>().norm(), 12);
      if (frame.index == kGap) {
        EXPECT_LT(frame.pose->twist_c.head<3>().norm(), 1);
      }
    }
  }
}

}  // namespace
}  // namespace gsv
