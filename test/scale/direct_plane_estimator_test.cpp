#include "ground_scale_vo/scale/direct_plane_estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "support/road_image.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kPriorSigma = 0.012;  // of pitch and roll [rad]

/// Changes the image of a frame.
using Change = std::function<void(std::uint32_t, cv::Mat*)>;

RoadScene nearRoad() {
  RoadScene scene;
  scene.pitch = 0.03;
  scene.addPatch(1500, -2.5, 2.5, 0, 15, 0, 1);
  return scene;
}

/// Result of the last of `frames` frames, each with the same predicted height [VO units] (0: none).
/// texture: as in roadImage().
DirectPlaneEstimator::Result drive(DirectPlaneEstimator* estimator, const RoadScene& scene,
                                   double predicted, std::uint32_t frames = 4,
                                   const Change& change = nullptr,
                                   const std::function<double(double, double)>& texture = asphalt) {
  DirectPlaneEstimator::Result result;
  const NormalPrior prior = priorOf(scene, kPriorSigma);
  const MotionHistory::Chord chord{prior.forward_c, scene.step, Eigen::Vector3d::Zero()};
  for (std::uint32_t i = 0; i < frames; ++i) {
    cv::Mat image = roadImage(scene, scene.step * i, texture);
    if (change) change(i, &image);
    result = estimator->estimate(scene.frame(i), image, prior, chord, predicted);
  }
  return result;
}

DirectPlaneEstimator::Result drive(const RoadScene& scene, double predicted,
                                   std::uint32_t frames = 4, const Change& change = nullptr,
                                   const std::function<double(double, double)>& texture = asphalt) {
  DirectPlaneEstimator estimator({});
  return drive(&estimator, scene, predicted, frames, change, texture);
}

/// Result of the last of the images, which show frame 0, 1 ... of the scene.
DirectPlaneEstimator::Result estimateWith(const DirectPlaneEstimator::Options& options,
                                          const RoadScene& scene,
                                          const std::vector<cv::Mat>& images,
                                          const NormalPrior& prior, double predicted) {
  DirectPlaneEstimator estimator(options);
  DirectPlaneEstimator::Result result;
  for (std::uint32_t i = 0; i < images.size(); ++i) {
    result = estimator.estimate(scene.frame(i), images[i], prior, std::nullopt, predicted);
  }
  return result;
}

std::vector<cv::Mat> imagesOf(const RoadScene& scene, int frames) {
  std::vector<cv::Mat> images;
  for (int i = 0; i < frames; ++i) images.push_back(roadImage(scene, scene.step * i));
  return images;
}

TEST(DirectPlaneEstimator, FindsHeightAndNormalInAnyUnitAndMounting) {
  struct Case {
    double unit;
    PinholeCamera camera;
    double pitch, roll;
    double predicted;  // relative to the height
  };
  const Case kCases[] = {{0.01, {900, 320, 650, 650, 450, 130}, 0.03, 0, 1.06},
                         {1, {900, 400, 650, 800, 450, 160}, 0.03, 0, 1.06},  // fx is not fy
                         {300, {640, 240, 500, 500, 320, 110}, -0.03, 0.05, 0.95},
                         {1, {640, 240, 180, 180, 320, 110}, 0.08, 0.05, 0.95}};
  for (const Case& each : kCases) {
    SCOPED_TRACE(each.unit);
    RoadScene scene = inUnit(each.unit, nearRoad());
    scene.camera = each.camera;
    scene.pitch = each.pitch;
    scene.roll = each.roll;
    const auto result = drive(scene, each.predicted * scene.height);
    ASSERT_EQ(result.status, ScaleReason::kNone);
    EXPECT_NEAR(result.plane.height / scene.height, 1, each.camera.fx < 600 ? 0.006 : 0.002);
    EXPECT_NEAR((result.plane.n_c - scene.normal()).norm(), 0, 0.003);
    EXPECT_GT(result.correlation, 0.9);
    EXPECT_LT(result.height_sigma / scene.height, each.camera.fx < 600 ? 0.03 : 0.01);
    EXPECT_FALSE(result.searched);
  }
}

