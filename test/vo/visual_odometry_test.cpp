#include "ground_scale_vo/vo/visual_odometry.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <limits>
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

constexpr std::int64_t kPeriod_ns = 100'000'000;  // of the images

/// Outputs of all frames of a drive.
struct DriveRun {
  std::vector<VisualOdometry::Output> outputs;

  const VoFrame& frame(std::size_t i) const { return outputs[i].frame; }
  /// The first frame from `begin` on that is tracked; the number of frames without one.
  std::size_t firstTracked(std::size_t begin) const {
    while (begin < outputs.size() && frame(begin).status != VoStatus::kTracking) ++begin;
    return begin;
  }
  /// Expects that all frames in [begin, end) are tracked in this map.
  void expectTracked(std::size_t begin, std::size_t end, std::uint32_t map_id = 0) const {
    for (std::size_t i = begin; i < end; ++i) {
      EXPECT_EQ(frame(i).status, VoStatus::kTracking) << i;
      EXPECT_EQ(frame(i).map_id, map_id) << i;
    }
  }
};

/// Runs over the images. Expects that no feature is rejected twice, or rejected and yet in the
/// frame.
DriveRun run(const PinholeCamera& camera, const std::vector<cv::Mat>& images,
             const VisualOdometry::Options& options = {}, const cv::Mat& mask = {}) {
  VisualOdometry odometry(camera, options, mask);
  DriveRun result;
  for (std::size_t i = 0; i < images.size(); ++i) {
    result.outputs.push_back(
        odometry.process(images[i], kPeriod_ns * static_cast<std::int64_t>(i + 1)));
    const VisualOdometry::Output& output = result.outputs.back();
    std::set<std::uint64_t> ids;
    for (const RejectedFeature& rejected : output.rejected) {
      EXPECT_TRUE(ids.insert(rejected.id).second) << "twice in frame " << i;
    }
    for (const TrackedFeature& feature : output.frame.features) {
      EXPECT_EQ(ids.count(feature.id), 0u) << "rejected, yet a feature of frame " << i;
    }
  }
  return result;
}

std::vector<cv::Mat> imagesOf(const SyntheticDrive& drive) {
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) images.push_back(drive.image(i));
  return images;
}
DriveRun run(const SyntheticDrive& drive, const VisualOdometry::Options& options = {},
             const cv::Mat& mask = {}) {
  return run(drive.camera(), imagesOf(drive), options, mask);
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

/// The default drive, which several tests share: an image is rendered when it is first used.
const SyntheticDrive& sharedDrive() {
  static const SyntheticDrive shared([] {
    SyntheticDrive::Options options;
    options.frames = 120;
    return options;
  }());
  return shared;
}
std::vector<cv::Mat> sharedImages(std::size_t count) {
  static std::vector<cv::Mat> images;
  while (images.size() < count) images.push_back(sharedDrive().image(images.size()));
  return {images.begin(), images.begin() + static_cast<std::ptrdiff_t>(count)};
}

/// True metres per VO unit over the tracked frames [from, to).
double scaleOver(const SyntheticDrive& ground_truth, const DriveRun& run, std::size_t from,
                 std::size_t to) {
  double metres = 0, units = 0;
  for (std::size_t i = from + 1; i < to; ++i) {
    metres += distanceBetween(ground_truth.frame(i - 1).T_c0_c, ground_truth.frame(i).T_c0_c);
    units += distanceBetween(run.frame(i - 1).T_w_c, run.frame(i).T_w_c);
  }
  return metres / units;
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

void expectFeaturesWithPoints(const VoFrame& frame, double max_median_error_px) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const TrackedFeature& feature = frame.features[i];
    if (i > 0) {
      EXPECT_LT(frame.features[i - 1].id, feature.id);
    }
    if (!feature.has_point) continue;
    EXPECT_GT(feature.p_c.z(), 0);
    EXPECT_GT(feature.depth_sigma, 0);
    EXPECT_LE(feature.age, frame.sequence);
    errors.push_back(
        (frame.camera.project(feature.p_c.cast<double>()) - feature.u.cast<double>()).norm());
  }
  ASSERT_GT(errors.size(), 20u);
  EXPECT_LT(median(errors), max_median_error_px);
}

