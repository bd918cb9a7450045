#include "vo/pose_search.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "support/scene.hpp"
#include "support/wall.hpp"
#include "vo/scaled_patches.hpp"

namespace ground_scale_vo {
namespace {

using test::pose;

using test::kCamera;

/// The previous camera v is somewhere in the map.
class PoseSearchTest : public testing::Test {
 protected:
  explicit PoseSearchTest(const PinholeCamera& camera = kCamera) : camera_(camera) {
    std::vector<LocalMap::Corner> corners;
    for (int v = 20; v < camera.height - 20; v += 16) {
      for (int u = 20; u < camera.width - 20; u += 16) {
        Feature feature;
        feature.id = features_.size();
        feature.age = 3;
        feature.u = {u, v};
        feature.flow = {7, 8};
        features_.push_back(feature);
        corners.push_back({feature.id, camera.ray(feature.u).head<2>(), 0.001});
      }
    }
    map_.addKeyframe(T_w_v_, corners);
    test::putOnWall(&map_);
  }

  cv::Mat wallFrom(const Eigen::Isometry3d& T_v_c, std::uint64_t seed) const {
    return test::wallFrom(camera_, T_v_c, seed);
  }
  std::optional<PoseSearch::Result> locate(const cv::Mat& image, const cv::Mat& mask = {}) const {
    return PoseSearch(camera_, {}, mask)
        .locate(map_, motion_, features_, wallFrom(Eigen::Isometry3d::Identity(), 1), image,
                test::kAfterGap);
  }
  Eigen::Vector2d pixelAt(const Eigen::Isometry3d& T_v_c, const Feature& feature) const {
    const Eigen::Vector3d p_v = test::kWallDistance * camera_.ray(features_[feature.id].u);
    return camera_.project(T_v_c.inverse() * p_v);
  }

  const PinholeCamera camera_;
  const Eigen::Isometry3d T_w_v_ = pose({0.1, 0.5, -0.2}, {5, 6, 7});
  LocalMap map_{{}};
  MotionModel motion_ = test::motionTo(T_w_v_);
  std::vector<Feature> features_;
};

TEST_F(PoseSearchTest, FindsThePoseAfterATurn) {
  for (const double yaw : {-0.45, -0.2, 0.3, 0.45}) {
    // Along an arc of the length of 20 steps.
    const Eigen::Isometry3d T_v_c =
        pose({0, yaw, 0}, {3 * std::sin(yaw / 2), 0, 3 * std::cos(yaw / 2)});
    const auto result = locate(wallFrom(T_v_c, 1));
    ASSERT_TRUE(result) << yaw;
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT(test::angleBetween(found, T_v_c), 0.003) << yaw;
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.1) << yaw;
    EXPECT_GT(result->rotation_sigma, 1e-5);
    EXPECT_LT(result->rotation_sigma, 1e-2);
    EXPECT_GT(result->features.size(), 100u);
    for (const Feature& feature : result->features) {
      EXPECT_EQ(feature.age, 4u);
      EXPECT_EQ(feature.flow, Eigen::Vector2d::Zero());
      EXPECT_NEAR(feature.sigma * kCamera.fx, 1, 1e-9) << "[px]";
      EXPECT_LT((feature.u - pixelAt(T_v_c, feature)).norm(), 6);
    }
  }
}

TEST_F(PoseSearchTest, FindsThePoseAfterAChangeOfPitchOrSpeed) {
  for (const double pitch : {-0.05, 0.05}) {
    const Eigen::Isometry3d T_v_c = pose({pitch, 0.1, 0}, {0, 0, 3});
    const auto result = locate(wallFrom(T_v_c, 1));
    ASSERT_TRUE(result) << pitch;
    EXPECT_LT(test::angleBetween(T_w_v_.inverse() * result->T_w_c, T_v_c), 0.003) << pitch;
  }
  motion_ = test::motionTo(T_w_v_, {0, 0, 0.3});
  for (const double factor : {0.7, 1.4}) {
    const Eigen::Isometry3d T_v_c = pose({0, 0.05, 0}, {0, 0, 6 * factor});
    const auto result = locate(wallFrom(T_v_c, 1));
    ASSERT_TRUE(result) << factor;
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.2) << factor;
  }
}