/// Texture of a road with these curvatures along and across it and this twist [1 / camera height]
/// (positive: it falls off) where the ray to (x, z) of the flat road meets it, for a camera that
/// has travelled so far [camera heights].
std::function<double(double, double)> curvedAsphalt(double curvature, double travelled,
                                                    double crown = 0, double twist = 0) {
  return [=](double x, double z) {
    const double ahead = z - travelled;  // s = 1 + drop * s^2
    const double drop = 0.5 * curvature * ahead * ahead + 0.5 * crown * x * x + twist * x * ahead;
    if (4 * drop > 1) return 30.0;  // beyond the crest: sky
    const double s = 2 / (1 + std::sqrt(1 - 4 * drop));
    return asphalt(x * s, travelled + (z - travelled) * s);
  };
}

// On a crowned road a plane through the region lies below the wheels: the height is too large.
TEST(DirectPlaneEstimator, ACrownedRoadDoesNotBiasTheHeightWithAnEstimatedLens) {
  RoadScene scene = nearRoad();
  std::vector<cv::Mat> images;
  for (int i = 0; i < 4; ++i) {
    const double at = scene.step * i;
    images.push_back(roadImage(scene, at, curvedAsphalt(0, at / scene.height, 0.05, 0.005)));
  }
  const NormalPrior prior = priorOf(scene, kPriorSigma);
  const DirectPlaneEstimator::Options options;
  const auto plane = estimateWith(options, scene, images, prior, scene.height);
  ASSERT_EQ(plane.status, ScaleReason::kNone);
  EXPECT_GT(plane.plane.height / scene.height, 1.008);
  scene.camera.lens_is_estimated = true;
  const auto quadric = estimateWith(options, scene, images, prior, scene.height);
  ASSERT_EQ(quadric.status, ScaleReason::kNone);
  EXPECT_NEAR(quadric.plane.height / scene.height, 1, 0.004);
}

// The height is that above the road below the vehicle, not above the road ahead.
TEST(DirectPlaneEstimator, ACrestAheadDoesNotBiasTheHeight) {
  const RoadScene scene = nearRoad();
  std::vector<cv::Mat> images;
  for (int i = 0; i < 6; ++i) {  // a radius of 1100 m at a camera height of 1.65 m
    const double at = scene.step * i;
    images.push_back(roadImage(scene, at, curvedAsphalt(0.0015, at / scene.height)));
  }
  const auto relativeErrorWith = [&](const DirectPlaneEstimator::Options& options) {
    const auto result = estimateWith(options, scene, images, priorOf(scene, kPriorSigma), 0.7);
    return std::abs(result.plane.height / scene.height - 1);
  };
  DirectPlaneEstimator::Options flat_road;
  flat_road.curvature_sigma = 1e-9;
  EXPECT_GT(relativeErrorWith(flat_road), 0.01);
  EXPECT_LT(relativeErrorWith({}), 0.8 * relativeErrorWith(flat_road));
}

TEST(DirectPlaneEstimator, ASearchFindsTheRollOfTheCamera) {
  RoadScene scene = nearRoad();
  NormalPrior prior = priorOf(scene, kPriorSigma);
  prior.roll_sigma = 0.1;
  scene.roll = 0.18;
  const auto result = estimateWith({}, scene, imagesOf(scene, 6), prior, 0);
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_TRUE(result.searched);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.02);
  EXPECT_NEAR((result.plane.n_c - scene.normal()).norm(), 0, 0.02);
}

TEST(DirectPlaneEstimator, IsInvariantToIlluminationAndExposure) {
  const RoadScene scene = nearRoad();
  const auto result = drive(scene, scene.height, 4, [](std::uint32_t i, cv::Mat* image) {
    image->convertTo(*image, -1, 1 - 0.15 * (i % 3), 20.0 * (i % 2));
    cv::Mat ramp(image->size(), CV_8U);  // and a brightness ramp in every second image
    for (int u = 0; u < ramp.cols; ++u) ramp.col(u).setTo(u * (i % 2) * 40 / ramp.cols);
    *image += ramp;
  });
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.006);
}

