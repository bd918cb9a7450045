#include "scale/direct_plane_estimator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "simulation/tools/distortion.hpp"
#include "support/road_image.hpp"

namespace gsv {
namespace {

constexpr double kPriorSigma = 0.012;  // of pitch and roll [rad]
constexpr double kExactLens = 1e-9;    // standard deviation of k1 and k2

/// sigma: of k1 and k2.
DirectPlaneEstimator::Options withLensSigma(double sigma) {
  DirectPlaneEstimator::Options options;
  options.lens_k1_sigma = options.lens_k2_sigma = sigma;
  return options;
}

/// Grey level at a point of the road, as in roadImage().
using Texture = std::function<double(double, double)>;

RoadScene nearRoad() {
  RoadScene scene;
  scene.pitch = 0.03;
  scene.addPatch(1500, -2.5, 2.5, 0, 15, 0, 1);
  return scene;
}

/// Images of frame 0, 1 ... of the scene.
std::vector<cv::Mat> imagesOf(const RoadScene& scene, int frames,
                              const Texture& texture = asphalt) {
  std::vector<cv::Mat> images;
  for (int i = 0; i < frames; ++i) images.push_back(roadImage(scene, scene.step * i, texture));
  return images;
}

/// An estimator and the path of its camera in a scene.
class Drive {
 public:
  explicit Drive(const RoadScene& scene, const DirectPlaneEstimator::Options& options = {})
      : prior(priorOf(scene, kPriorSigma)),
        predicted(scene.height),
        scene_(scene),
        estimator_(options) {}

  PlaneMeasurement next(const VoFrame& frame, const cv::Mat& image) {
    path_.add({frame.stamp_ns, frame.T_w_c}).prior = prior;
    RoadImage road;
    const PlaneMeasurement result =
        estimator_.estimate(frame, image, predicted, path_, mask, &road);
    path_.keepRoad(road);
    return result;
  }
  /// Result for the camera at this distance along the road [VO units].
  PlaneMeasurement nextAt(double at) { return next(scene_.frameAt(0, at), roadImage(scene_, at)); }
  /// Result for the last of the images of frame 0, 1 ...
  PlaneMeasurement run(const std::vector<cv::Mat>& images) {
    PlaneMeasurement result;
    for (std::uint32_t i = 0; i < images.size(); ++i) {
      result = next(scene_.frame(i), images[i]);
    }
    return result;
  }

  RoadPrior prior;
  double predicted;  // height [VO units]; 0: none
  cv::Mat mask;