// Curves, a slope, a car ahead and oncoming ones, and a stop.
TEST(VisualOdometry, FollowsTheSyntheticDrive) {
  const SyntheticDrive& truth = sharedDrive();
  const DriveRun result = run(truth.camera(), sharedImages(truth.size()));
  const std::size_t first = result.firstTracked(0);
  ASSERT_LT(first, 10u);
  ASSERT_EQ(result.outputs[first].start.front().sequence, 0u);
  ASSERT_EQ(result.outputs[first].start.size(), first + 1);
  EXPECT_TRUE(result.frame(first).keyframe);
  EXPECT_EQ(result.frame(first).map_start.stamp_ns, result.frame(0).stamp_ns);
  EXPECT_EQ(result.frame(0).map_start.stamp_ns, 0);
  result.expectTracked(first, truth.size());
  const double scale = scaleOver(truth, result, first, truth.size());
  const auto expectPose = [&](std::size_t i, const Eigen::Isometry3d& T_w_c) {
    const Eigen::Isometry3d& T = truth.frame(i).T_c0_c;
    EXPECT_LT(angleBetween(T_w_c, T), 0.01) << i;
    const double distance = std::max(5.0, T.translation().norm());
    EXPECT_LT((scale * T_w_c.translation() - T.translation()).norm(), 0.04 * distance) << i;
  };
  for (const auto& start : result.outputs[first].start) expectPose(start.sequence, start.T_w_c);
  for (std::size_t i = first; i < truth.size(); ++i) expectPose(i, result.frame(i).T_w_c);
  expectFeaturesWithPoints(result.frame(24), 0.8);
  const VoFrame &frame = result.frame(24),
                again = run(truth.camera(), sharedImages(25)).outputs.back().frame;
  EXPECT_EQ(frame.T_w_c.matrix(), again.T_w_c.matrix()) << "is not deterministic";
  ASSERT_EQ(frame.features.size(), again.features.size());
  for (std::size_t k = 0; k < frame.features.size(); ++k) {
    EXPECT_EQ(frame.features[k].u, again.features[k].u);
  }
}

// A part of the image is displaced in some images: its features are outliers there.
TEST(VisualOdometry, OnlyConsecutiveOutliersEndAFeature) {
  SyntheticDrive::Options drive_options = straightDrive(25);
  drive_options.speed = 4;
  const SyntheticDrive truth(drive_options);
  const std::vector<cv::Mat> images = imagesOf(truth);
  const cv::Rect part(140, 45, 200, 70), inner(160, 55, 160, 50);
  constexpr std::size_t kFirst = 12;
  // Of the features with a point in the inner part of image kFirst: the share in the last image.
  const auto survivors = [&](const std::set<std::size_t>& displaced, int max_outlier_frames) {
    std::vector<cv::Mat> changed = images;
    for (const std::size_t i : displaced) {
      changed[i] = images[i].clone();
      images[i](part - cv::Point(4, 0)).copyTo(changed[i](part));
    }
    VisualOdometry::Options options;
    options.max_outlier_frames = max_outlier_frames;
    const DriveRun result = run(truth.camera(), changed, options);
    result.expectTracked(kFirst, images.size());
    std::set<std::uint64_t> ids;
    for (const TrackedFeature& feature : result.frame(kFirst).features) {
      const bool inside = inner.contains(cv::Point2f(feature.u.x(), feature.u.y()));
      if (feature.has_point && inside) ids.insert(feature.id);
    }
    double last = 0, outliers = 0;
    for (const TrackedFeature& feature : result.outputs.back().frame.features) {
      last += static_cast<double>(ids.count(feature.id));
    }
    for (std::size_t i = kFirst + 1; i < images.size(); ++i) {
      for (const RejectedFeature& rejected : result.outputs[i].rejected) {
        outliers += rejected.reason == RejectReason::kOutlier && ids.count(rejected.id) > 0;
      }
    }
    const auto all = static_cast<double>(ids.size());
    EXPECT_GT(all, 10);
    if (max_outlier_frames == 0 || displaced.count(14) > 0) {
      EXPECT_GT(outliers, 0.5 * all);
    }
    return last / all;
  };
  const double undisturbed = survivors({}, 1);
  EXPECT_GT(survivors({13, 15, 17, 19, 21}, 1), 0.7 * undisturbed);
  EXPECT_LT(survivors({13, 15, 17, 19, 21}, 0), 0.3 * undisturbed);
  EXPECT_LT(survivors({13, 14, 15, 16, 17}, 1), 0.3 * undisturbed);
}

