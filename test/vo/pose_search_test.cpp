// The two searches for the pose after an interruption.

#include <gtest/gtest.h>

#include <cmath>

#include "support/scene.hpp"
#include "support/wall.hpp"
#include "vo/descriptors.hpp"
#include "vo/recovery.hpp"

namespace gsv {
namespace {

using test::kCamera;
using test::pose;

/// The previous camera v is somewhere in the map, where the depths in the world are small. Its
/// features are on a grid in which a repetitive wall repeats itself after eight columns.
class WallTest : public testing::Test {
 protected:
  explicit WallTest(int repetitions = 1) : repetitions_(repetitions) {
    std::vector<Observation> corners;
    for (double v = 20; v < kCamera.height - 20; v += 16) {
      for (double u = 20; u < kCamera.width - 20; u += 14.5) {
        Feature feature;
        feature.id = features_.size();
        feature.age = 3;
        feature.u = {u, v};
        feature.flow = {7, 8};
        features_.push_back(feature);
        corners.push_back({feature.id, kCamera.ray(feature.u).head<2>(), 0.001});
      }
    }
    map_.addKeyframe(T_w_v_, corners);
    test::putOnWall(&map_);
  }

  cv::Mat wallFrom(const Eigen::Isometry3d& T_v_c, std::uint64_t seed = 1) const {
    return test::wallFrom(kCamera, T_v_c, seed, repetitions_);
  }
  Eigen::Vector2d pixelAt(const Eigen::Isometry3d& T_v_c, const Feature& feature) const {
    return kCamera.project(T_v_c.inverse() *
                           (test::kWallDistance * kCamera.ray(features_[feature.id].u)));
  }
  std::optional<RelocalisedPose> search(const cv::Mat& image, const cv::Mat& mask = {}) const {
    return locateBySearch(kCamera, mask, map_, motion_, features_,
                          wallFrom(Eigen::Isometry3d::Identity()), image, test::kAfterGap);
  }
  /// By the descriptors of the features in both images.
  std::optional<RelocalisedPose> relocalise(const Eigen::Isometry3d& T_v_c) const {
    std::vector<cv::Point2f> previous, next;
    for (const Feature& feature : features_) {
      previous.push_back(toCv(feature.u));
      next.push_back(toCv(pixelAt(T_v_c, feature)));
    }
    return locateByDescriptors(kCamera, map_, motion_, features_,
                               {wallFrom(Eigen::Isometry3d::Identity()), previous},
                               {wallFrom(T_v_c), next}, test::kAfterGap);
  }
  /// Expects the pose and features at their projections.
  void expectLocated(const std::optional<RelocalisedPose>& result,
                     const Eigen::Isometry3d& T_v_c) const {
    ASSERT_TRUE(result);
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT(test::angleBetween(found, T_v_c), 0.005);
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.2);
    EXPECT_GT(result->features.size(), 60u);
    std::size_t far_away = 0;  // by chance, a wrong point projects to a similar corner
    for (const Feature& feature : result->features) {
      EXPECT_TRUE(map_.point(feature.id)) << "without a point it cannot agree with the pose";
      EXPECT_EQ(feature.age, 4u);
      EXPECT_EQ(feature.flow, Eigen::Vector2d::Zero());
      EXPECT_NEAR(feature.sigma * kCamera.fx, 1, 0.7) << "[px]";
      far_away += (feature.u - pixelAt(T_v_c, feature)).norm() > 6;
    }
    EXPECT_LE(far_away, result->features.size() / 25);
  }

