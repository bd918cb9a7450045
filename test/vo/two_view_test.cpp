#include "ground_scale_vo/vo/two_view.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/vo/triangulation.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::angleBetween;
using test::normalised;
using test::pose;
using test::randomPoints;
using test::roadPoints;
using test::testCamera;

/// Matched pixels of two images.
struct Views {
  std::vector<Eigen::Vector2d> u1, u2;
};

/// Projects the points into both images; noise_px: standard deviation in the second one.
Views project(const std::vector<Eigen::Vector3d>& points, const Eigen::Isometry3d& T_2_1,
              double noise_px = 0) {
  std::mt19937 generator(5);
  std::normal_distribution<double> noise(0, noise_px > 0 ? noise_px : 1);
  Views views;
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3d p2 = T_2_1 * p;
    if (p2.z() < 1) continue;
    views.u1.push_back(testCamera().project(p));
    views.u2.push_back(testCamera().project(p2));
    if (noise_px > 0) views.u2.back() += Eigen::Vector2d(noise(generator), noise(generator));
  }
  return views;
}

/// Moves every fifth pixel of the second image anywhere.
void addOutliers(Views* views) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> anywhere(0, 248);
  for (std::size_t i = 0; i < views->u2.size(); i += 5) {
    views->u2[i] = {3 * anywhere(generator), anywhere(generator)};
  }
}

void expectMotion(const TwoView::Result& result, const Eigen::Isometry3d& T_2_1,
                  double max_rotation_error_rad, double max_direction_error_rad) {
  ASSERT_EQ(result.status, TwoViewStatus::kOk);
  EXPECT_LT(angleBetween(result.T_2_1, T_2_1), max_rotation_error_rad);
  EXPECT_GT(result.T_2_1.translation().dot(T_2_1.translation().normalized()),
            std::cos(max_direction_error_rad));
  EXPECT_NEAR(result.T_2_1.translation().norm(), 1, 1e-9);
}

TEST(TwoView, findsTheMotionAmongScatteredPoints) {
  const Eigen::Isometry3d T_2_1 = pose({0.01, 0.04, -0.005}, {0.1, 0.02, -1.5});
  const Views views = project(randomPoints(400, 1), T_2_1, 0.3);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  expectMotion(result, T_2_1, 0.003, 0.03);
}

TEST(TwoView, givesTheDepthsInUnitsOfTheBaseline) {
  const Eigen::Isometry3d T_2_1 = pose({0, 0.02, 0}, {1, 0, 0});
  const auto points = randomPoints(300, 2);
  const Views views = project(points, T_2_1);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  ASSERT_EQ(result.status, TwoViewStatus::kOk);
  ASSERT_EQ(result.inlier.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (result.inlier[i]) {
      EXPECT_NEAR(result.inverse_depth_1[i] * points[i].z(), 1, 1e-2);
    }
  }
}

TEST(TwoView, findsTheMotionInAMostlyPlanarScene) {
  const Eigen::Isometry3d T_2_1 = pose({0.005, 0.02, 0}, {0.05, 0, -1.5});
  auto points = roadPoints(400, 3);
  const auto others = randomPoints(80, 14);
  points.insert(points.end(), others.begin(), others.end());
  const Views views = project(points, T_2_1, 0.1);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  expectMotion(result, T_2_1, 0.01, 0.08);
}

// The homography of a plane has two physically valid decompositions. The second one here is a
// camera that moves downwards in front of a frontal wall (translation and normal exchanged).
TEST(TwoView, aPlaneAloneIsAmbiguous) {
  const Views views = project(roadPoints(400, 3), pose({0.005, 0.02, 0}, {0.05, 0, -1.5}), 0.1);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  EXPECT_EQ(result.status, TwoViewStatus::kAmbiguous);
}