// Neighbouring points have errors in common, which their sigmas do not contain.
TEST(VisualOdometry, DepthSigmaIsAboutHalfTheErrorOfPointsOnTheRoad) {
  SyntheticDrive::Options drive_options = straightDrive(45);
  drive_options.shadows = false;
  const SyntheticDrive truth(drive_options);
  const DriveRun result = run(truth);
  constexpr std::size_t kFirst = 15;
  const double scale = scaleOver(truth, result, kFirst, truth.size());
  std::vector<double> errors;  // in units of their sigma
  for (std::size_t i = kFirst; i < truth.size(); ++i) {
    const SyntheticDrive::Frame& true_frame = truth.frame(i);
    for (const TrackedFeature& feature : result.frame(i).features) {
      const Eigen::Vector3d ray = truth.camera().ray(feature.u.cast<double>());
      const bool on_road = ray.y() > 0.1 && std::abs(ray.x()) < ray.y();
      if (!feature.has_point || !on_road) continue;
      const double true_z = -true_frame.height / true_frame.n_c.dot(ray) / scale;
      const double z = feature.p_c.z();
      errors.push_back(std::abs(1 / z - 1 / true_z) * z * z / feature.depth_sigma);
    }
  }
  ASSERT_GT(errors.size(), 100u);
  const double sigma = 1.48 * median(errors);
  EXPECT_GT(sigma, 1.1);
  EXPECT_LT(sigma, 2.8);
}

// Also when features are lost at a standstill in noisy images at night, so that each image becomes
// a keyframe. Keyframes at one place have no baseline: if they displaced all others, the scale of
// the map would be undetermined.
TEST(VisualOdometry, AStandstillKeepsPoseMapAndScale) {
  SyntheticDrive::Options drive_options = smallDrive(105);
  drive_options.stop_at_m = 22;
  drive_options.stop_s = 3;
  const SyntheticDrive truth(drive_options);
  std::size_t begin = 10;
  while (truth.frame(begin).speed > 0) ++begin;
  std::size_t end = begin;
  while (truth.frame(end).speed == 0) ++end;
  ASSERT_GE(end - begin, 30u);
  ASSERT_LT(end + 20, truth.size());
  for (const bool all_are_keyframes : {false, true}) {
    SCOPED_TRACE(all_are_keyframes);
    VisualOdometry::Options options;
    if (all_are_keyframes) {
      options.keyframe_min_tracked = 1;
      options.standstill_flow = 0;
    }
    const DriveRun result = run(truth, options);
    result.expectTracked(10, truth.size());
    int keyframes = 0;
    const double scale = scaleOver(truth, result, 10, begin);
    for (std::size_t i = begin; i < end; ++i) {
      keyframes += result.frame(i).keyframe;
      EXPECT_LT(scale * distanceBetween(result.frame(begin).T_w_c, result.frame(i).T_w_c), 0.05);
    }
    EXPECT_EQ(keyframes > options.map.keyframes, all_are_keyframes);
    EXPECT_NEAR(scaleOver(truth, result, end, truth.size()) / scale, 1, 0.03);
  }
}