/// Pixels three times as high as wide.
class PoseSearchWithHighPixels : public PoseSearchTest {
 protected:
  static PinholeCamera camera() {
    PinholeCamera camera = kCamera;
    camera.fy = camera.fx / 3;
    return camera;
  }
  PoseSearchWithHighPixels() : PoseSearchTest(camera()) {}
};

TEST_F(PoseSearchWithHighPixels, TheRangeOfThePitchIsThatOfTheImage) {
  for (const double pitch : {-0.2, 0.2}) {
    const Eigen::Isometry3d T_v_c = pose({pitch, 0.1, 0}, {0, 0, 3});
    const auto result = locate(wallFrom(T_v_c, 1));
    ASSERT_TRUE(result) << pitch;
    EXPECT_LT(test::angleBetween(T_w_v_.inverse() * result->T_w_c, T_v_c), 0.005) << pitch;
  }
}

TEST_F(PoseSearchTest, TheSigmaOfTheRotationIsThatOfItsWorstAxis) {
  const Eigen::Isometry3d T_v_c = pose({0, 0.1, 0}, {0, 0, 3});
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  double sigma = 0;
  constexpr int kRuns = 8;
  for (int i = 0; i < kRuns; ++i) {
    cv::Mat image = wallFrom(T_v_c, 1), noise(image.size(), CV_16SC1);
    cv::RNG(static_cast<std::uint64_t>(i)).fill(noise, cv::RNG::NORMAL, 0, 20);
    cv::add(image, noise, image, {}, CV_8U);
    const auto result = locate(image);
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

TEST_F(PoseSearchTest, FindsThePoseMuchNearerToTheWall) {
  motion_ = test::motionTo(T_w_v_, {0, 0, 0.35});
  const Eigen::Isometry3d T_v_c = pose({0, 0.1, 0}, {0, 0, 7});
  const auto result = locate(wallFrom(T_v_c, 1));
  ASSERT_TRUE(result);
  const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
  EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.2);
}

TEST_F(PoseSearchTest, FeaturesThatDisagreeWithThePoseAreNoMatches) {
  for (auto& [id, landmark] : map_.landmarks()) {
    if (id % 10 == 0) landmark.observations.front().x.y() += 3.8 / kCamera.fy;
  }
  const auto result = locate(wallFrom(pose({0, 0, 0}, {0, 0, 3}), 1));
  ASSERT_TRUE(result);
  std::size_t wrong = 0;
  for (const Feature& feature : result->features) wrong += feature.id % 10 == 0;
  EXPECT_LT(wrong, result->features.size() / 50);
}

// Half of the predicted distance (3, then 6) and a tenth of the median depth (20).
TEST_F(PoseSearchTest, LimitsTheDeviationFromTheDistanceTravelled) {
  EXPECT_TRUE(locate(wallFrom(pose({0, 0, 0}, {4, 0, 3}), 1)));
  EXPECT_FALSE(locate(wallFrom(pose({0, 0, 0}, {7, 0, 3}), 1)));
  motion_ = test::motionTo(T_w_v_, {0, 0, 0.3});
  EXPECT_TRUE(locate(wallFrom(pose({0, 0, 0}, {0, 0, 1.5}), 1)));
  EXPECT_FALSE(locate(wallFrom(pose({0, 0, 0}, {0, 0, 0.5}), 1)));
}

TEST_F(PoseSearchTest, FindsNothingInTheMaskedRegion) {
  const Eigen::Isometry3d T_v_c = pose({0, 0.05, 0}, {0, 0, 3});
  cv::Mat mask(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(255));
  const cv::Rect masked(250, 50, 300, 150);
  mask(masked).setTo(0);
  const auto result = locate(wallFrom(T_v_c, 1), mask);
  ASSERT_TRUE(result);
  EXPECT_LT(test::angleBetween(T_w_v_.inverse() * result->T_w_c, T_v_c), 0.005);
  for (const Feature& feature : result->features) {
    EXPECT_FALSE(masked.contains(toCv(feature.u))) << feature.u.transpose();
  }
}

TEST_F(PoseSearchTest, FindsNoneInAnImageOfAnotherPlace) {
  EXPECT_FALSE(locate(wallFrom(Eigen::Isometry3d::Identity(), 2)));
}

}  // namespace
}  // namespace ground_scale_vo
