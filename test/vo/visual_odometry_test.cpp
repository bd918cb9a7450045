#include "ground_scale_vo/vo/visual_odometry.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <opencv2/imgproc.hpp>
#include <set>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"
#include "support/scene.hpp"

namespace gsv {
namespace {

using test::angleBetween;
using test::pose;

constexpr std::int64_t kPeriod_ns = 100'000'000;  // of the images

/// Number of the image that this pose belongs to, in run().
std::size_t frameOf(const StampedPose& pose) {
  return static_cast<std::size_t>(pose.stamp_ns / kPeriod_ns - 1);
}

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
  ASSERT_EQ(frameOf(result.outputs[first].start.front()), 0u);
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
  for (const auto& start : result.outputs[first].start) expectPose(frameOf(start), start.T_w_c);
  std::size_t outliers = 0;  // among the features with a point
  std::set<std::uint64_t> with_point;
  for (std::size_t i = first; i < truth.size(); ++i) {
    expectPose(i, result.frame(i).T_w_c);
    for (const RejectedFeature& rejected : result.outputs[i].rejected) {
      outliers += rejected.is_outlier && with_point.count(rejected.id) > 0;
    }
    with_point.clear();
    for (const TrackedFeature& feature : result.frame(i).features) {
      if (feature.has_point) with_point.insert(feature.id);
    }
  }
  EXPECT_GT(outliers, 50u) << "on the other vehicles";
  expectFeaturesWithPoints(result.frame(24), 0.8);
}

// Neighbouring points have errors in common, which their sigmas do not contain.
void expectDepthSigmas(SyntheticDrive::Options drive_options) {
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

// Straight ahead, and where the camera has turned away from the axes of its map.
TEST(VisualOdometry, DepthSigmaIsAboutHalfTheErrorOfPointsOnTheRoad) {
  SyntheticDrive::Options options = straightDrive(45);
  expectDepthSigmas(options);
  constexpr double kRadius = 20;  // [m]
  for (int i = 0; i < options.frames; ++i) {
    const double heading = 0.9 * i / kRadius;
    options.path.push_back(kRadius * Eigen::Vector3d(1 - std::cos(heading), 0, std::sin(heading)));
  }
  expectDepthSigmas(options);
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
  const auto trueDistance = [&](std::size_t i) {
    return truth.frame(i < kAtRest ? 0 : i - kAtRest).T_c0_c.translation().norm();
  };
  const double scale = trueDistance(first) / start.back().T_w_c.translation().norm();
  for (std::size_t i = 0; i < start.size(); ++i) {
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
    EXPECT_EQ(frameOf(start.front()), first_black == 0 ? 2u : 0u);
    for (const auto& frame : start) {
      EXPECT_TRUE(frameOf(frame) < first_black || frameOf(frame) > first_black + 1);
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
    EXPECT_EQ(frameOf(result.outputs[first].start.front()), 0u);
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
SyntheticDrive::Options blackoutInATurn(int frames, std::size_t black) {
  SyntheticDrive::Options options = smallDrive(frames);
  options.random_seed = 2;
  options.speed = 6;
  options.curvature = 0.06;
  options.slope = 0;
  options.faults = {{FaultKind::kBlack, {45, 44 + black}}};
  return options;
}

// In the turn, the scene moves into the part of the image that is masked.
TEST(VisualOdometry, ABlackoutKeepsMapScaleAndHeading) {
  SyntheticDrive::Options ahead = smallDrive(85);
  ahead.faults = {{FaultKind::kBlack, {45, 59}}};
  ahead.moving_cars = false;
  cv::Mat mask(ahead.camera.height, ahead.camera.width, CV_8UC1, cv::Scalar(255));
  mask.colRange(mask.cols * 7 / 8, mask.cols) = 0;
  for (const SyntheticDrive::Options& options : {ahead, blackoutInATurn(80, 10)}) {
    const SyntheticDrive truth(options);
    const bool turns = options.curvature > 0.05;
    const DriveRun result = run(truth, {}, turns ? mask : cv::Mat());
    const FrameRange& black = options.faults.front().frames;
    const std::size_t begin = black.first, end = black.last + 1;
    result.expectTracked(12, begin);
    for (std::size_t i = begin; i < end; ++i) {
      EXPECT_EQ(result.frame(i).status, VoStatus::kLost) << i;
    }
    const std::size_t back = result.firstTracked(end);
    ASSERT_LT(back, end + 5);
    result.expectTracked(back, truth.size());
    expectFeaturesWithPoints(result.frame(back), 1);
    for (const TrackedFeature& feature : result.frame(back).features) {
      const int grey = mask.at<unsigned char>(cvRound(feature.u.y()), cvRound(feature.u.x()));
      EXPECT_TRUE(!turns || grey == 255) << feature.u.transpose();
    }
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

// Single images of another place are lost; only consecutive ones start a new map.
TEST(VisualOdometry, AJumpToAnotherPlaceStartsANewMap) {
  constexpr std::size_t kJump = 30;
  SyntheticDrive::Options other_options = smallDrive(40);
  other_options.random_seed = 77;
  const SyntheticDrive truth(smallDrive(kJump)), elsewhere(other_options);
  std::vector<cv::Mat> images = imagesOf(truth);
  const std::set<std::size_t> wrong{14, 18, 22, 26};
  for (const std::size_t i : wrong) images[i] = elsewhere.image(i);
  for (const cv::Mat& image : imagesOf(elsewhere)) images.push_back(image);
  const DriveRun result = run(truth.camera(), images);
  // The image that is lost for the last time in a row starts the new map.
  constexpr std::size_t restart = kJump - 1 + 3;
  const std::size_t back = result.firstTracked(kJump);
  for (std::size_t k = 12; k < back; ++k) {
    const VoFrame& frame = result.frame(k);
    const bool tracked = k < kJump && wrong.count(k) == 0;
    EXPECT_STREQ(toString(frame.status), tracked       ? "tracking"
                                         : k < restart ? "lost"
                                                       : "initialising")
        << k;
    EXPECT_EQ(frame.map_id, k < restart ? 0u : 1u) << k;
    EXPECT_TRUE(tracked || frame.T_w_c.isApprox(Eigen::Isometry3d::Identity(), 0)) << k;
    EXPECT_TRUE(frame.features.empty() || tracked || k >= restart) << k;
    EXPECT_EQ(frame.map_start.stamp_ns == 0, k >= restart) << k;
  }
  ASSERT_LT(back, images.size());
  result.expectTracked(back, images.size(), 1);
}

TEST(VisualOdometry, AZoomStartsANewMapAndIsMeasured) {
  constexpr std::size_t kFirst = 25, kBack = 40, kImages = 55;
  const PinholeCamera camera = sharedDrive().camera();
  for (const double zoom : {1.05, 1.2, 1.5, 0.8}) {
    SCOPED_TRACE(zoom);
    std::vector<cv::Mat> images = sharedImages(kImages);
    for (std::size_t i = kFirst; i < kBack; ++i) images[i] = zoomed(images[i], camera, zoom);
    const DriveRun zooming = run(camera, images);
    zooming.expectTracked(10, kFirst);
    zooming.expectTracked(zooming.firstTracked(kFirst), kBack, 1);
    EXPECT_LT(zooming.firstTracked(kFirst), kFirst + 6);
    EXPECT_EQ(zooming.frame(kFirst - 1).zoom, 1);
    EXPECT_NEAR(zooming.frame(kFirst).zoom, zoom, 0.01 * zoom);
    EXPECT_NEAR(zooming.frame(kBack - 1).zoom, zoom, 0.01 * zoom);
    zooming.expectTracked(zooming.firstTracked(kBack), kImages, 2);
    EXPECT_EQ(zooming.frame(kImages - 1).zoom, 1) << "the lens has returned";
  }
}

// At one place of a straight road, the camera turns to the left by 11 degrees from image to image.
// Soon no map point is in the view, so there is no pose; but each image matches the one before it.
TEST(VisualOdometry, ATurnOverLostImagesIsKnown) {
  constexpr double kYaw = 0.2;  // of one turn
  constexpr std::size_t kPlace = 15, kFrames = 32;
  SyntheticDrive::Options options = straightDrive(kFrames);
  options.suspension = options.pitch_rad = 0;
  const auto driveAfter = [&](std::size_t turns) {
    options.yaw_rad = -0.9 + static_cast<double>(turns) * kYaw;
    return SyntheticDrive(options);
  };
  VisualOdometry odometry(options.camera, {});
  VoFrame frame;
  const auto process = [&](const cv::Mat& image) {
    frame = odometry.process(image, frame.stamp_ns + kPeriod_ns).frame;
    return frame.status == VoStatus::kTracking;
  };
  const SyntheticDrive before = driveAfter(0);
  for (std::size_t i = 0; i <= kPlace; ++i) process(before.image(i));
  std::size_t turns = 0, last_with_pose = 0;
  while (frame.map_id == 0) {
    ASSERT_LT(++turns, 10u);
    if (process(driveAfter(turns).image(kPlace))) last_with_pose = turns;
  }
  const std::int64_t start_ns = frame.stamp_ns;
  const SyntheticDrive after = driveAfter(turns);
  for (std::size_t i = kPlace + 1; i < kFrames && !process(after.image(i)); ++i) continue;
  ASSERT_EQ(frame.status, VoStatus::kTracking);
  EXPECT_EQ(frame.map_id, 1u);
  EXPECT_EQ(frame.map_start.stamp_ns, start_ns);
  EXPECT_LT(frame.map_start.rotation_sigma, 0.05);
  const double turned_by = kYaw * static_cast<double>(turns - last_with_pose);
  EXPECT_LT(
      angleBetween(frame.map_start.R_previous_w, pose({0, -turned_by, 0}, {0, 0, 0}).linear()),
      0.03);
}

TEST(VisualOdometry, RejectsWrongImagesAndOptions) {
  const PinholeCamera camera = test::testCamera();
  VisualOdometry odometry(camera, {});
  EXPECT_THROW(odometry.process(cv::Mat(), 0), OptionError);
  EXPECT_THROW(odometry.process(cv::Mat(248, 801, CV_8UC1), 0), OptionError);
  EXPECT_THROW(VisualOdometry({}, {}), OptionError);
  EXPECT_THROW(VisualOdometry(camera, {}, cv::Mat(248, 801, CV_8UC1)), OptionError);
}

}  // namespace
}  // namespace gsv