// At rest, then slow: several images before the parallax suffices.
TEST(VisualOdometry, TheFramesBeforeTheFirstMapHaveTheirPoses) {
  SyntheticDrive::Options options = straightDrive(30);
  options.speed = 1;
  const SyntheticDrive truth(options);
  constexpr std::size_t kAtRest = 10;  // [frames]
  std::vector<cv::Mat> images = imagesOf(truth);
  for (std::size_t i = 0; i < kAtRest; ++i) {
    cv::Mat noise(images.back().size(), CV_16SC1), image;
    cv::RNG(i).fill(noise, cv::RNG::NORMAL, 0, 2);
    cv::add(truth.image(0), noise, image, {}, CV_8U);
    images.insert(images.begin(), image);
  }
  const DriveRun result = run(truth.camera(), images);
  const std::size_t first = result.firstTracked(0);
  ASSERT_LT(first, images.size());
  const auto& start = result.outputs[first].start;
  ASSERT_EQ(start.size(), first + 1);
  ASSERT_GE(start.size(), kAtRest + 5);
  const auto trueDistance = [&](std::size_t i) {
    return truth.frame(i < kAtRest ? 0 : i - kAtRest).T_c0_c.translation().norm();
  };
  const double scale = trueDistance(first) / start.back().T_w_c.translation().norm();
  for (std::size_t i = 0; i < start.size(); ++i) {
    EXPECT_EQ(start[i].sequence, i);
    EXPECT_EQ(start[i].stamp_ns, result.frame(i).stamp_ns);
    const Eigen::Vector3d position = scale * start[i].T_w_c.translation();
    EXPECT_NEAR(position.z(), trueDistance(i), 0.06 * trueDistance(first)) << i;
    EXPECT_LT(position.head<2>().norm(), 0.06 * trueDistance(first)) << i;
    EXPECT_LT(angleBetween(start[i].T_w_c, Eigen::Isometry3d::Identity()), 0.006) << i;
  }
}

TEST(VisualOdometry, ImagesWithoutTextureOrTranslationStartNoMap) {
  const PinholeCamera& camera = sharedDrive().camera();
  std::vector<cv::Mat> textureless, rotated;
  for (int i = 0; i < 20; ++i) {
    textureless.emplace_back(camera.height, camera.width, CV_8UC1, cv::Scalar(12 * i));
    rotated.push_back(turned(sharedImages(1)[0], camera, 0.01 * i));
  }
  for (const auto& images : {textureless, rotated}) {
    EXPECT_EQ(run(camera, images).firstTracked(0), images.size());
  }
}

// Black images are no reason to begin anew; only those before the first image with features leave
// the rotation since the start unknown.
TEST(VisualOdometry, BlackImagesDoNotEndAnInitialisation) {
  const SyntheticDrive truth(smallDrive(20));
  for (const std::uint32_t first_black : {0u, 1u}) {
    std::vector<cv::Mat> images = imagesOf(truth);
    for (const std::uint32_t i : {first_black, first_black + 1}) {
      images[i] = cv::Mat::zeros(images[i].size(), CV_8UC1);
    }
    const DriveRun result = run(truth.camera(), images);
    const std::size_t first = result.firstTracked(0);
    ASSERT_LT(first, 16u);
    const auto& start = result.outputs[first].start;
    EXPECT_EQ(start.front().sequence, first_black == 0 ? 2u : 0u);
    for (const auto& frame : start) {
      EXPECT_TRUE(frame.sequence < first_black || frame.sequence > first_black + 1);
    }
    EXPECT_EQ(result.frame(first).map_start.rotation_sigma,
              first_black == 0 ? std::numeric_limits<double>::infinity() : 0);
  }
}

