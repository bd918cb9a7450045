#include "ground_scale_vo/vo/visual_odometry.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "ground_scale_vo/simulation/fault_drives.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "ground_scale_vo/vo/exposure.hpp"
#include "support/drive_run.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::angleBetween;
using test::pose;

/// Outputs of all frames of a drive.
struct DriveRun {
  std::vector<VisualOdometry::Output> outputs;

  const VoFrame& frame(std::size_t i) const { return outputs[i].frame; }
};

std::vector<cv::Mat> imagesOf(const SyntheticDrive& drive) {
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) images.push_back(drive.image(i));
  return images;
}

/// Runs over the images, which are the first ones of the drive.
DriveRun run(const SyntheticDrive& drive, const std::vector<cv::Mat>& images,
             const VisualOdometry::Options& options = {}) {
  VisualOdometry odometry(drive.camera(), options);
  DriveRun result;
  for (std::size_t i = 0; i < images.size(); ++i) {
    result.outputs.push_back(odometry.process(images[i], drive.frame(i).stamp_ns));
  }
  return result;
}
DriveRun run(const SyntheticDrive& drive, const VisualOdometry::Options& options = {}) {
  return run(drive, imagesOf(drive), options);
}

SyntheticDrive::Options drive(int frames) {
  SyntheticDrive::Options options;
  options.frames = frames;
  return options;
}

/// The default drive, which several tests share: an image is rendered when it is first used.
constexpr int kSharedFrames = 120;
const SyntheticDrive& sharedDrive() {
  static const SyntheticDrive shared(drive(kSharedFrames));
  return shared;
}
const cv::Mat& sharedImage(std::size_t i) {
  static std::vector<cv::Mat> images(kSharedFrames);
  if (images.at(i).empty()) images[i] = sharedDrive().image(i);
  return images[i];
}
std::vector<cv::Mat> sharedImages(std::size_t count) {
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < count; ++i) images.push_back(sharedImage(i));
  return images;
}

/// In small images and without a stop.
SyntheticDrive::Options smallDrive(int frames) {
  SyntheticDrive::Options options = smallImages();
  options.frames = frames;
  options.stop_s = 0;
  return options;
}

/// The same on a straight, flat road without other moving vehicles.
SyntheticDrive::Options straightDrive(int frames) {
  SyntheticDrive::Options options = smallDrive(frames);
  options.curvature = options.slope = 0;
  options.moving_cars = false;
  return options;
}

/// True metres per VO unit over the tracked frames [from, to).
double scaleOver(const SyntheticDrive& ground_truth, const DriveRun& run, std::size_t from,
                 std::size_t to) {
  double metres = 0, units = 0;
  for (std::size_t i = from + 1; i < to; ++i) {
    metres += (ground_truth.frame(i).T_c0_c.translation() -
               ground_truth.frame(i - 1).T_c0_c.translation())
                  .norm();
    units += (run.frame(i).T_w_c.translation() - run.frame(i - 1).T_w_c.translation()).norm();
  }
  return metres / units;
}

/// First frame of the standstill that follows the start, and the first frame after it.
std::pair<std::size_t, std::size_t> standstill(const SyntheticDrive& ground_truth) {
  std::size_t begin = 10;
  while (begin < ground_truth.size() && ground_truth.frame(begin).speed > 0) ++begin;
  std::size_t end = begin;
  while (end < ground_truth.size() && ground_truth.frame(end).speed == 0) ++end;
  return {begin, end};
}

/// The image that the camera would take after a turn by `yaw` [rad] to the right; black where the
/// scene is unknown.
cv::Mat turned(const cv::Mat& image, const PinholeCamera& camera, double yaw) {
  const cv::Matx33d K(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const Eigen::Matrix3d R = pose({0, -yaw, 0}, {0, 0, 0}).linear();
  const cv::Matx33d turn(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1),
                         R(2, 2));
  cv::Mat result;
  cv::warpPerspective(image, result, K * turn * K.inv(), image.size(), cv::INTER_CUBIC);
  return result;
}

// Curves, a slope, a car ahead and oncoming ones, and a stop.
TEST(VisualOdometry, followsTheSyntheticDrive) {
  const SyntheticDrive& ground_truth = sharedDrive();
  const DriveRun result = run(ground_truth, sharedImages(ground_truth.size()));
  std::size_t first = 0;
  while (result.frame(first).status != VoStatus::kTracking) ++first;
  ASSERT_LT(first, 10u);
  ASSERT_EQ(result.outputs[first].start.front().sequence, 0u);
  ASSERT_EQ(result.outputs[first].start.size(), first + 1);
  EXPECT_TRUE(result.frame(first).keyframe);
  EXPECT_EQ(result.frame(first).map_start.stamp_ns, ground_truth.frame(0).stamp_ns);
  EXPECT_EQ(result.frame(0).map_start.stamp_ns, 0);
  const double scale = scaleOver(ground_truth, result, first, ground_truth.size());
  for (const auto& start : result.outputs[first].start) {
    const Eigen::Isometry3d& T = ground_truth.frame(start.sequence).T_c0_c;
    EXPECT_LT(angleBetween(start.T_w_c, T), 0.005) << start.sequence;
    EXPECT_LT((scale * start.T_w_c.translation() - T.translation()).norm(), 0.1) << start.sequence;
  }
  for (std::size_t i = first; i < ground_truth.size(); ++i) {
    const VoFrame& frame = result.frame(i);
    ASSERT_EQ(frame.status, VoStatus::kTracking) << i;
    EXPECT_EQ(frame.map_id, 0u);
    const Eigen::Isometry3d& T = ground_truth.frame(i).T_c0_c;
    EXPECT_LT(angleBetween(frame.T_w_c, T), 0.01) << i;
    const double distance = std::max(10.0, T.translation().norm());
    EXPECT_LT((scale * frame.T_w_c.translation() - T.translation()).norm(), 0.04 * distance) << i;
  }
}