 private:
  const RoadScene scene_;
  DirectPlaneEstimator estimator_;
  CameraPath path_;
};

TEST(DirectPlaneEstimator, FindsHeightAndNormalInAnyUnitAndMounting) {
  struct Case {
    double unit;
    PinholeCamera camera;
    double pitch, roll;
    double predicted;  // relative to the height; 0: from the features
  };
  const Case kCases[] = {{0.01, {900, 320, 650, 650, 450, 130}, 0.03, 0, 1.06},
                         {1, {900, 400, 650, 800, 450, 160}, 0.03, 0, 1.06},  // fx is not fy
                         {300, {640, 240, 500, 500, 320, 110}, -0.03, 0.05, 0.95},
                         {1, {640, 240, 180, 180, 320, 110}, 0.08, 0.05, 0.95},
                         {5, {640, 240, 500, 500, 320, 110}, 0.03, 0, 0}};
  for (const Case& each : kCases) {
    SCOPED_TRACE(each.unit);
    RoadScene scene = inUnit(each.unit, nearRoad());
    scene.camera = each.camera;
    scene.pitch = each.pitch;
    scene.roll = each.roll;
    Drive drive(scene, withLensSigma(kExactLens));
    drive.predicted *= each.predicted;
    const auto result = drive.run(imagesOf(scene, 4));
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    EXPECT_NEAR(result.plane.height / scene.height, 1, each.camera.fx < 600 ? 0.008 : 0.002);
    EXPECT_NEAR((result.plane.n_c - scene.normal()).norm(), 0, 0.003);
    EXPECT_GT(result.correlation, 0.9);
    EXPECT_LT(result.sigma / scene.height, each.camera.fx < 600 ? 0.03 : 0.01);
  }
}

TEST(DirectPlaneEstimator, TheHeightDoesNotDependOnARadialDistortion) {
  const RoadScene scene = nearRoad();
  const auto heightOfImages = [&](double k1, double sigma) {
    const Distortion distortion(scene.camera, Lens{scene.camera, k1, 0});
    std::vector<cv::Mat> images = imagesOf(scene, 4);
    for (cv::Mat& image : images) image = distortion.image(image);
    const auto result = Drive(scene, withLensSigma(sigma)).run(images);
    EXPECT_EQ(result.status, MeasurementStatus::kMeasured);
    return result.plane.height / scene.height;
  };
  constexpr double kK1 = 0.05, kUnknown = 0.2;
  EXPECT_GT(std::abs(heightOfImages(kK1, kExactLens) - heightOfImages(-kK1, kExactLens)), 0.01);
  EXPECT_NEAR(heightOfImages(kK1, kUnknown), heightOfImages(-kK1, kUnknown), 0.004);
}

/// Texture of a road with these curvatures along and across it and this twist [1 / camera height]
/// (positive: it falls off) where the ray to (x, z) of the flat road meets it, for a camera that
/// has travelled so far [camera heights].
Texture curvedAsphalt(double curvature, double travelled, double crown = 0, double twist = 0) {
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
  const auto plane = Drive(scene, withLensSigma(kExactLens)).run(images);
  ASSERT_EQ(plane.status, MeasurementStatus::kMeasured);
  EXPECT_GT(plane.plane.height / scene.height, 1.008);
  scene.camera.lens_is_estimated = true;
  const auto quadric = Drive(scene, withLensSigma(kExactLens)).run(images);
  ASSERT_EQ(quadric.status, MeasurementStatus::kMeasured);
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
    return std::abs(Drive(scene, options).run(images).plane.height / scene.height - 1);
  };
  DirectPlaneEstimator::Options flat_road;
  flat_road.curvature_sigma = 1e-9;
  EXPECT_GT(relativeErrorWith(flat_road), 0.01);
  EXPECT_LT(relativeErrorWith({}), 0.8 * relativeErrorWith(flat_road));
}

TEST(DirectPlaneEstimator, IsInvariantToIlluminationAndExposureAndAVehicleInTheLaneRegion) {
  const RoadScene scene = nearRoad();
  std::vector<cv::Mat> exposed = imagesOf(scene, 4), with_vehicle = imagesOf(scene, 4);
  for (int i = 0; i < 4; ++i) {
    cv::Mat& image = exposed[static_cast<std::size_t>(i)];
    image.convertTo(image, -1, 1 - 0.15 * (i % 3), 20.0 * (i % 2));
    cv::Mat ramp(image.size(), CV_8U);  // and a brightness ramp in every second image
    for (int u = 0; u < ramp.cols; ++u) ramp.col(u).setTo(u * (i % 2) * 40 / ramp.cols);
    image += ramp;
  }
  cv::Mat vehicle(60, 60, CV_8U);  // static in the image
  for (int i = 0; i < 3600; ++i) {
    vehicle.data[i] =
        static_cast<std::uint8_t>(90 + 60 * smoothNoise(270 + i % 60, 60 + i / 60, 6, 7));
  }
  for (cv::Mat& image : with_vehicle) vehicle.copyTo(image({270, 60, 60, 60}));
  for (const auto& images : {exposed, with_vehicle}) {
    const auto result = Drive(scene).run(images);
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    EXPECT_NEAR(result.plane.height / scene.height, 1, 0.006);
  }
}

TEST(DirectPlaneEstimator, WithoutTextureAcrossThePathTheHeightIsNotObserved) {
  const RoadScene scene = nearRoad();
  const auto measure = [&](const Texture& texture, double predicted = 1.03) {
    Drive drive(scene);
    drive.predicted *= predicted;
    return drive.run(imagesOf(scene, 4, texture));
  };
  const auto bare = [](double, double) { return 110.0; };
  EXPECT_EQ(measure(bare).status, MeasurementStatus::kNoPlane);
  EXPECT_EQ(measure(bare, 0).status, MeasurementStatus::kNoPlane);
  // Lines along the path look the same at every distance.
  const auto lines = [](double x, double) { return asphalt(x, 0); };
  EXPECT_EQ(measure(lines).status, MeasurementStatus::kNoPlane);
  // A little other texture suffices for a height, with a larger standard deviation.
  const auto weak = [](double x, double z) { return asphalt(x, 0) + 0.03 * (asphalt(x, z) - 110); };
  const auto some = measure(weak), full = measure(asphalt);
  ASSERT_EQ(some.status, MeasurementStatus::kMeasured);
  EXPECT_GT(some.sigma, 1.1 * full.sigma);
  EXPECT_LT(std::abs(some.plane.height - scene.height), 3 * some.sigma);
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
    int frames;
  };
  for (const Case& each :
       {Case{scene, {200, 130, 120, 30}, 8}, Case{large, {1001, 649, 601, 151}, 3}}) {
    SCOPED_TRACE(each.region.width);
    cv::Mat mask(each.scene.camera.height, each.scene.camera.width, CV_8U, cv::Scalar(255));
    mask(each.region).setTo(0);
    const std::vector<cv::Mat> images = imagesOf(each.scene, each.frames);
    const auto run = [&](bool has_noise, bool is_masked = true) {
      Drive drive(each.scene);
      drive.predicted *= 1.03;
      if (is_masked) drive.mask = mask;
      PlaneMeasurement result;
      for (std::uint32_t i = 0; i < images.size(); ++i) {
        cv::Mat image = images[i].clone(), part = image(each.region);
        if (has_noise) cv::RNG(i + 1).fill(part, cv::RNG::UNIFORM, 0, 256);
        result = drive.next(each.scene.frame(i), image);
      }
      return result;
    };
    const auto masked = run(false), with_noise = run(true);
    EXPECT_NE(run(true, false).plane.height, masked.plane.height);
    ASSERT_EQ(masked.status, MeasurementStatus::kMeasured);
    EXPECT_NEAR(masked.plane.height / scene.height, 1, 0.005);
    EXPECT_NEAR((masked.plane.n_c - scene.normal()).norm(), 0, 0.003);
    EXPECT_EQ(with_noise.plane.height, masked.plane.height);
    EXPECT_EQ(with_noise.plane.n_c, masked.plane.n_c);
    EXPECT_EQ(with_noise.sigma, masked.sigma);
  }
}