// Between two images the camera turns by 15 degrees, as at 3 Hz in a junction.
TEST(VisualOdometry, ALargeRotationKeepsTheMapAlsoDuringTheInitialisation) {
  const PinholeCamera& camera = sharedDrive().camera();
  constexpr double kYaw = 0.26;
  for (const std::size_t turn : {1, 15}) {
    std::vector<cv::Mat> images = sharedImages(20);
    for (std::size_t i = turn; i < images.size(); ++i) images[i] = turned(images[i], camera, kYaw);
    const DriveRun result = run(camera, images);
    const std::size_t first = result.firstTracked(0);
    ASSERT_LT(first, 15u);
    EXPECT_EQ(result.outputs[first].start.front().sequence, 0u);
    result.expectTracked(first, images.size());
    const Eigen::Isometry3d before =
        turn == 1 ? Eigen::Isometry3d::Identity() : result.frame(turn - 1).T_w_c;
    EXPECT_NEAR(angleBetween(before, result.frame(std::max(turn, first)).T_w_c), kYaw, 0.03);
  }
}

// The camera turns on the spot by 55 degrees, so that most of the first image leaves the view,
// and then drives on.
TEST(VisualOdometry, ATurnBeforeTheFirstMapIsKnown) {
  SyntheticDrive::Options options;
  options.frames = 12;
  options.moving_cars = false;
  const SyntheticDrive truth(options);
  constexpr std::size_t kTurning = 25;
  const auto yaw = [](std::size_t i) { return 0.04 * std::min(static_cast<int>(i) - 12, 12); };
  const auto place = [](std::size_t i) { return i < kTurning ? 0 : i - kTurning + 1; };
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; place(i) < truth.size(); ++i) {
    images.push_back(turned(truth.image(place(i)), truth.camera(), yaw(i)));
  }
  const DriveRun result = run(truth.camera(), images);
  const std::size_t first = result.firstTracked(0);
  ASSERT_LT(first, images.size());
  EXPECT_GE(first, kTurning);
  const Eigen::Matrix3d true_rotation = pose({0, yaw(0), 0}, {0, 0, 0}).linear().transpose() *
                                        truth.frame(place(first)).T_c0_c.linear() *
                                        pose({0, yaw(first), 0}, {0, 0, 0}).linear();
  const MapStart& map_start = result.frame(first).map_start;
  const Eigen::Matrix3d rotation =
      map_start.R_previous_w * result.outputs[first].start.back().T_w_c.linear();
  EXPECT_LT(map_start.rotation_sigma, 0.02);
  EXPECT_LT(angleBetween(rotation, true_rotation), 0.015);
}

/// A drive of which some frames from 45 on are black. The camera turns by 20 degrees in 10 frames.
SyntheticDrive::Options blackoutInATurn(int frames, int black) {
  SyntheticDrive::Options options = smallDrive(frames);
  options.random_seed = 2;
  options.speed = 6;
  options.curvature = 0.06;
  options.slope = 0;
  options.black_first = 45;
  options.black_frames = black;
  return options;
}

TEST(VisualOdometry, ABlackoutKeepsMapScaleAndHeading) {
  SyntheticDrive::Options ahead = smallDrive(85);
  ahead.black_first = 45;
  ahead.black_frames = 15;
  ahead.moving_cars = false;
  for (const SyntheticDrive::Options& options : {ahead, blackoutInATurn(80, 10)}) {
    const SyntheticDrive truth(options);
    const DriveRun result = run(truth);
    const auto begin = static_cast<std::size_t>(options.black_first);
    const std::size_t end = begin + static_cast<std::size_t>(options.black_frames);
    result.expectTracked(12, begin);
    for (std::size_t i = begin; i < end; ++i) {
      EXPECT_EQ(result.frame(i).status, VoStatus::kLost) << i;
    }
    const std::size_t back = result.firstTracked(end);
    ASSERT_LT(back, end + 5);
    result.expectTracked(back, truth.size());
    expectFeaturesWithPoints(result.frame(back), 1);
    const double scale = scaleOver(truth, result, 12, begin);
    EXPECT_NEAR(scaleOver(truth, result, back, truth.size()) / scale, 1, 0.04);
    const Eigen::Isometry3d gap =
        result.frame(begin - 1).T_w_c.inverse() * result.frame(back).T_w_c;
    const Eigen::Isometry3d true_gap =
        truth.frame(begin - 1).T_c0_c.inverse() * truth.frame(back).T_c0_c;
    EXPECT_LT(angleBetween(gap, true_gap), 0.01);
    EXPECT_LT((scale * gap.translation() - true_gap.translation()).norm(),
              0.03 * true_gap.translation().norm());
  }
}