// Obliquely towards a wall: the other solution moves straight towards an oblique wall, with nearly
// the same rotation.
TEST(TwoView, motionsOfTheSameRotationCanBeAmbiguous) {
  std::vector<Eigen::Vector3d> wall;
  for (const Eigen::Vector3d& p : randomPoints(400, 3)) wall.push_back(10 / p.z() * p);
  const Views views = project(wall, pose({0, 0.005, 0}, {0.16, 0, -0.6}), 0.05);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  EXPECT_EQ(result.status, TwoViewStatus::kAmbiguous);
}

TEST(TwoView, isRobustAgainstWrongMatches) {
  const Eigen::Isometry3d T_2_1 = pose({0, 0.03, 0}, {0.1, 0, -1.5});
  Views views = project(randomPoints(400, 4), T_2_1, 0.2);
  std::mt19937 generator(6);
  std::uniform_real_distribution<double> x(0, 799), y(0, 247);
  for (std::size_t i = 0; i < views.u2.size(); i += 4) views.u2[i] = {x(generator), y(generator)};
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  expectMotion(result, T_2_1, 0.004, 0.04);
}

TEST(TwoView, reportsTooLittleParallaxForPureRotationAndStandstill) {
  const Views turning = project(randomPoints(400, 7), pose({0.002, 0.06, 0}, {0, 0, 0}), 0.2);
  EXPECT_EQ(TwoView({}).estimate(testCamera(), turning.u1, turning.u2).status,
            TwoViewStatus::kTooLittleParallax);
  const Views standing = project(randomPoints(400, 8), Eigen::Isometry3d::Identity(), 0.2);
  EXPECT_EQ(TwoView({}).estimate(testCamera(), standing.u1, standing.u2).status,
            TwoViewStatus::kTooLittleParallax);
}

TEST(TwoView, usesAllMatchesDespiteNoise) {
  const Eigen::Isometry3d T_2_1 = pose({0.01, 0.06, -0.005}, {0.1, 0.02, -1.5});
  const Views views = project(randomPoints(400, 1), T_2_1, 0.7);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  expectMotion(result, T_2_1, 0.001, 0.01);
}

TEST(TwoView, estimatesTheRotationWithAndWithoutParallax) {
  for (const double baseline : {0.0, 0.05, 0.5, 3.0}) {
    const Eigen::Isometry3d T_2_1 = pose({0.01, 0.3, -0.005}, {0, 0, -baseline});
    Views views = project(randomPoints(400, 1), T_2_1, 0.3);
    addOutliers(&views);
    const auto rotation = TwoView({}).estimateRotation(testCamera(), views.u1, views.u2);
    ASSERT_TRUE(rotation) << baseline;
    const Eigen::Isometry3d estimated(Eigen::Quaterniond(rotation->R_2_1));
    EXPECT_LT(angleBetween(estimated, T_2_1), 2 * rotation->sigma) << baseline;
    EXPECT_LT(rotation->sigma, 0.01) << baseline;
    if (baseline == 0) {
      EXPECT_EQ(rotation->sigma, TwoView::Options().inlier_threshold);
      EXPECT_LT(angleBetween(estimated, T_2_1), 3e-4);
    }
  }
  EXPECT_FALSE(TwoView({}).estimateRotation(testCamera(), {}, {}));
}

// A rotation about the vertical axis moves the points of a side camera almost as a short way does.
TEST(TwoView, theRotationOfASideCameraContainsNoTranslation) {
  for (const double baseline : {0.2, 0.3, 0.5}) {
    const Eigen::Isometry3d T_2_1 = pose({0, 0.03, 0}, {-baseline, 0, 0});
    const Views views = project(randomPoints(300, 1), T_2_1, 0.3);
    const auto rotation = TwoView({}).estimateRotation(testCamera(), views.u1, views.u2);
    ASSERT_TRUE(rotation) << baseline;
    const Eigen::Isometry3d estimated(Eigen::Quaterniond(rotation->R_2_1));
    EXPECT_LT(angleBetween(estimated, T_2_1), 2 * rotation->sigma) << baseline;
    EXPECT_LT(rotation->sigma, 0.005) << baseline;
  }
}