TEST(DirectPlaneEstimator, AWrongPredictionIsCorrectedOrRejected) {
  const RoadScene scene = nearRoad();
  const std::vector<cv::Mat> images = imagesOf(scene, 4);
  for (const double factor : {0.3, 0.5, 0.75, 1.25, 2.0, 3.0}) {
    Drive drive(scene);
    drive.predicted *= factor;
    const auto result = drive.run(images);
    if (result.status == MeasurementStatus::kMeasured) {
      EXPECT_NEAR(result.plane.height / scene.height, 1, 0.01) << factor;
    }
  }
}

// The nearest visible road is 9.5 camera heights ahead, max_ahead_heights is 10.
TEST(DirectPlaneEstimator, TheRegionOfATeleLensContainsVisibleRoad) {
  RoadScene scene = nearRoad();
  scene.pitch = 0;
  scene.camera = {620, 188, 900.0, 900.0, 310.0, 92.0};
  DirectPlaneEstimator::Options options;
  options.patch_size = 0.01;
  EXPECT_GE(Drive(scene, options).run(imagesOf(scene, 5)).support, 24);
}

// The vehicle drives over a hill, and its rear-facing camera sees the part that it has passed. The
// plane tangent to that part does not pass below the newest camera, so the result is the height of
// an earlier camera of the path, the one nearest to the lane region.
TEST(DirectPlaneEstimator, ARearFacingCameraGivesTheHeightOfAnEarlierCamera) {
  constexpr double kCurvature = 0.003;  // [1 / camera height]; a radius of 550 m at 1.65 m
  RoadScene scene = nearRoad();
  scene.step = -0.3;
  Drive drive(scene);
  drive.prior.forward_c *= -1;
  PlaneMeasurement result;
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
    result =
        drive.next(frame, roadImage(scene, scene.step * i, curvedAsphalt(-kCurvature, travelled)));
  }
  ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
  EXPECT_NEAR(result.plane.height / scene.height, 1, 0.01);
  EXPECT_NEAR(result.road_distance / scene.height, 1, 0.1);  // from that camera
  EXPECT_LT(result.sigma / scene.height, 0.01);
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
    const auto result = Drive(scene, options).run(images);
    EXPECT_EQ(result.status, MeasurementStatus::kMeasured);
    return result.sigma;
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
    Drive drive(scene);
    drive.prior = priorOf(expected);
    drive.prior.pitch_sigma = pitch_sigma;
    drive.prior.roll_sigma = roll_sigma;
    const auto result = drive.run(images);
    EXPECT_EQ(result.status, MeasurementStatus::kMeasured);
    return result.plane.n_c;
  };
  constexpr double kTight = 1e-5, kLoose = 0.05;
  EXPECT_LT((normalWith(pitched, kLoose, kTight) - scene.normal()).norm(), 0.003);
  EXPECT_LT((normalWith(pitched, kTight, kLoose) - pitched.normal()).norm(), 0.003);
  EXPECT_LT((normalWith(rolled, kTight, kLoose) - scene.normal()).norm(), 0.004);
  EXPECT_LT((normalWith(rolled, kLoose, kTight) - rolled.normal()).norm(), 0.003);
}