// In the blackout the scene moves into the part of the image that is masked.
TEST(VisualOdometry, TheSearchAfterABlackoutUsesNothingMasked) {
  const SyntheticDrive truth(blackoutInATurn(60, 10));
  cv::Mat mask(truth.camera().height, truth.camera().width, CV_8UC1, cv::Scalar(255));
  mask.colRange(mask.cols * 7 / 8, mask.cols) = 0;
  const DriveRun result = run(truth, {}, mask);
  const std::size_t back = result.firstTracked(55);
  ASSERT_LT(back, truth.size());
  EXPECT_EQ(result.frame(back).map_id, 0u);
  for (const TrackedFeature& feature : result.frame(back).features) {
    const cv::Point pixel(cvRound(feature.u.x()), cvRound(feature.u.y()));
    EXPECT_EQ(mask.at<unsigned char>(pixel), 255) << pixel;
  }
}

// A pose needs more inliers than there are after the blackout. The next map starts with the
// rotation to the pose that the search has found.
TEST(VisualOdometry, ATurnInABlackoutIsKnownToTheNextMap) {
  const SyntheticDrive truth(blackoutInATurn(70, 10));
  const std::vector<cv::Mat> images = imagesOf(truth);
  constexpr std::size_t kBefore = 44;
  const auto pointsIn = [](const VoFrame& frame) {
    int points = 0;
    for (const TrackedFeature& feature : frame.features) points += feature.has_point;
    return points;
  };
  const DriveRun kept = run(truth.camera(), {images.begin(), images.begin() + 56});
  VisualOdometry::Options options;
  options.pose.min_inliers = static_cast<int>(1.15 * pointsIn(kept.outputs.back().frame));
  ASSERT_GT(pointsIn(kept.frame(kBefore)), 1.2 * options.pose.min_inliers);
  const DriveRun result = run(truth.camera(), images, options);
  if (result.frame(kBefore).status != VoStatus::kTracking) {
    GTEST_SKIP() << "no number of inliers separates the frames before and after the blackout";
  }
  const std::size_t first = result.firstTracked(kBefore + 1);
  ASSERT_LT(first, truth.size());
  const MapStart& map_start = result.frame(first).map_start;
  EXPECT_EQ(result.frame(first).map_id, result.frame(kBefore).map_id + 1);
  const auto start = static_cast<std::size_t>(map_start.stamp_ns / kPeriod_ns - 1);
  const Eigen::Matrix3d true_rotation =
      truth.frame(kBefore).T_c0_c.linear().transpose() * truth.frame(start).T_c0_c.linear();
  EXPECT_GT(map_start.rotation_sigma, 1e-5);
  EXPECT_LT(map_start.rotation_sigma, 0.02);
  EXPECT_LT(angleBetween(map_start.R_previous_w, true_rotation), 0.02);
}

TEST(VisualOdometry, TracksThroughStepsOfTheExposure) {
  const SyntheticDrive truth(smallDrive(45));
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    // Single steps, then one in every frame.
    const double gain = i < 12 ? 1 : i < 19 ? 0.4 : i < 26 ? 1 : i < 33 ? 2.5 : i % 2 ? 0.6 : 1.5;
    images.push_back(applyGain(truth.image(i), gain));
  }
  const DriveRun result = run(truth.camera(), images);
  result.expectTracked(10, 45);
  EXPECT_NEAR(scaleOver(truth, result, 26, 45) / scaleOver(truth, result, 10, 26), 1, 0.03);
}