TEST(VisualOdometry, featuresHaveTheirPointsAndAreOrderedById) {
  const DriveRun result = run(sharedDrive(), sharedImages(25));
  const VoFrame& frame = result.outputs.back().frame;
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  std::vector<double> error;
  std::uint32_t oldest = 0;  // [frames]
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const TrackedFeature& feature = frame.features[i];
    if (i > 0) {
      EXPECT_LT(frame.features[i - 1].id, feature.id);
    }
    if (!feature.has_point) continue;
    ASSERT_GT(feature.p_c.z(), 0);
    EXPECT_GT(feature.depth_sigma, 0);
    EXPECT_LT(feature.age, 25u);
    oldest = std::max(oldest, feature.age);
    error.push_back(
        (frame.camera.project(feature.p_c.cast<double>()) - feature.u.cast<double>()).norm());
  }
  EXPECT_GT(oldest, 15u);
  ASSERT_GT(error.size(), 150u);
  std::sort(error.begin(), error.end());
  EXPECT_LT(error[error.size() / 2], 0.8);

  const auto& times = result.outputs.back().times;
  for (const double stage : {times.pyramid, times.track, times.align, times.pose}) {
    EXPECT_GT(stage, 0);
  }
  EXPECT_LE(times.pyramid + times.track + times.align + times.pose, times.total);
}

/// Expects that no feature is rejected twice, or rejected and yet in the frame.
void expectConsistentRejections(const VisualOdometry::Output& output) {
  std::set<std::uint64_t> ids;
  for (const RejectedFeature& rejected : output.rejected) {
    EXPECT_TRUE(ids.insert(rejected.id).second) << "twice in frame " << output.frame.sequence;
  }
  for (const TrackedFeature& feature : output.frame.features) {
    EXPECT_EQ(ids.count(feature.id), 0u)
        << "rejected, yet a feature of frame " << output.frame.sequence;
  }
}

// From frame 12 on, an inserted texture covers a part of the image and moves up, unlike the static
// scene.
TEST(VisualOdometry, rejectedFeaturesAreReportedAndNotInTheFrame) {
  SyntheticDrive::Options options = drive(24);
  options.curvature = 0;
  const SyntheticDrive ground_truth(options);
  const auto moving_region = [](std::size_t i) {
    return cv::Rect(500, 170 - 6 * static_cast<int>(i), 120, 70);
  };
  cv::Mat region_texture(70, 120, CV_8UC1);
  cv::RNG(5).fill(region_texture, cv::RNG::UNIFORM, 30, 220);
  cv::GaussianBlur(region_texture, region_texture, {}, 2);
  cv::normalize(region_texture, region_texture, 30, 220, cv::NORM_MINMAX);

  constexpr std::size_t kFirst = 12;
  VisualOdometry odometry(ground_truth.camera(), {});
  // Features on the texture that are not found when it appears, and outliers while it moves.
  std::size_t covered = 0, outliers = 0;
  for (std::size_t i = 0; i < ground_truth.size(); ++i) {
    cv::Mat image = ground_truth.image(i);
    if (i >= kFirst) region_texture.copyTo(image(moving_region(i)));
    const VisualOdometry::Output output = odometry.process(image, ground_truth.frame(i).stamp_ns);
    expectConsistentRejections(output);
    for (const RejectedFeature& rejected : output.rejected) {
      const bool in_region = moving_region(i).contains(cv::Point2f(rejected.u.x(), rejected.u.y()));
      const bool outlier = rejected.reason == RejectReason::kOutlier;
      covered += i == kFirst && in_region && !outlier;
      outliers += i > kFirst && in_region && outlier;
    }
    if (i >= kFirst) {
      EXPECT_EQ(output.frame.status, VoStatus::kTracking) << i;
    }
  }
  EXPECT_GT(covered, 10u);
  EXPECT_GT(outliers, 30u);
}

// A part of the image is displaced in some images: its features are outliers there.
TEST(VisualOdometry, onlyConsecutiveOutliersEndAFeature) {
  SyntheticDrive::Options drive_options = straightDrive(25);
  drive_options.speed = 4;
  const SyntheticDrive ground_truth(drive_options);
  const std::vector<cv::Mat> images = imagesOf(ground_truth);
  const cv::Rect part(140, 45, 200, 70), inner(160, 55, 160, 50);
  constexpr std::size_t kFirst = 12;
  const auto survivors = [&](const std::set<std::size_t>& displaced, int max_outlier_frames) {
    VisualOdometry::Options options;
    options.max_outlier_frames = max_outlier_frames;
    VisualOdometry odometry(ground_truth.camera(), options);
    std::set<std::uint64_t> ids;
    std::size_t last = 0;
    for (std::size_t i = 0; i < images.size(); ++i) {
      cv::Mat image = images[i].clone();
      if (displaced.count(i)) images[i](part - cv::Point(4, 0)).copyTo(image(part));
      const VoFrame frame = odometry.process(image, ground_truth.frame(i).stamp_ns).frame;
      last = 0;
      for (const TrackedFeature& feature : frame.features) {
        if (!feature.has_point) continue;
        const bool inside = inner.contains(cv::Point2f(feature.u.x(), feature.u.y()));
        if (i == kFirst && inside) ids.insert(feature.id);
        last += ids.count(feature.id);
      }
    }
    return static_cast<double>(last);
  };
  const std::set<std::size_t> single{13, 15, 17, 19, 21};
  const double all = survivors({}, 1);
  ASSERT_GT(all, 20);
  EXPECT_GT(survivors(single, 1), 0.7 * all);
  EXPECT_LT(survivors(single, 0), 0.2 * all);
  EXPECT_LT(survivors({13, 14, 15, 16, 17}, 1), 0.2 * all);
}

/// [relative] the median depth_sigma of the points that are younger than this [frames].
double medianRelativeSigma(const VoFrame& frame, std::uint32_t max_age) {
  std::vector<double> sigmas;
  for (const TrackedFeature& feature : frame.features) {
    if (!feature.has_point || feature.age > max_age) continue;
    sigmas.push_back(feature.depth_sigma / feature.p_c.z());
  }
  return median(sigmas);
}