  const int repetitions_;  // of the wall's texture
  const Eigen::Isometry3d T_w_v_ = pose({0.1, 0.5, -0.2}, {5, 6, -17});
  LocalMap map_;
  MotionModel motion_ = test::motionTo(T_w_v_);
  std::vector<Feature> features_;
};

class PoseSearchTest : public WallTest {};

TEST_F(PoseSearchTest, AnInterruptionBeginsWithoutTheImagesOfTheOneBefore) {
  std::vector<cv::Point2f> corners;
  for (const Feature& feature : features_) corners.push_back(toCv(feature.u));
  const cv::Mat image = wallFrom(Eigen::Isometry3d::Identity());
  Interruption interruption(kCamera);
  for (const double sigma : {0.01, 0.2}) {
    RelativeRotation rotation;
    rotation.sigma = sigma;
    interruption.addImage(rotation, {image, corners});
    EXPECT_EQ(interruption.rotation().sigma, sigma);
    interruption.end();
  }
}

TEST_F(PoseSearchTest, FindsThePoseAfterATurnOrAChangeOfPitchOrSpeed) {
  for (const double yaw : {-0.45, 0.3}) {
    SCOPED_TRACE(yaw);
    // Along an arc of the length of 20 steps.
    const Eigen::Isometry3d T_v_c =
        pose({0, yaw, 0}, {3 * std::sin(yaw / 2), 0, 3 * std::cos(yaw / 2)});
    expectLocated(search(wallFrom(T_v_c)), T_v_c);
  }
  for (const double pitch : {-0.05, 0.05}) {
    const Eigen::Isometry3d T_v_c = pose({pitch, 0.1, 0}, {0, 0, 3});
    expectLocated(search(wallFrom(T_v_c)), T_v_c);
  }
  motion_ = test::motionTo(T_w_v_, {0, 0, 0.35});  // much nearer to the wall
  const Eigen::Isometry3d T_v_c = pose({0, 0.05, 0}, {0, 0, 9});
  expectLocated(search(wallFrom(T_v_c)), T_v_c);
}

TEST_F(PoseSearchTest, RotationSigmaIsConsistentWithTheErrorOfTheWorstAxis) {
  const Eigen::Isometry3d T_v_c = pose({0, 0.1, 0}, {0, 0, 3});
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  double sigma = 0;
  constexpr int kRuns = 8;
  for (int i = 0; i < kRuns; ++i) {
    cv::Mat image = wallFrom(T_v_c), noise(image.size(), CV_16SC1);
    cv::RNG(static_cast<std::uint64_t>(i)).fill(noise, cv::RNG::NORMAL, 0, 20);
    cv::add(image, noise, image, {}, CV_8U);
    const auto result = search(image);
    ASSERT_TRUE(result);
    const Eigen::AngleAxisd error(
        ((T_w_v_ * T_v_c).linear().transpose() * result->T_w_c.linear()).eval());
    squares += (error.angle() * error.axis()).cwiseAbs2();
    sigma += result->rotation_sigma / kRuns;
  }
  const Eigen::Vector3d rms = (squares / kRuns).cwiseSqrt();
  EXPECT_GT(sigma, 0.3 * rms.maxCoeff());
  EXPECT_LT(sigma, 3 * rms.maxCoeff());
}

// Half of the predicted distance (3, then 6) and a tenth of the median depth (20).
TEST_F(PoseSearchTest, LimitsTheDeviationFromThePredictedDistance) {
  EXPECT_TRUE(search(wallFrom(pose({0, 0, 0}, {4, 0, 3}))));
  EXPECT_FALSE(search(wallFrom(pose({0, 0, 0}, {7, 0, 3}))));
  motion_ = test::motionTo(T_w_v_, {0, 0, 0.3});
  EXPECT_FALSE(search(wallFrom(pose({0, 0, 0}, {0, 0, 0.5}))));
}

TEST_F(PoseSearchTest, FindsNothingInMaskedRegionsOrInAnImageOfAnotherPlace) {
  cv::Mat mask(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(255));
  const cv::Rect masked(250, 50, 300, 150);
  mask(masked).setTo(0);
  const Eigen::Isometry3d T_v_c = pose({0, 0.05, 0}, {0, 0, 3});
  const auto result = search(wallFrom(T_v_c), mask);
  expectLocated(result, T_v_c);
  for (const Feature& feature : result->features) {
    EXPECT_FALSE(masked.contains(toCv(feature.u))) << feature.u.transpose();
  }
  EXPECT_FALSE(search(wallFrom(Eigen::Isometry3d::Identity(), 2)));
}

const Eigen::Vector3d kPredicted = 20 * test::kStep;

class RelocalisationTest : public WallTest {};

// The map points of every tenth feature are wrong, and every tenth has none.
TEST_F(RelocalisationTest, FindsPoseAndFeaturesNearAndFarFromThePrediction) {
  for (Landmark& landmark : map_.landmarks()) {
    const std::uint64_t id = landmark.id();
    if (id % 10 == 0) landmark.observations.front().x.y() += 42 / kCamera.fy;
    if (id % 10 == 5) landmark.depth.reset();
  }
  for (const double yaw : {0.03, -0.2}) {
    SCOPED_TRACE(yaw);
    const Eigen::Isometry3d T_v_c = pose({0, yaw, 0}, kPredicted);
    expectLocated(relocalise(T_v_c), T_v_c);
  }
  const Eigen::Vector3d too_far = kPredicted + Eigen::Vector3d(4.2, 0, 0);
  EXPECT_FALSE(relocalise(pose({0, 0, 0}, too_far))) << "more than half of the distance";
}

// Its texture repeats itself every 5 VO units, so it has the same corner in many places.
class RepetitiveWall : public WallTest {
 protected:
  RepetitiveWall() : WallTest(30) {}
};

TEST_F(RepetitiveWall, IsMatchedNearThePrediction) {
  const Eigen::Isometry3d T_v_c = pose({0, 0.03, 0}, kPredicted);
  expectLocated(relocalise(T_v_c), T_v_c);
}

}  // namespace
}  // namespace gsv