// Four seconds of black images behind a car, which is at the same place in the image before and
// after: its features must not yield a pose in the old map.
TEST(VisualOdometry, ACarAheadDoesNotConcealAnInterruption) {
  const SyntheticDrive truth(faultDrive(1, 21).options);
  std::vector<cv::Mat> images;
  for (std::size_t i = 95; i < 182; ++i) {
    images.push_back(truth.image(i));
    if (i >= 130 && i < 171) images.back().setTo(0);
  }
  const DriveRun result = run(truth.camera(), images);
  const std::size_t back = result.firstTracked(171 - 95);
  ASSERT_LT(back, images.size());
  result.expectTracked(back, images.size(), 1);
}

// The exposures of the old map have no effect on the new one.
TEST(VisualOdometry, AJumpToAnotherPlaceStartsANewMap) {
  constexpr std::size_t kJump = 20;
  const SyntheticDrive truth(smallDrive(kJump));
  SyntheticDrive::Options other_options = smallDrive(30);
  other_options.random_seed = 77;
  const std::vector<cv::Mat> elsewhere = imagesOf(SyntheticDrive(other_options));
  Eigen::Matrix4d last[2];
  for (const int i : {0, 1}) {
    std::vector<cv::Mat> images;
    for (std::size_t k = 0; k < kJump; ++k) {
      images.push_back(applyGain(truth.image(k), k < 12 || i == 0 ? 1 : 0.5));
    }
    images.insert(images.end(), elsewhere.begin(), elsewhere.end());
    const DriveRun result = run(truth.camera(), images);
    // The image that is lost for the last time in a row starts the new map.
    const auto lost =
        static_cast<std::size_t>(VisualOdometry::Options().lost_frames_before_new_map - 1);
    const std::size_t back = result.firstTracked(kJump);
    for (std::size_t k = kJump; k < back; ++k) {
      const VoFrame& frame = result.frame(k);
      const bool is_lost = k < kJump + lost;
      EXPECT_STREQ(toString(frame.status), is_lost ? "lost" : "initialising") << k;
      EXPECT_EQ(frame.map_id, is_lost ? 0u : 1u) << k;
      EXPECT_EQ(frame.T_w_c.matrix(), Eigen::Matrix4d::Identity());
      EXPECT_TRUE(frame.features.empty() || !is_lost) << k;
      EXPECT_EQ(frame.map_start.stamp_ns == 0, !is_lost);
    }
    ASSERT_LT(back, images.size());
    result.expectTracked(back, images.size(), 1);
    last[i] = result.outputs.back().frame.T_w_c.matrix();
  }
  EXPECT_EQ(last[0], last[1]);
}

// Each of them is lost; only consecutive ones start a new map.
TEST(VisualOdometry, SingleImagesOfAnotherPlaceKeepTheMap) {
  SyntheticDrive::Options options = smallDrive(45);
  const SyntheticDrive truth(options);
  options.random_seed = 2;
  const SyntheticDrive elsewhere(options);
  std::vector<cv::Mat> images = imagesOf(truth);
  const std::set<std::size_t> wrong{15, 22, 29, 36};
  for (const std::size_t i : wrong) images[i] = elsewhere.image(i);
  const DriveRun result = run(truth.camera(), images);
  for (std::size_t i = 12; i < truth.size(); ++i) {
    const VoStatus expected = wrong.count(i) ? VoStatus::kLost : VoStatus::kTracking;
    EXPECT_EQ(result.frame(i).status, expected) << i;
    EXPECT_EQ(result.frame(i).map_id, 0u) << i;
  }
}