TEST(TwoView, rejectsFewOrRandomMatches) {
  const Views few = project(randomPoints(20, 9), pose({0, 0, 0}, {1, 0, 0}));
  EXPECT_EQ(TwoView({}).estimate(testCamera(), few.u1, few.u2).status,
            TwoViewStatus::kTooFewMatches);
  Views nonsense = project(randomPoints(300, 10), pose({0, 0, 0}, {1, 0, 0}));
  std::mt19937 generator(11);
  std::shuffle(nonsense.u2.begin(), nonsense.u2.end(), generator);
  EXPECT_NE(TwoView({}).estimate(testCamera(), nonsense.u1, nonsense.u2).status,
            TwoViewStatus::kOk);
}

TEST(TwoView, inliersHavePositiveDepths) {
  auto points = randomPoints(300, 15);
  for (const Eigen::Vector3d& p : randomPoints(100, 16)) points.push_back(1e5 * p);
  const Views views = project(points, pose({0, 0.02, 0}, {0.1, 0, -1.5}), 0.3);
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  ASSERT_EQ(result.status, TwoViewStatus::kOk);
  int behind = 0;  // from noise
  for (std::size_t i = 0; i < result.inlier.size(); ++i) {
    behind += result.inverse_depth_1[i] < 0;
    if (result.inlier[i]) {
      EXPECT_GT(result.inverse_depth_1[i], 0);
    }
  }
  EXPECT_GT(behind, 20);
}

TEST(TwoView, needsTheMinimumParallax) {
  const TwoView::Options options;
  const Views views = project(randomPoints(400, 17), pose({0, 0.02, 0}, {0, 0, -0.6}), 0.1);
  const auto result = TwoView(options).estimate(testCamera(), views.u1, views.u2);
  EXPECT_GT(result.median_parallax, 0.6 * options.min_parallax);
  EXPECT_LT(result.median_parallax, 0.95 * options.min_parallax);
  EXPECT_EQ(result.status, TwoViewStatus::kTooLittleParallax);
}

TEST(TwoView, outliersHaveNoParallax) {
  Views views = project(randomPoints(400, 17), pose({0, 0.02, 0}, {0, 0, -0.6}), 0.1);
  for (std::size_t i = 0; i < views.u2.size(); ++i) {
    if (i % 5 < 2) views.u2[i] += Eigen::Vector2d(0, i % 2 == 0 ? 60 : -60);
  }
  const auto result = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  EXPECT_EQ(result.status, TwoViewStatus::kTooLittleParallax);
}

TEST(TwoView, theRotationOfPointsOnOneLineIsNoReflection) {
  const Eigen::Isometry3d T_2_1 = pose({0, 0.06, 0}, {0, 0, 0});
  for (int row = 99; row < 140; row += 4) {
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 60; ++i) points.push_back(10 * testCamera().ray({150 + 8 * i, row}));
    Views views = project(points, T_2_1);
    for (std::size_t i = 0; i < views.u2.size(); i += 5) views.u2[i].y() += 60;  // outliers
    const auto rotation = TwoView({}).estimateRotation(testCamera(), views.u1, views.u2);
    ASSERT_TRUE(rotation);
    EXPECT_NEAR(rotation->R_2_1.determinant(), 1, 1e-9) << row;
    EXPECT_LT((rotation->R_2_1 - T_2_1.linear()).norm(), 1e-3) << row;
  }
}

TEST(TwoView, theSigmaOfARotationIncludesNoiseAndAmbiguity) {
  const TwoView::Options options;
  const Views exact = project(randomPoints(400, 1), pose({0, 0.06, 0}, {0, 0, 0}));
  const auto rotation = TwoView(options).estimateRotation(testCamera(), exact.u1, exact.u2);
  ASSERT_TRUE(rotation);
  EXPECT_EQ(rotation->sigma, options.inlier_threshold);
  // As in aPlaneAloneIsAmbiguous.
  const Views plane = project(roadPoints(400, 3), pose({0.005, 0.02, 0}, {0.05, 0, -1.5}), 0.1);
  const auto ambiguous = TwoView(options).estimateRotation(testCamera(), plane.u1, plane.u2);
  ASSERT_TRUE(ambiguous);
  EXPECT_GT(ambiguous->sigma, 0.1);
}