// Neighbouring points have errors in common, which their sigmas do not contain.
TEST(VisualOdometry, depthSigmaIsHalfTheErrorOfPointsOnTheRoad) {
  SyntheticDrive::Options drive_options = straightDrive(45);
  drive_options.shadows = false;
  const SyntheticDrive ground_truth(drive_options);
  const DriveRun result = run(ground_truth);
  constexpr std::size_t kFirst = 15;
  const double scale = scaleOver(ground_truth, result, kFirst, ground_truth.size());
  std::vector<double> errors;  // in units of their sigma
  for (std::size_t i = kFirst; i < ground_truth.size(); ++i) {
    const VoFrame& frame = result.frame(i);
    const SyntheticDrive::Frame& truth = ground_truth.frame(i);
    for (const TrackedFeature& feature : frame.features) {
      const Eigen::Vector3d ray = frame.camera.ray(feature.u.cast<double>());
      const bool on_road = ray.y() > 0.1 && std::abs(ray.x()) < ray.y();
      if (!feature.has_point || !on_road) continue;
      const double z = feature.p_c.z(), true_z = -truth.height / truth.n_c.dot(ray) / scale;
      errors.push_back(std::abs(1 / z - 1 / true_z) * z * z / feature.depth_sigma);
    }
  }
  ASSERT_GT(errors.size(), 150u);
  const double sigma = 1.48 * median(errors);
  EXPECT_GT(sigma, 1.1);
  EXPECT_LT(sigma, 2.8);
}

/// Share of the features without a point that are outliers of the next frame, of all frames from
/// this one on.
double outliersWithoutAPoint(const DriveRun& run, std::size_t first) {
  std::size_t outliers = 0, all = 0;
  for (std::size_t i = first; i < run.outputs.size(); ++i) {
    std::set<std::uint64_t> without_point;
    for (const TrackedFeature& feature : run.frame(i - 1).features) {
      if (!feature.has_point) without_point.insert(feature.id);
    }
    all += without_point.size();
    for (const RejectedFeature& rejected : run.outputs[i].rejected) {
      outliers += rejected.reason == RejectReason::kOutlier && without_point.count(rejected.id);
    }
  }
  return static_cast<double>(outliers) / static_cast<double>(all);
}

// The part of the flow that the rotation explains adds nothing to the sigma of a tracked feature.
TEST(VisualOdometry, aTurnDoesNotIncreaseTheSigmas) {
  const SyntheticDrive ground_truth(straightDrive(26));
  VisualOdometry::Options options;
  options.alignment.min_correlation = 1;  // none is aligned
  std::vector<cv::Mat> images = imagesOf(ground_truth);
  constexpr std::uint32_t kTurning = 13;  // [frames]
  const VoFrame straight = run(ground_truth, images, options).outputs.back().frame;
  for (std::uint32_t i = 0; i <= kTurning; ++i) {
    cv::Mat& image = images[images.size() - 1 - kTurning + i];
    image = turned(image, ground_truth.camera(), 0.02 * i);
  }
  const DriveRun result = run(ground_truth, images, options);
  const VoFrame& turning = result.outputs.back().frame;
  EXPECT_LT(medianRelativeSigma(turning, kTurning), 1.6 * medianRelativeSigma(straight, kTurning));
  // It does not move them off their epipolar lines, either.
  EXPECT_LT(outliersWithoutAPoint(result, images.size() - kTurning), 0.1);
}

TEST(VisualOdometry, standstillKeepsPoseAndMap) {
  SyntheticDrive::Options options = smallDrive(130);
  options.stop_at_m = 25;
  options.stop_s = 5;
  options.moving_cars = true;
  options.slope = 0;
  const SyntheticDrive ground_truth(options);
  const DriveRun result = run(ground_truth);
  const auto [begin, end] = standstill(ground_truth);
  ASSERT_GE(end - begin, 50u);
  ASSERT_LT(end + 20, ground_truth.size());
  const double scale = scaleOver(ground_truth, result, 10, begin);
  for (std::size_t i = begin; i < ground_truth.size(); ++i) {
    ASSERT_EQ(result.frame(i).status, VoStatus::kTracking) << i;
    EXPECT_EQ(result.frame(i).map_id, 0u);
    if (i >= end) continue;
    const Eigen::Vector3d moved =
        result.frame(i).T_w_c.translation() - result.frame(begin).T_w_c.translation();
    EXPECT_LT(scale * moved.norm(), 0.05) << i;
  }
  EXPECT_NEAR(scaleOver(ground_truth, result, end, ground_truth.size()) / scale, 1, 0.03);

  // A standstill counts as one image, apart from keyframes and noise.
  std::map<std::uint64_t, std::uint32_t> age;
  for (const TrackedFeature& feature : result.frame(begin + 3).features)
    age[feature.id] = feature.age;
  std::uint32_t keyframes = 0, kept = 0;
  for (std::size_t i = begin + 3; i < end; ++i) keyframes += result.frame(i).keyframe;
  for (const TrackedFeature& feature : result.frame(end - 1).features) {
    const auto known = age.find(feature.id);
    if (known == age.end()) continue;
    ++kept;
    EXPECT_LE(feature.age, known->second + keyframes + 1);
  }
  EXPECT_GT(kept, 100u);
  EXPECT_LT(keyframes, 10u);
}

// Features are lost at a standstill in noisy images at night; here, each image becomes a keyframe.
// Keyframes at one place have no baseline: if they displaced all others, the scale of the map would
// be undetermined.
TEST(VisualOdometry, keyframesAtAStandstillKeepTheScaleOfTheMap) {
  SyntheticDrive::Options drive_options = smallDrive(105);
  drive_options.stop_at_m = 22;
  drive_options.stop_s = 3;
  const SyntheticDrive ground_truth(drive_options);
  VisualOdometry::Options options;
  options.keyframe_min_tracked = 1;
  options.standstill_flow = 0;
  const DriveRun result = run(ground_truth, options);
  const auto [begin, end] = standstill(ground_truth);
  ASSERT_GE(end - begin, 30u);
  ASSERT_LT(end + 20, ground_truth.size());
  int keyframes = 0;
  for (std::size_t i = begin; i < end; ++i) keyframes += result.frame(i).keyframe;
  ASSERT_GT(keyframes, options.map.keyframes);
  EXPECT_NEAR(scaleOver(ground_truth, result, end, ground_truth.size()) /
                  scaleOver(ground_truth, result, 10, begin),
              1, 0.03);
}