TEST(DirectPlaneEstimator, WithoutTextureAcrossThePathTheHeightIsNotObserved) {
  const RoadScene scene = nearRoad();
  const double predicted = 1.03 * scene.height;
  const auto bare = [](double, double) { return 110.0; };
  EXPECT_EQ(drive(scene, predicted, 4, nullptr, bare).status, ScaleReason::kNoPlane);
  EXPECT_EQ(drive(scene, 0, 4, nullptr, bare).status, ScaleReason::kNoPlane);
  // Lines along the path look the same at every distance.
  const auto lines = [](double x, double) { return asphalt(x, 0); };
  EXPECT_EQ(drive(scene, predicted, 4, nullptr, lines).status, ScaleReason::kNoPlane);
  // A little other texture suffices for a height, with a larger standard deviation.
  const auto weak = [](double x, double z) { return asphalt(x, 0) + 0.03 * (asphalt(x, z) - 110); };
  const auto some = drive(scene, predicted, 4, nullptr, weak), full = drive(scene, predicted);
  ASSERT_EQ(some.status, ScaleReason::kNone);
  EXPECT_GT(some.height_sigma, 1.1 * full.height_sigma);
  EXPECT_LT(std::abs(some.plane.height - scene.height), 3 * some.height_sigma);
}

/// Textured region that is static in the image.
Change staticRegion(const cv::Rect& place) {
  return [place](std::uint32_t, cv::Mat* image) {
    for (int v = place.y; v < place.br().y; ++v) {
      for (int u = place.x; u < place.br().x; ++u) {
        image->at<std::uint8_t>(v, u) =
            static_cast<std::uint8_t>(90 + 60 * smoothNoise(u, v, 6, 7));
      }
    }
  };
}

TEST(DirectPlaneEstimator, AVehicleInTheLaneRegionIsRejected) {
  const RoadScene scene = nearRoad();
  const auto result = drive(scene, scene.height, 4, staticRegion({270, 60, 60, 60}));
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.006);
}

TEST(DirectPlaneEstimator, TheEngineHoodIsDetectedAndMasked) {
  RoadScene scene = nearRoad();
  scene.camera = {620, 240, 359.0, 359.0, 310.0, 92.0};
  const Change hood = staticRegion({0, 170, 620, 70});
  DirectPlaneEstimator estimator({}), fresh({});
  EXPECT_NE(drive(&fresh, scene, 0, 4, hood).status, ScaleReason::kNone);
  const auto result = drive(&estimator, scene, scene.height, 25, hood);
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.015);
  EXPECT_GT(result.correlation, 0.8);  // without the patches on the hood

  // A new map is seen from the same vehicle. Its search does not use the hood either.
  estimator.reset();
  const auto searched = drive(&estimator, scene, 0, 4, hood);
  EXPECT_EQ(searched.status, ScaleReason::kNone);
  EXPECT_TRUE(searched.searched);
}

// In neither image: patches of the newest one below the region project into it in the reference
// image. Images whose focal length is large are reduced, here to half the width and height; the
// size is no multiple.
TEST(DirectPlaneEstimator, DoesNotUseAMaskedRegion) {
  const RoadScene scene = nearRoad();
  RoadScene large = scene;
  const PinholeCamera& camera = scene.camera;
  large.camera = {5 * camera.width + 1, 5 * camera.height + 2, 5 * camera.fx,
                  5 * camera.fy,        5 * camera.cx + 2,     5 * camera.cy + 2};
  struct Case {
    const RoadScene& scene;
    cv::Rect region;
    std::uint32_t frames;
    double predicted;  // 0: with a search
  };
  for (const Case& each : {Case{scene, {200, 130, 120, 30}, 8, 1.03 * scene.height},
                           Case{scene, {200, 130, 120, 30}, 8, 0},
                           Case{large, {1001, 649, 601, 151}, 3, 1.03 * scene.height}}) {
    SCOPED_TRACE(each.region.width + each.predicted);
    cv::Mat mask(each.scene.camera.height, each.scene.camera.width, CV_8U, cv::Scalar(255));
    mask(each.region).setTo(0);
    const auto run = [&](bool has_noise, bool is_masked = true) {
      DirectPlaneEstimator estimator({});
      DirectPlaneEstimator::Result result;
      for (std::uint32_t i = 0; i < each.frames; ++i) {
        cv::Mat image = roadImage(each.scene, scene.step * i);
        cv::Mat part = image(each.region);
        if (has_noise) cv::RNG(i + 1).fill(part, cv::RNG::UNIFORM, 0, 256);
        result = estimator.estimate(each.scene.frame(i), image, priorOf(scene, kPriorSigma),
                                    std::nullopt, each.predicted, {}, is_masked ? mask : cv::Mat());
      }
      return result;
    };
    const auto masked = run(false), with_noise = run(true);
    EXPECT_NE(run(true, false).plane.height, masked.plane.height);
    ASSERT_EQ(masked.status, ScaleReason::kNone);
    EXPECT_NEAR(masked.plane.height / scene.height, 1, 0.005);
    EXPECT_NEAR((masked.plane.n_c - scene.normal()).norm(), 0, 0.003);
    EXPECT_EQ(with_noise.plane.height, masked.plane.height);
    EXPECT_EQ(with_noise.plane.n_c, masked.plane.n_c);
    EXPECT_EQ(with_noise.height_sigma, masked.height_sigma);
  }
}