TEST(TwoView, aRotationNeedsTheMinimumShareOfInliers) {
  Views standing = project(randomPoints(400, 8), Eigen::Isometry3d::Identity(), 0.2);
  addOutliers(&standing);
  TwoView::Options options;
  options.min_inlier_share = 0.6;
  EXPECT_TRUE(TwoView(options).estimateRotation(testCamera(), standing.u1, standing.u2));
  options.min_inlier_share = 0.85;
  EXPECT_FALSE(TwoView(options).estimateRotation(testCamera(), standing.u1, standing.u2));
}

TEST(TwoView, noRotationFromFewOrRandomMatches) {
  Views views = project(randomPoints(300, 10), pose({0, 0.06, 0}, {1, 0, 0}));
  const auto rotationOf = [&](std::ptrdiff_t n) {
    return TwoView({}).estimateRotation(testCamera(), {views.u1.begin(), views.u1.begin() + n},
                                        {views.u2.begin(), views.u2.begin() + n});
  };
  EXPECT_TRUE(rotationOf(40));
  EXPECT_FALSE(rotationOf(39));
  std::mt19937 generator(11);
  std::shuffle(views.u2.begin(), views.u2.end(), generator);
  EXPECT_FALSE(rotationOf(300));
}

TEST(TwoView, isDeterministic) {
  const Views views = project(randomPoints(300, 12), pose({0, 0.03, 0}, {0.1, 0, -1.5}), 0.3);
  const auto a = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  const auto b = TwoView({}).estimate(testCamera(), views.u1, views.u2);
  EXPECT_EQ(a.T_2_1.matrix(), b.T_2_1.matrix());
}

TEST(TwoView, rejectsOptionsOutOfRange) {
  TwoView::Options options;
  options.min_matches = 3;
  EXPECT_THROW(TwoView{options}, OptionError);
  options = {};
  options.min_parallax = 0;
  EXPECT_THROW(TwoView{options}, OptionError);
}

TEST(Triangulation, isExactWithoutNoise) {
  const Eigen::Vector3d p(1, -0.5, 8);
  std::vector<RayObservation> observations;
  for (const double x : {0.5, 1.0, 1.5}) {
    const Eigen::Isometry3d T = pose({0, 0.01 * x, 0}, {x, 0, -x});
    observations.push_back({T, normalised(T * p), 1e-3});
  }
  const auto depth = triangulate(p / p.z(), observations);
  ASSERT_TRUE(depth);
  EXPECT_NEAR(1 / depth->value, 8, 1e-9);
  EXPECT_GT(depth->sigma, 0);
}

TEST(Triangulation, sigmaMatchesRepeatedMeasurements) {
  const Eigen::Vector3d p(1, -0.5, 8);
  const Eigen::Isometry3d T = pose({0, 0.01, 0}, {0.7, 0, -1});
  std::mt19937 generator(13);
  std::normal_distribution<double> noise(0, 1e-3);
  double sum2 = 0, sigma = 0;
  const int n = 500;
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector2d x =
        normalised(T * p) + Eigen::Vector2d(noise(generator), noise(generator));
    const auto depth = triangulate(p / p.z(), {{T, x, 1e-3}});
    ASSERT_TRUE(depth);
    sum2 += (depth->value - 1 / p.z()) * (depth->value - 1 / p.z());
    sigma = depth->sigma;
  }
  EXPECT_NEAR(std::sqrt(sum2 / n) / sigma, 1, 0.15);
}

TEST(Triangulation, isEmptyWithoutBaseline) {
  const Eigen::Vector3d ray(0.1, 0, 1);
  EXPECT_FALSE(triangulate(ray, {}));
  EXPECT_FALSE(triangulate(ray, {{Eigen::Isometry3d::Identity(), ray.head<2>(), 1e-3}}));
}

}  // namespace
}  // namespace ground_scale_vo