TEST(DirectPlaneEstimator, AReferenceIsNeitherTooNearNorTooFar) {
  const RoadScene scene = nearRoad();
  const auto statusAfter = [&](std::initializer_list<double> positions) {  // [camera heights]
    Drive drive(scene);
    PlaneMeasurement result;
    for (const double at : positions) result = drive.nextAt(at * scene.height);
    return result.status;
  };
  EXPECT_EQ(statusAfter({0}), MeasurementStatus::kStandstill);
  EXPECT_EQ(statusAfter({0, 0.1}), MeasurementStatus::kStandstill);
  EXPECT_EQ(statusAfter({0, 12}), MeasurementStatus::kStandstill);
  EXPECT_EQ(statusAfter({0, 0.7}), MeasurementStatus::kMeasured);
  // Slow: the older images are kept, at distances of up to two baselines.
  Drive slow(scene);
  PlaneMeasurement result;
  for (int i = 0; i < 40; ++i) result = slow.nextAt(0.05 * i * scene.height);
  const auto two_baselines = Drive(scene).run(imagesOf(scene, 4));
  EXPECT_EQ(result.status, MeasurementStatus::kMeasured);
  EXPECT_LT(result.sigma, 1.5 * two_baselines.sigma);
}

TEST(DirectPlaneEstimator, ImagesOfAnotherCameraOrMaskAreNoReference) {
  const RoadScene scene = nearRoad();
  RoadScene other = scene;
  other.camera = {620, 188, 359, 364, 315, 92};
  Drive drive(scene);
  const auto next = [&](const RoadScene& camera, std::uint32_t i) {
    return drive.next(camera.frame(i), roadImage(camera, scene.step * i)).status;
  };
  next(other, 0);
  EXPECT_EQ(next(other, 1), MeasurementStatus::kMeasured);
  EXPECT_EQ(next(scene, 2), MeasurementStatus::kStandstill);
  EXPECT_EQ(next(scene, 3), MeasurementStatus::kMeasured);
  drive.mask = cv::Mat::zeros(scene.camera.height, scene.camera.width, CV_8U);
  EXPECT_NE(next(scene, 4), MeasurementStatus::kMeasured);
}

/// Part of the step between two frames that falls into the readout: 30 ms at 10 Hz.
constexpr double kReadoutPart = 0.3;

/// Image of a rolling shutter, in strips of rows with one pose each.
cv::Mat rollingRoadImage(const RoadScene& scene, double at) {
  constexpr int kRows = 2;
  cv::Mat image;
  for (int first = 0; first < scene.camera.height; first += kRows) {
    RoadScene strip = scene;
    strip.camera.height = std::min(kRows, scene.camera.height - first);
    strip.camera.cy -= first;
    const double share = scene.camera.readoutShare(first + (strip.camera.height - 1) / 2.0);
    image.push_back(roadImage(strip, at + kReadoutPart * share * scene.step));
  }
  return image;
}

TEST(DirectPlaneEstimator, PatchesOfARollingShutterAreWarpedWithThePosesOfTheirRows) {
  RoadScene scene = nearRoad();
  scene.step = 0.5 * scene.height;
  const auto relativeError = [&](bool is_compensated) {
    Drive drive(scene);
    drive.prior = priorOf(scene, 0.002);
    PlaneMeasurement result;
    for (std::uint32_t i = 0; i < 4; ++i) {
      VoFrame frame = scene.frame(i);
      if (is_compensated) {
        frame.readout_motion.tail<3>() =
            scene.rotation().transpose() * Eigen::Vector3d(0, 0, kReadoutPart * scene.step);
      }
      result = drive.next(frame, rollingRoadImage(scene, scene.step * i));
    }
    EXPECT_EQ(result.status, MeasurementStatus::kMeasured);
    return std::abs(result.plane.height / scene.height - 1);
  };
  EXPECT_GT(relativeError(false), 0.02);
  EXPECT_LT(relativeError(true), 0.005);
}

}  // namespace
}  // namespace gsv