TEST(DirectPlaneEstimator, AWrongPredictionIsCorrectedOrRejected) {
  const RoadScene scene = nearRoad();
  for (const double factor : {0.3, 0.5, 0.75, 1.25, 2.0, 3.0}) {
    const auto result = drive(scene, factor * scene.height);
    if (result.status == ScaleReason::kNone) {
      EXPECT_NEAR(result.plane.height / scene.height, 1, 0.01) << factor;
    }
  }
}

TEST(DirectPlaneEstimator, TheSearchFindsTheRoad) {
  struct Case {
    double unit;
    double lane_ratio, other_ratio;  // of the features' heights to the road's
    double search_range;
    double step;  // [camera heights]
    std::uint32_t frames;
  };
  const double range = DirectPlaneEstimator::Options().search_range;
  for (const Case& each :
       {Case{0.001, 1, 1, range, 0.57, 8}, Case{5000, 0.2, 0.2, range, 0.57, 8},
        Case{1, 4, 4, range, 0.57, 8}, Case{1, 1, 0.3, 1.5, 0.57, 8},  // buildings beside the road
        Case{1, 1, 1, range, 0.01, 80}}) {                             // a slow vehicle
    SCOPED_TRACE(testing::Message() << each.unit << ' ' << each.other_ratio << ' ' << each.step);
    RoadScene scene = inUnit(each.unit, nearRoad());
    scene.step = each.step * scene.height;
    DirectPlaneEstimator::Options options;
    options.search_range = each.search_range;
    DirectPlaneEstimator estimator(options);
    DirectPlaneEstimator::Result result;
    for (std::uint32_t i = 0; i < each.frames && result.status != ScaleReason::kNone; ++i) {
      VoFrame frame = scene.frame(i);
      for (TrackedFeature& feature : frame.features) {
        const bool in_lane = std::abs(feature.p_c.x()) < 1.2 * scene.height;
        feature.p_c *= static_cast<float>(in_lane ? each.lane_ratio : each.other_ratio);
      }
      result = estimator.estimate(frame, roadImage(scene, scene.step * i),
                                  priorOf(scene, kPriorSigma), std::nullopt, 0);
    }
    ASSERT_EQ(result.status, ScaleReason::kNone);
    EXPECT_TRUE(result.searched);
    EXPECT_NEAR(result.plane.height / scene.height, 1, 0.015);
  }
}

// The nearest visible road is 9.5 camera heights ahead, that of max_ahead_heights 10.
TEST(DirectPlaneEstimator, TheRegionOfATeleLensContainsVisibleRoad) {
  RoadScene scene = nearRoad();
  scene.pitch = 0;
  scene.camera = {620, 188, 900.0, 900.0, 310.0, 92.0};
  DirectPlaneEstimator::Options options;
  options.patch_size = 0.01;
  const auto result =
      estimateWith(options, scene, imagesOf(scene, 5), priorOf(scene, kPriorSigma), scene.height);
  EXPECT_GE(result.patches, options.min_patches);
}

