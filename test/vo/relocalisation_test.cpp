#include "vo/relocalisation.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "support/scene.hpp"
#include "support/wall.hpp"
#include "vo/frame_to_frame_tracking.hpp"

namespace ground_scale_vo {
namespace {

using test::pose;

using test::kCamera;
const Eigen::Vector3d kPredicted = 20 * test::kStep;

/// The previous camera v is somewhere in the map. The map points of every tenth feature are wrong,
/// and every tenth has none.
class RelocalisationTest : public testing::Test {
 protected:
  explicit RelocalisationTest(int repetitions = 1) : repetitions_(repetitions) {
    tracking_.advance(tracking_.pyramid(wallFrom(Eigen::Isometry3d::Identity())), test::kPeriod,
                      {});
    tracking_.detectNew();
    features_ = tracking_.features();
    std::vector<LocalMap::Corner> corners = toCorners(kCamera, features_);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      features_[i].age = 3;
      features_[i].flow = {7, 8};
      if (i % 10 == 0) corners[i].x.y() += kWrong;
    }
    map_.addKeyframe(T_w_v_, corners);
    test::putOnWall(&map_);
    for (auto& [id, landmark] : map_.landmarks()) {
      if (id % 10 == 5) landmark.depth.reset();
    }
  }

  cv::Mat wallFrom(const Eigen::Isometry3d& T_v_c) const {
    return test::wallFrom(kCamera, T_v_c, 1, repetitions_);
  }

  std::optional<Relocalisation::Result> locate(const Eigen::Isometry3d& T_v_c) const {
    const Descriptors next = tracking_.describeCorners(tracking_.pyramid(wallFrom(T_v_c)));
    return Relocalisation(kCamera, {})
        .locate(map_, motion_, features_, tracking_.describeFeatures(), next, test::kAfterGap);
  }

  void expectToLocate(const Eigen::Isometry3d& T_v_c) const {
    const auto result = locate(T_v_c);
    ASSERT_TRUE(result);
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT(test::angleBetween(found, T_v_c), 0.005);
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.2);
  }

  static constexpr double kWrong = 0.09;  // [normalised], 42 px
  const int repetitions_;                 // of the wall's texture
  // The depths in the world are small.
  const Eigen::Isometry3d T_w_v_ = pose({0.1, 0.2, -0.1}, {5, 6, -17});
  FrameToFrameTracking tracking_{kCamera, {}, {}};
  LocalMap map_{{}};
  MotionModel motion_ = test::motionTo(T_w_v_);
  std::vector<Feature> features_;
};

TEST_F(RelocalisationTest, FindsPoseAndFeaturesNearAndFarFromThePrediction) {
  for (const double yaw : {0.03, -0.2}) {
    const Eigen::Isometry3d T_v_c = pose({0, yaw, 0}, kPredicted);
    const auto result = locate(T_v_c);
    ASSERT_TRUE(result) << yaw;
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT(test::angleBetween(found, T_v_c), 0.005) << yaw;
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.2) << yaw;
    EXPECT_GT(result->features.size(), 40u) << yaw;
    std::size_t far_away = 0;  // by chance, a wrong point projects to a similar corner
    const std::vector<Feature> previous = entriesOf(result->features, features_);
    for (std::size_t i = 0; i < previous.size(); ++i) {
      const Feature& feature = result->features[i];
      EXPECT_TRUE(map_.point(feature.id)) << "without a point it cannot agree with the pose";
      EXPECT_EQ(feature.age, 4u);
      EXPECT_EQ(feature.flow, Eigen::Vector2d::Zero());
      EXPECT_NEAR(feature.sigma * kCamera.fx, 1.4, 0.1) << "[px]";
      const Eigen::Vector3d p_v = test::kWallDistance * kCamera.ray(previous[i].u);
      far_away += (feature.u - kCamera.project(T_v_c.inverse() * p_v)).norm() > 6;
    }
    EXPECT_LE(far_away, 1u) << yaw;
  }
}

// In different directions. The first search only has to find a rough pose.
TEST_F(RelocalisationTest, FindsThePoseAlthoughMostPointsAreWrong) {
  for (auto& [id, landmark] : map_.landmarks()) {
    if (id % 10 > 4) continue;
    const auto direction = static_cast<double>(id);
    landmark.observations.front().x +=
        kWrong * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  }
  expectToLocate(pose({0, -0.2, 0}, kPredicted));
}

// Its texture repeats itself every 5 VO units, so it has the same corner in many places.
class RepetitiveWall : public RelocalisationTest {
 protected:
  RepetitiveWall() : RelocalisationTest(30) {}
};

TEST_F(RepetitiveWall, IsMatchedNearThePrediction) {
  expectToLocate(pose({0, 0.03, 0}, kPredicted));
}

TEST_F(RelocalisationTest, LimitsTheDeviationFromTheExtrapolatedPosition) {
  // At most half of the predicted distance (3) and a tenth of the median depth (20).
  EXPECT_TRUE(locate(pose({0, 0, 0}, kPredicted + Eigen::Vector3d(2.8, 0, 0))));
  EXPECT_FALSE(locate(pose({0, 0, 0}, kPredicted + Eigen::Vector3d(4.2, 0, 0))));
}

}  // namespace
}  // namespace ground_scale_vo