// At one place of a straight road, the camera turns to the left by 11 degrees from image to image.
// Soon no map point is in the view, so there is no pose; but each image matches the one before it.
// An image of another place between lost ones matches none of them; the one after it matches the
// last image with a pose.
TEST(VisualOdometry, ATurnOverLostImagesIsKnown) {
  constexpr double kYaw = 0.2;  // of one turn
  constexpr std::size_t kPlace = 15, kFrames = 32;
  SyntheticDrive::Options options = straightDrive(kFrames);
  options.suspension = options.pitch_rad = 0;
  SyntheticDrive::Options other_options = smallDrive(1);
  other_options.random_seed = 2;
  const cv::Mat elsewhere = SyntheticDrive(other_options).image(0);
  std::deque<SyntheticDrive> drives;  // after so many turns
  for (int turns = 0; turns < 10; ++turns) {
    options.yaw_rad = -0.9 + turns * kYaw;
    drives.emplace_back(options);
  }
  for (const bool wrong_image : {false, true}) {
    SCOPED_TRACE(wrong_image);
    VisualOdometry odometry(options.camera, {});
    VoFrame frame;
    const auto process = [&](const cv::Mat& image) {
      frame = odometry.process(image, frame.stamp_ns + kPeriod_ns).frame;
      return frame.status;
    };
    for (std::size_t i = 0; i <= kPlace; ++i) process(drives[0].image(i));
    std::size_t turns = 0, last_with_pose = 0;
    while (frame.map_id == 0) {
      ASSERT_LT(turns + 1, drives.size());
      if (!wrong_image || frame.status == VoStatus::kTracking) ++turns;
      if (process(drives[turns].image(kPlace)) == VoStatus::kTracking) last_with_pose = turns;
      if (wrong_image && frame.status == VoStatus::kLost) process(elsewhere);
    }
    const std::int64_t start_ns = frame.stamp_ns;
    for (std::size_t i = kPlace + 1; i < kFrames && frame.status != VoStatus::kTracking; ++i) {
      process(drives[turns].image(i));
    }
    ASSERT_EQ(frame.status, VoStatus::kTracking);
    EXPECT_EQ(frame.map_id, 1u);
    EXPECT_EQ(frame.map_start.stamp_ns, start_ns);
    EXPECT_LT(frame.map_start.rotation_sigma, 0.05);
    const double turned_by = kYaw * static_cast<double>(turns - last_with_pose);
    EXPECT_LT(
        angleBetween(frame.map_start.R_previous_w, pose({0, -turned_by, 0}, {0, 0, 0}).linear()),
        0.03);
  }
}

TEST(VisualOdometry, RejectsWrongImagesAndOptions) {
  const PinholeCamera camera = test::testCamera();
  VisualOdometry odometry(camera, {});
  EXPECT_THROW(odometry.process(cv::Mat(), 0), OptionError);
  EXPECT_THROW(odometry.process(cv::Mat(248, 801, CV_8UC1), 0), OptionError);
  EXPECT_THROW(VisualOdometry({}, {}), OptionError);
  EXPECT_THROW(VisualOdometry(camera, {}, cv::Mat(248, 801, CV_8UC1)), OptionError);
  using Options = VisualOdometry::Options;
  const std::function<void(Options*)> changes[] = {
      [](Options* options) { options->keyframe_min_tracked = 2; },
      [](Options* options) { options->tracker.cell_size = 0; },
      [](Options* options) { options->two_view.min_matches = 3; },
      [](Options* options) { options->alignment.min_correlation = 2; },
      [](Options* options) { options->pose.min_inliers = 2; },
      [](Options* options) { options->map.keyframes = 1; },
      [](Options* options) { options->bundle_adjustment.window = 0; }};
  for (const auto& change : changes) {
    Options options;
    change(&options);
    EXPECT_THROW(VisualOdometry(camera, options), OptionError) << &change - changes;
  }
}

}  // namespace
}  // namespace ground_scale_vo