TEST(DirectPlaneEstimator, TheSearchFindsNothingWithoutRoad) {
  const RoadScene scene = nearRoad();
  // A vehicle that fills the view, and noise without any road.
  const Change filled = staticRegion({0, 0, 620, 188});
  const Change noise = [](std::uint32_t i, cv::Mat* image) {
    cv::theRNG().state = i + 1;
    cv::randu(*image, 0, 255);
    cv::GaussianBlur(*image, *image, {0, 0}, 2);
  };
  for (const Change& change : {filled, noise}) {
    DirectPlaneEstimator estimator({});
    for (std::uint32_t frames = 2; frames < 8; ++frames) {
      EXPECT_NE(drive(&estimator, scene, 0, frames, change).status, ScaleReason::kNone);
    }
  }
}

// The vehicle drives over a hill, and its rear-facing camera sees the part that it has passed. The
// plane tangent to that part does not pass below the newest camera, so the result is the height of
// an earlier camera of the path, the one nearest to the lane region.
TEST(DirectPlaneEstimator, ARearFacingCameraGivesTheHeightOfAnEarlierCamera) {
  constexpr double kCurvature = 0.003;  // [1 / camera height]; a radius of 550 m at 1.65 m
  RoadScene scene = nearRoad();
  scene.step = -0.3;
  NormalPrior prior = priorOf(scene, kPriorSigma);
  prior.forward_c = -prior.forward_c;
  CameraPath path;
  DirectPlaneEstimator estimator({});
  DirectPlaneEstimator::Result result;
  for (std::uint32_t i = 0; i < 40; ++i) {
    // In the camera's axes the hill is the same everywhere, because the curvature is constant.
    const double travelled = scene.step * i / scene.height;
    VoFrame frame = scene.frame(i);
    const double z = travelled * scene.height;
    // Pose of the camera on the hill in the road axes r of RoadScene.
    Eigen::Isometry3d T_r_c = Eigen::Isometry3d::Identity();
    T_r_c.translate(Eigen::Vector3d(0, -0.5 * kCurvature / scene.height * z * z, z));
    T_r_c.rotate(Eigen::AngleAxisd(kCurvature / scene.height * z, Eigen::Vector3d::UnitX()));
    T_r_c.rotate(scene.rotation());
    frame.T_w_c = T_r_c;
    path.add(frame.T_w_c, prior, 0.3, 20 * scene.height);
    const cv::Mat image = roadImage(scene, scene.step * i, curvedAsphalt(-kCurvature, travelled));
    result = estimator.estimate(frame, image, prior, std::nullopt, scene.height, path);
  }
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.01);
  EXPECT_NEAR(result.road_distance / scene.height, 1, 0.1);  // from that camera
  EXPECT_LT(result.height_sigma / scene.height, 0.01);
}

// A search is expensive: it is not repeated in every frame.
TEST(DirectPlaneEstimator, ASearchIsDueAfterADistanceOrAReset) {
  const RoadScene scene = inUnit(100, nearRoad());
  const double wrong = 2.5 * scene.height;
  DirectPlaneEstimator estimator({});
  EXPECT_TRUE(drive(&estimator, scene, wrong, 2).searched);
  EXPECT_FALSE(drive(&estimator, scene, wrong, 2).searched);
  estimator.reset();
  EXPECT_EQ(drive(&estimator, scene, scene.height, 1).status, ScaleReason::kStandstill);
  EXPECT_TRUE(drive(&estimator, scene, wrong, 2).searched);
  int found = 0;
  for (std::uint32_t i = 2; i < 25; ++i) {
    const auto result = estimator.estimate(scene.frame(i), roadImage(scene, scene.step * i),
                                           priorOf(scene, kPriorSigma), std::nullopt, wrong);
    if (result.status != ScaleReason::kNone) continue;
    ++found;
    EXPECT_TRUE(result.searched);
    EXPECT_NEAR(result.plane.height / scene.height, 1, 0.01);
  }
  EXPECT_GE(found, 1);
  EXPECT_LT(found, 10);
}