TEST(VisualOdometry, initialisesAfterAStandstillAtTheStart) {
  VisualOdometry odometry(sharedDrive().camera(), {});
  constexpr std::size_t kAtRest = 10;  // [frames]
  std::int64_t stamp = 0;
  for (std::size_t i = 0; i < kAtRest; ++i, stamp += 100'000'000) {
    cv::Mat noise(sharedImage(0).size(), CV_16SC1), image;
    cv::RNG(i).fill(noise, cv::RNG::NORMAL, 0, 2);
    cv::add(sharedImage(0), noise, image, {}, CV_8U);
    EXPECT_EQ(odometry.process(image, stamp).frame.status, VoStatus::kInitialising);
  }
  VisualOdometry::Output output;
  std::size_t i = 1;
  do {
    output = odometry.process(sharedImage(i++), stamp);
    stamp += 100'000'000;
  } while (output.frame.status == VoStatus::kInitialising && i < 30);
  ASSERT_EQ(output.frame.status, VoStatus::kTracking);
  EXPECT_EQ(output.start.front().sequence, 0u);
  ASSERT_GT(output.start.size(), kAtRest);
  // The frames at rest have the pose of the first.
  for (std::size_t k = 0; k < kAtRest; ++k) {
    EXPECT_LT((output.start[k].T_w_c.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-9) << k;
  }
}

// A slow start: several images before the parallax suffices.
TEST(VisualOdometry, theFramesBeforeTheFirstMapHaveTheirPoses) {
  SyntheticDrive::Options options = straightDrive(30);
  options.speed = 1;
  const SyntheticDrive ground_truth(options);
  VisualOdometry odometry(ground_truth.camera(), {});
  std::vector<VisualOdometry::StartPose> start;
  for (std::size_t i = 0; i < ground_truth.size() && start.empty(); ++i) {
    start = odometry.process(ground_truth.image(i), ground_truth.frame(i).stamp_ns).start;
  }
  ASSERT_GE(start.size(), 5u);
  const auto truth = [&](std::size_t i) { return ground_truth.frame(i).T_c0_c; };
  const double metres = truth(start.size() - 1).translation().norm();
  const double scale = metres / start.back().T_w_c.translation().norm();
  for (std::size_t i = 0; i < start.size(); ++i) {
    EXPECT_EQ(start[i].sequence, i);
    EXPECT_EQ(start[i].stamp_ns, ground_truth.frame(i).stamp_ns);
    const Eigen::Vector3d position = scale * start[i].T_w_c.translation();
    EXPECT_LT((position - truth(i).translation()).norm(), 0.05 * metres) << i;
    EXPECT_LT(angleBetween(start[i].T_w_c, truth(i)), 0.005) << i;
  }
}

// A dark image is no reason to begin anew.
TEST(VisualOdometry, blackImagesDoNotEndAnInitialisation) {
  const SyntheticDrive ground_truth(smallDrive(20));
  std::vector<cv::Mat> images = imagesOf(ground_truth);
  const std::set<std::uint32_t> black{1, 2};
  for (const std::uint32_t i : black) images[i] = cv::Mat::zeros(images[i].size(), CV_8UC1);
  const DriveRun result = run(ground_truth, images);
  std::size_t first = 0;
  while (first < 20 && result.frame(first).status != VoStatus::kTracking) ++first;
  ASSERT_LT(first, 12u);
  EXPECT_EQ(result.outputs[first].start.front().sequence, 0u);
  for (const auto& start : result.outputs[first].start) EXPECT_EQ(black.count(start.sequence), 0u);
}

TEST(VisualOdometry, pureRotationStartsNoMap) {
  const PinholeCamera& camera = sharedDrive().camera();
  VisualOdometry odometry(camera, {});
  for (int i = 0; i < 25; ++i) {
    const cv::Mat rotated = turned(sharedImage(0), camera, 0.01 * i);
    EXPECT_EQ(odometry.process(rotated, i * 100'000'000LL).frame.status, VoStatus::kInitialising)
        << i;
  }
}

// Between the first two images the camera turns by 15 degrees.
TEST(VisualOdometry, aLargeRotationDoesNotEndAnInitialisation) {
  const PinholeCamera& camera = sharedDrive().camera();
  VisualOdometry odometry(camera, {});
  VisualOdometry::Output output;
  for (std::size_t i = 0; i < 15 && output.start.empty(); ++i) {
    const cv::Mat& image = sharedImage(i);
    output = odometry.process(i == 0 ? image : turned(image, camera, 0.26),
                              sharedDrive().frame(i).stamp_ns);
    expectConsistentRejections(output);
  }
  ASSERT_FALSE(output.start.empty());
  EXPECT_EQ(output.start.front().sequence, 0u);
}

// The camera turns on the spot by 55 degrees, so that most of the first image leaves the view,
// and then drives on.
TEST(VisualOdometry, aTurnBeforeTheFirstMapIsKnown) {
  SyntheticDrive::Options options = drive(10);
  options.moving_cars = false;
  const SyntheticDrive ground_truth(options);
  const std::vector<cv::Mat> images = imagesOf(ground_truth);
  VisualOdometry odometry(ground_truth.camera(), {});
  constexpr int kTurning = 25;
  constexpr double kYawPerFrame = 0.04;
  const auto yaw = [](int i) { return kYawPerFrame * std::min(i - kTurning / 2, kTurning / 2); };
  VoFrame frame;
  Eigen::Isometry3d T_w_c_at_start = Eigen::Isometry3d::Identity();
  int start = 0;
  for (int i = 0; i < kTurning + 9 && frame.status != VoStatus::kTracking; ++i) {
    const auto n = static_cast<std::size_t>(std::max(0, i - kTurning + 1));
    const auto output =
        odometry.process(turned(images[n], ground_truth.camera(), yaw(i)), i * 100'000'000LL);
    frame = output.frame;
    start = i;
    if (!output.start.empty()) T_w_c_at_start = output.start.back().T_w_c;
  }
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  EXPECT_GE(start, kTurning);
  const Eigen::Matrix3d true_rotation =
      pose({0, yaw(0), 0}, {0, 0, 0}).linear().transpose() *
      ground_truth.frame(static_cast<std::size_t>(start - kTurning + 1)).T_c0_c.linear() *
      pose({0, yaw(start), 0}, {0, 0, 0}).linear();
  const Eigen::Matrix3d rotation = frame.map_start.R_previous_w * T_w_c_at_start.linear();
  const double error = Eigen::AngleAxisd(rotation.transpose() * true_rotation).angle();
  EXPECT_LT(frame.map_start.rotation_sigma, 0.02);
  EXPECT_LT(error, 0.015);
}

/// depth_sigma over depth in b relative to that in a: the median of the points in both frames that
/// are in the left or right half of image b.
double medianRatioOfSigmas(const VoFrame& a, const VoFrame& b, bool left) {
  std::map<std::uint64_t, double> in_a;
  for (const TrackedFeature& feature : a.features) {
    if (feature.has_point) in_a[feature.id] = feature.depth_sigma / feature.p_c.z();
  }
  std::vector<double> ratios;
  for (const TrackedFeature& feature : b.features) {
    const auto found = in_a.find(feature.id);
    if (!feature.has_point || found == in_a.end() || (feature.p_c.x() < 0) != left) continue;
    ratios.push_back(feature.depth_sigma / feature.p_c.z() / found->second);
  }
  return median(ratios);
}

// Between two images the camera turns by 15 degrees, as at 3 Hz in a junction.
TEST(VisualOdometry, aLargeRotationKeepsTheMap) {
  const SyntheticDrive& ground_truth = sharedDrive();
  VisualOdometry odometry(ground_truth.camera(), {});
  constexpr double kYaw = 0.26;
  VoFrame before, after;
  for (std::size_t i = 0; i < 20; ++i) {
    const cv::Mat& image = sharedImage(i);
    before = after;
    const VisualOdometry::Output output =
        odometry.process(i < 15 ? image : turned(image, ground_truth.camera(), kYaw),
                         ground_truth.frame(i).stamp_ns);
    expectConsistentRejections(output);
    after = output.frame;
    if (i < 10) continue;
    ASSERT_EQ(after.status, VoStatus::kTracking) << i;
    EXPECT_EQ(after.map_id, 0u) << i;
    if (i == 15) {
      EXPECT_NEAR(angleBetween(before.T_w_c, after.T_w_c), kYaw, 0.03);
      // A rotation does not change the relative error of a point, which is along its ray.
      EXPECT_NEAR(
          medianRatioOfSigmas(before, after, true) / medianRatioOfSigmas(before, after, false), 1,
          0.1);
    }
  }
}

TEST(VisualOdometry, blackFramesAreLostAndTrackingResumes) {
  SyntheticDrive::Options options = smallDrive(90);
  options.black_first = 40;
  options.black_frames = 10;
  const SyntheticDrive ground_truth(options);
  const DriveRun result = run(ground_truth);
  ASSERT_EQ(result.frame(39).status, VoStatus::kTracking);
  for (std::size_t i = 40; i < 50; ++i) EXPECT_EQ(result.frame(i).status, VoStatus::kLost) << i;
  std::size_t back = 50;  // first tracked frame after the black ones
  while (back < ground_truth.size() && result.frame(back).status != VoStatus::kTracking) ++back;
  EXPECT_LT(back, 60u);
  for (const TrackedFeature& feature : result.frame(back).features) {
    if (!feature.has_point) continue;
    const Eigen::Vector2d projection = options.camera.project(feature.p_c.cast<double>());
    EXPECT_LT((projection - feature.u.cast<double>()).norm(), 2) << "is wrong after the gap";
  }
  for (std::size_t i = back; i < ground_truth.size(); ++i) {
    EXPECT_EQ(result.frame(i).status, VoStatus::kTracking) << i;
  }
  const std::size_t last = ground_truth.size() - 1;
  const Eigen::Isometry3d moved = result.frame(back).T_w_c.inverse() * result.frame(last).T_w_c;
  const Eigen::Isometry3d true_moved =
      ground_truth.frame(back).T_c0_c.inverse() * ground_truth.frame(last).T_c0_c;
  EXPECT_LT(angleBetween(moved, true_moved), 0.01);
  EXPECT_GT(moved.translation().normalized().dot(true_moved.translation().normalized()),
            std::cos(0.03));
}

TEST(VisualOdometry, aBlackoutKeepsMapAndScale) {
  SyntheticDrive::Options options = drive(70);
  options.stop_s = 0;
  options.moving_cars = false;
  options.black_first = 30;
  options.black_frames = 15;
  const SyntheticDrive ground_truth(options);
  const DriveRun result = run(ground_truth);
  std::size_t back = 45;
  while (back < ground_truth.size() && result.frame(back).status != VoStatus::kTracking) ++back;
  ASSERT_LT(back, 50u);
  EXPECT_EQ(result.frame(69).map_id, 0u);
  const double scale = scaleOver(ground_truth, result, 12, 30);
  EXPECT_NEAR(scaleOver(ground_truth, result, back, 70) / scale, 1, 0.03);
  const double gap =
      scale *
      (result.frame(back).T_w_c.translation() - result.frame(29).T_w_c.translation()).norm();
  const double true_gap =
      (ground_truth.frame(back).T_c0_c.translation() - ground_truth.frame(29).T_c0_c.translation())
          .norm();
  EXPECT_NEAR(gap / true_gap, 1, 0.03);
}

/// A drive of this number of frames, of which 45 to 54 are black. The camera turns by 20 degrees in
/// them.
SyntheticDrive::Options blackoutInATurn(int frames) {
  SyntheticDrive::Options options = smallDrive(frames);
  options.random_seed = 2;
  options.speed = 6;
  options.curvature = 0.06;
  options.slope = 0;
  options.black_first = 45;
  options.black_frames = 10;
  return options;
}

TEST(VisualOdometry, aBlackoutInATurnKeepsMapAndHeading) {
  const SyntheticDrive ground_truth(blackoutInATurn(56));
  const DriveRun result = run(ground_truth);
  constexpr std::size_t kBefore = 44, kBack = 55;
  expectConsistentRejections(result.outputs[kBack]);
  for (const std::size_t i : {kBefore, kBack}) {
    ASSERT_EQ(result.frame(i).status, VoStatus::kTracking) << i;
    ASSERT_EQ(result.frame(i).map_id, 0u) << i;
  }
  // A feature that was not found is reported where it was, an outlier where it is now.
  std::map<std::uint64_t, Eigen::Vector2f> before;
  for (const TrackedFeature& feature : result.frame(kBefore).features)
    before[feature.id] = feature.u;
  std::size_t outliers = 0;
  for (const RejectedFeature& rejected : result.outputs[kBack].rejected) {
    if (before.count(rejected.id) == 0) continue;
    const bool outlier = rejected.reason == RejectReason::kOutlier;
    EXPECT_EQ(rejected.u != before[rejected.id], outlier);
    outliers += outlier;
  }
  EXPECT_GT(outliers, 10u);
  const Eigen::Isometry3d gap = result.frame(kBefore).T_w_c.inverse() * result.frame(kBack).T_w_c;
  const Eigen::Isometry3d true_gap =
      ground_truth.frame(kBefore).T_c0_c.inverse() * ground_truth.frame(kBack).T_c0_c;
  EXPECT_LT(angleBetween(gap, true_gap), 0.01);
  const double scale = scaleOver(ground_truth, result, 12, kBefore + 1);
  EXPECT_LT((scale * gap.translation() - true_gap.translation()).norm(),
            0.03 * true_gap.translation().norm());
}

// In the blackout the scene moves into the part of the image that is masked.
TEST(VisualOdometry, theSearchAfterABlackoutUsesNothingMasked) {
  const SyntheticDrive ground_truth(blackoutInATurn(56));
  const PinholeCamera& camera = ground_truth.camera();
  cv::Mat mask(camera.height, camera.width, CV_8UC1, cv::Scalar(255));
  mask.colRange(camera.width * 7 / 8, camera.width) = 0;
  VisualOdometry odometry(camera, {}, mask);
  VoFrame frame;
  for (std::size_t i = 0; i < ground_truth.size(); ++i) {
    frame = odometry.process(ground_truth.image(i), ground_truth.frame(i).stamp_ns).frame;
  }
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  ASSERT_EQ(frame.map_id, 0u);
  for (const TrackedFeature& feature : frame.features) {
    const cv::Point pixel(cvRound(feature.u.x()), cvRound(feature.u.y()));
    EXPECT_EQ(mask.at<unsigned char>(pixel), 255) << pixel;
  }
}

// A pose needs so many inliers that there is none after the blackout. The next map starts with the
// rotation to the pose that the search has found.
TEST(VisualOdometry, aTurnInABlackoutIsKnownToTheNextMap) {
  const SyntheticDrive ground_truth(blackoutInATurn(68));
  VisualOdometry::Options options;
  options.pose.min_inliers = 70;
  const DriveRun result = run(ground_truth, options);
  constexpr std::size_t kBefore = 44, kStart = 57;
  ASSERT_EQ(result.frame(kBefore).status, VoStatus::kTracking);
  const VoFrame& frame = result.outputs.back().frame;
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  ASSERT_EQ(frame.map_id, 1u);
  ASSERT_EQ(frame.map_start.stamp_ns, ground_truth.frame(kStart).stamp_ns);
  const Eigen::Matrix3d true_rotation = ground_truth.frame(kBefore).T_c0_c.linear().transpose() *
                                        ground_truth.frame(kStart).T_c0_c.linear();
  EXPECT_GT(frame.map_start.rotation_sigma, 1e-5);
  EXPECT_LT(frame.map_start.rotation_sigma, 0.02);
  EXPECT_LT(Eigen::AngleAxisd(frame.map_start.R_previous_w.transpose() * true_rotation).angle(),
            0.02);
}

TEST(VisualOdometry, tracksThroughStepsOfTheExposure) {
  const SyntheticDrive ground_truth(smallDrive(45));
  VisualOdometry odometry(ground_truth.camera(), {});
  DriveRun result;
  for (std::size_t i = 0; i < ground_truth.size(); ++i) {
    // Single steps, then one in every frame.
    const double gain = i < 12 ? 1 : i < 19 ? 0.4 : i < 26 ? 1 : i < 33 ? 2.5 : i % 2 ? 0.6 : 1.5;
    cv::Mat image;
    ground_truth.image(i).convertTo(image, CV_8U, gain);
    result.outputs.push_back(odometry.process(image, ground_truth.frame(i).stamp_ns));
    if (i < 10) continue;
    EXPECT_EQ(result.frame(i).status, VoStatus::kTracking) << i;
    EXPECT_EQ(result.frame(i).map_id, 0u) << i;
  }
  EXPECT_NEAR(scaleOver(ground_truth, result, 26, 45) / scaleOver(ground_truth, result, 10, 26), 1,
              0.03);
}

// Four seconds of black images behind a car, which is at the same place in the image before and
// after: its features must not yield a pose in the old map.
TEST(VisualOdometry, aCarAheadDoesNotConcealAnInterruption) {
  const SyntheticDrive ground_truth(faultDrive(1, 21).options);
  VisualOdometry odometry(ground_truth.camera(), {});
  std::set<std::uint32_t> maps;
  for (std::size_t i = 95; i < 182; ++i) {
    const bool black = i >= 130 && i < 171;
    const cv::Mat image =
        black ? cv::Mat::zeros(ground_truth.camera().height, ground_truth.camera().width, CV_8U)
              : ground_truth.image(i);
    const VoFrame frame = odometry.process(image, ground_truth.frame(i).stamp_ns).frame;
    if (i > 170 && frame.status == VoStatus::kTracking) maps.insert(frame.map_id);
  }
  EXPECT_EQ(maps, std::set<std::uint32_t>{1});
}

TEST(VisualOdometry, aJumpToAnotherPlaceStartsANewMap) {
  const SyntheticDrive ground_truth(smallDrive(20));
  SyntheticDrive::Options other_options = smallDrive(30);
  other_options.random_seed = 77;
  other_options.curvature = 0;
  const SyntheticDrive other(other_options);
  VisualOdometry odometry(ground_truth.camera(), {});
  std::int64_t stamp = 1'000'000'000;
  for (std::size_t i = 0; i < ground_truth.size(); ++i, stamp += 100'000'000) {
    odometry.process(ground_truth.image(i), stamp);
  }
  std::vector<VoFrame> frames;
  for (std::size_t i = 0; i < other.size(); ++i, stamp += 100'000'000) {
    frames.push_back(odometry.process(other.image(i), stamp).frame);
  }
  EXPECT_STREQ(toString(frames.front().status), "lost");
  EXPECT_EQ(frames.back().status, VoStatus::kTracking);
  EXPECT_EQ(frames.back().map_id, 1u);
  int lost = 0;
  for (const VoFrame& frame : frames) {
    lost += frame.status == VoStatus::kLost;
    if (frame.status == VoStatus::kTracking) continue;
    EXPECT_EQ(frame.T_w_c.matrix(), Eigen::Matrix4d::Identity());
    EXPECT_TRUE(frame.features.empty() || frame.status == VoStatus::kInitialising);
    EXPECT_EQ(frame.map_id, frame.status == VoStatus::kLost ? 0u : 1u);
    EXPECT_EQ(frame.map_start.stamp_ns == 0, frame.status == VoStatus::kInitialising);
  }
  // The image that is lost for the third time in a row starts the new map.
  EXPECT_EQ(lost, VisualOdometry::Options().lost_frames_before_new_map - 1);
}

// The exposures of the old map have no effect on the new one.
TEST(VisualOdometry, aNewMapBeginsWithItsOwnExposure) {
  const SyntheticDrive ground_truth(smallDrive(16));
  SyntheticDrive::Options other_options = smallDrive(24);
  other_options.random_seed = 77;
  const std::vector<cv::Mat> images = imagesOf(ground_truth);
  const std::vector<cv::Mat> elsewhere = imagesOf(SyntheticDrive(other_options));
  const auto last = [&](double gain) {
    VisualOdometry odometry(ground_truth.camera(), {});
    std::int64_t stamp_ns = 0;
    VoFrame frame;
    const auto process = [&](const cv::Mat& image) {
      frame = odometry.process(image, stamp_ns).frame;
      stamp_ns += 100'000'000;
    };
    for (std::size_t i = 0; i < images.size(); ++i)
      process(applyGain(images[i], i < 12 ? 1 : gain));
    for (const cv::Mat& image : elsewhere) process(image);
    return frame;
  };
  const VoFrame a = last(1), b = last(0.5);
  ASSERT_EQ(a.map_id, 1u);
  ASSERT_EQ(a.status, VoStatus::kTracking);
  EXPECT_EQ(a.T_w_c.matrix(), b.T_w_c.matrix());
}

// Each of them is lost; only consecutive ones start a new map.
TEST(VisualOdometry, singleImagesOfAnotherPlaceKeepTheMap) {
  SyntheticDrive::Options options = smallDrive(45);
  const SyntheticDrive ground_truth(options);
  options.random_seed = 2;
  const SyntheticDrive elsewhere(options);
  const std::set<std::size_t> wrong{15, 22, 29, 36};
  ASSERT_GT(wrong.size(),
            static_cast<std::size_t>(VisualOdometry::Options().lost_frames_before_new_map));
  std::vector<cv::Mat> images = imagesOf(ground_truth);
  for (const std::size_t i : wrong) images[i] = elsewhere.image(i);
  const DriveRun result = run(ground_truth, images);
  for (std::size_t i = 12; i < ground_truth.size(); ++i) {
    const VoStatus expected = wrong.count(i) ? VoStatus::kLost : VoStatus::kTracking;
    EXPECT_EQ(result.frame(i).status, expected) << i;
    EXPECT_EQ(result.frame(i).map_id, 0u) << i;
  }
}

/// The odometry of a drive along a straight road with a camera that can turn to the left.
class TurningCamera {
 public:
  static constexpr double kYaw = 0.2;  ///< of one turn
  static constexpr std::size_t kFrames = 32;

  /// The image at this place of the drive after so many turns.
  const VoFrame& process(std::size_t turns, std::size_t place) {
    while (drives_.size() <= turns) {
      options_.yaw_rad = -0.9 + static_cast<double>(drives_.size()) * kYaw;
      drives_.emplace_back(options_);
    }
    return process(drives_[turns].image(place));
  }
  const VoFrame& process(const cv::Mat& image) {
    frame_ = odometry_.process(image, nextStamp()).frame;
    return frame_;
  }
  const VoFrame& frame() const { return frame_; }
  std::int64_t nextStamp() const { return frame_.stamp_ns + 100'000'000; }

 private:
  SyntheticDrive::Options options_ = [] {
    SyntheticDrive::Options options = straightDrive(kFrames);
    options.suspension = options.pitch_rad = 0;
    return options;
  }();
  std::deque<SyntheticDrive> drives_;
  VisualOdometry odometry_{options_.camera, {}};
  VoFrame frame_;
};

/// The rotation from the camera after some turns to that after so many more.
Eigen::Matrix3d rotationOfTurns(std::size_t turns) {
  return pose({0, -TurningCamera::kYaw * static_cast<double>(turns), 0}, {0, 0, 0}).linear();
}

// At one place, the camera turns by 11 degrees from image to image. Soon no map point is in the
// view, so there is no pose; but each image matches the one before it.
TEST(VisualOdometry, aTurnOverLostImagesIsKnown) {
  TurningCamera camera;
  constexpr std::size_t kPlace = 15;
  std::int64_t stamp_of_start_ns = 0;
  for (std::size_t i = 0; i <= kPlace; ++i) camera.process(0, i);
  std::size_t turns = 0, last_with_pose = 0;
  while (camera.frame().map_id == 0) {
    ASSERT_LT(++turns, 10u);
    stamp_of_start_ns = camera.nextStamp();
    if (camera.process(turns, kPlace).status == VoStatus::kTracking) last_with_pose = turns;
  }
  const VoFrame& frame = camera.frame();
  for (std::size_t i = kPlace + 1;
       i < TurningCamera::kFrames && frame.status != VoStatus::kTracking; ++i) {
    camera.process(turns, i);
  }
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  EXPECT_EQ(frame.map_id, 1u);
  EXPECT_EQ(frame.map_start.stamp_ns, stamp_of_start_ns);
  EXPECT_LT(frame.map_start.rotation_sigma, 0.05);
  EXPECT_LT(angleBetween(frame.map_start.R_previous_w, rotationOfTurns(turns - last_with_pose)),
            0.03);
}

// An image of another place between lost ones matches none of them. The one after it matches the
// last image with a pose.
TEST(VisualOdometry, aWrongImageDuringALossKeepsTheRotation) {
  TurningCamera camera;
  constexpr std::size_t kPlace = 15;
  for (std::size_t i = 0; i <= kPlace; ++i) camera.process(0, i);
  std::size_t turns = 0;
  do {
    ASSERT_LT(++turns, 10u);
  } while (camera.process(turns, kPlace).status == VoStatus::kTracking);
  SyntheticDrive::Options options = smallDrive(1);
  options.random_seed = 2;
  ASSERT_EQ(camera.process(SyntheticDrive(options).image(0)).status, VoStatus::kLost);
  const VoFrame& frame = camera.process(turns, kPlace);
  ASSERT_EQ(frame.map_id, 1u);
  for (std::size_t i = kPlace + 1;
       i < TurningCamera::kFrames && frame.status != VoStatus::kTracking; ++i) {
    camera.process(turns, i);
  }
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  EXPECT_LT(frame.map_start.rotation_sigma, 0.05);
  EXPECT_LT(angleBetween(frame.map_start.R_previous_w, rotationOfTurns(1)), 0.03);
}

// Right after the start of the map most of the image is covered.
TEST(VisualOdometry, tooFewTrackedFeaturesOfTheFirstKeyframesMakeAKeyframe) {
  SyntheticDrive::Options options = smallDrive(12);
  options.speed = 3;
  const SyntheticDrive ground_truth(options);
  VisualOdometry odometry(ground_truth.camera(), {});
  bool started = false;
  for (std::size_t i = 0; i < ground_truth.size(); ++i) {
    cv::Mat image = ground_truth.image(i);
    if (started) image(cv::Rect(0, 0, image.cols * 6 / 10, image.rows)).setTo(100);
    const auto output = odometry.process(image, ground_truth.frame(i).stamp_ns);
    if (started) {
      EXPECT_EQ(output.frame.status, VoStatus::kTracking);
      EXPECT_TRUE(output.frame.keyframe);
      return;
    }
    started = !output.start.empty();
  }
  FAIL() << "no map";
}

TEST(VisualOdometry, isDeterministic) {
  const std::vector<cv::Mat> images = sharedImages(25);
  const DriveRun a = run(sharedDrive(), images), b = run(sharedDrive(), images);
  for (std::size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(a.frame(i).T_w_c.matrix(), b.frame(i).T_w_c.matrix());
    ASSERT_EQ(a.frame(i).features.size(), b.frame(i).features.size());
    for (std::size_t k = 0; k < a.frame(i).features.size(); ++k) {
      EXPECT_EQ(a.frame(i).features[k].u, b.frame(i).features[k].u);
    }
  }
}

TEST(VisualOdometry, rejectsWrongImagesAndOptions) {
  const PinholeCamera camera = test::testCamera();
  VisualOdometry odometry(camera, {});
  EXPECT_THROW(odometry.process(cv::Mat(), 0), OptionError);
  EXPECT_THROW(odometry.process(cv::Mat(248, 801, CV_8UC1), 0), OptionError);
  EXPECT_THROW(odometry.process(cv::Mat(248, 800, CV_8UC3), 0), OptionError);
  VisualOdometry::Options options;
  options.keyframe_min_tracked = 2;
  EXPECT_THROW(VisualOdometry(camera, options), OptionError);
  EXPECT_THROW(VisualOdometry({}, {}), OptionError);
  EXPECT_THROW(VisualOdometry(camera, {}, cv::Mat(248, 801, CV_8UC1)), OptionError);
}

TEST(VisualOdometry, texturelessImagesKeepInitialising) {
  const PinholeCamera camera = test::testCamera();
  VisualOdometry odometry(camera, {});
  for (int i = 0; i < 5; ++i) {
    const cv::Mat grey(camera.height, camera.width, CV_8UC1, cv::Scalar(60 * i));
    const VoFrame frame = odometry.process(grey, i * 100'000'000LL).frame;
    EXPECT_EQ(frame.status, VoStatus::kInitialising);
    EXPECT_TRUE(frame.features.empty());
  }
}

// Nobody knows how the camera turned before the first image with features.
TEST(VisualOdometry, theRotationSinceATexturelessStartIsUnknown) {
  const SyntheticDrive ground_truth(smallDrive(16));
  std::vector<cv::Mat> images = imagesOf(ground_truth);
  const auto rotationSigma = [&] {
    const DriveRun result = run(ground_truth, images);
    const VoFrame& frame = result.outputs.back().frame;
    EXPECT_EQ(frame.status, VoStatus::kTracking);
    return frame.map_start.rotation_sigma;
  };
  EXPECT_EQ(rotationSigma(), 0);
  images[0] = images[1] = cv::Mat(images[0].size(), CV_8UC1, cv::Scalar(0));
  EXPECT_EQ(rotationSigma(), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace ground_scale_vo