// The poses of the older reference image are wrong, so the search finds another height with it.
TEST(DirectPlaneEstimator, ASearchWhoseHeightsDisagreeIsRejected) {
  const RoadScene scene = nearRoad();
  const std::vector<cv::Mat> images = imagesOf(scene, 4);
  DirectPlaneEstimator::Options any;  // accepts any plane that the search finds
  any.min_correlation = 0;
  any.max_sigma = 10;
  any.max_height_change = 100;
  const Eigen::Vector3d last_w = scene.frame(3).T_w_c.translation();
  for (const double factor : {0.8, 1.0, 1.25}) {
    DirectPlaneEstimator estimator(any);
    DirectPlaneEstimator::Result result;
    for (std::uint32_t i = 0; i < 4; ++i) {
      VoFrame frame = scene.frame(i);
      if (i < 2) frame.T_w_c.translation() += (factor - 1) * (frame.T_w_c.translation() - last_w);
      result = estimator.estimate(frame, images[i], priorOf(scene, kPriorSigma), std::nullopt, 0);
    }
    EXPECT_EQ(result.status, factor == 1 ? ScaleReason::kNone : ScaleReason::kNoPlane) << factor;
  }
}

TEST(DirectPlaneEstimator, EachErrorEntersTheSigma) {
  const RoadScene scene = nearRoad();
  const std::vector<cv::Mat> images = imagesOf(scene, 4);
  using Options = DirectPlaneEstimator::Options;
  const auto errors = {&Options::rotation_sigma_rad, &Options::direction_sigma_rad,
                       &Options::roughness_heights, &Options::curvature_sigma};
  const auto sigmaWith = [&](double Options::*error) {
    Options options;
    for (const auto other : errors) options.*other = 1e-6;
    if (error) options.*error = 0.01;
    const auto result =
        estimateWith(options, scene, images, priorOf(scene, kPriorSigma), scene.height);
    EXPECT_EQ(result.status, ScaleReason::kNone);
    return result.height_sigma;
  };
  const double without = sigmaWith(nullptr);
  for (const auto error : errors) EXPECT_GT(sigmaWith(error), 1.2 * without);
}

TEST(DirectPlaneEstimator, ThePriorsOfPitchAndRollAreIndependent) {
  const RoadScene scene = nearRoad();
  const std::vector<cv::Mat> images = imagesOf(scene, 4);
  RoadScene pitched = scene, rolled = scene;
  pitched.pitch += 0.01;
  rolled.roll += 0.01;
  const auto normalWith = [&](const RoadScene& expected, double pitch_sigma, double roll_sigma) {
    NormalPrior prior = priorOf(expected);
    prior.pitch_sigma = pitch_sigma;
    prior.roll_sigma = roll_sigma;
    const auto result = estimateWith({}, scene, images, prior, scene.height);
    EXPECT_EQ(result.status, ScaleReason::kNone);
    return result.plane.n_c;
  };
  constexpr double kTight = 1e-5, kLoose = 0.05;
  EXPECT_LT((normalWith(pitched, kLoose, kTight) - scene.normal()).norm(), 0.003);
  EXPECT_LT((normalWith(pitched, kTight, kLoose) - pitched.normal()).norm(), 0.003);
  EXPECT_LT((normalWith(rolled, kTight, kLoose) - scene.normal()).norm(), 0.004);
  EXPECT_LT((normalWith(rolled, kLoose, kTight) - rolled.normal()).norm(), 0.003);
}

TEST(DirectPlaneEstimator, ANewCameraAndANewMaskAreUsed) {
  const RoadScene scene = nearRoad();
  RoadScene other = scene;
  other.camera = {620, 188, 359, 364, 315, 92};
  DirectPlaneEstimator estimator({});
  drive(&estimator, other, scene.height, 1);
  const auto result = drive(&estimator, scene, 1.03 * scene.height);
  EXPECT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height, drive(scene, 1.03 * scene.height).plane.height, 1e-9);
  const cv::Mat mask(scene.camera.height, scene.camera.width, CV_8U, cv::Scalar(0));
  const auto masked =
      estimator.estimate(scene.frame(4), roadImage(scene, 4 * scene.step),
                         priorOf(scene, kPriorSigma), std::nullopt, scene.height, {}, mask);
  EXPECT_NE(masked.status, ScaleReason::kNone);
}

}  // namespace
}  // namespace ground_scale_vo
