#include "vo/two_view.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "support/scene.hpp"

namespace gsv {
namespace {

using test::angleBetween;
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

/// Moves one in `every` pixels of the second image anywhere.
void addOutliers(std::size_t every, Views* views) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> anywhere(0, 248);
  for (std::size_t i = 0; i < views->u2.size(); i += every) {
    views->u2[i] = {3 * anywhere(generator), anywhere(generator)};
  }
}

std::optional<TwoViewMotion> estimate(const Views& views) {
  return estimateMotion(testCamera(), views.u1, views.u2);
}
RelativeRotation estimateRotation(const Views& views) {
  return gsv::estimateRotation(testCamera(), views.u1, views.u2);
}

bool isKnown(const RelativeRotation& rotation) { return std::isfinite(rotation.sigma); }

void expectMotion(const std::optional<TwoViewMotion>& result, const Eigen::Isometry3d& T_2_1,
                  double max_rotation_error_rad, double max_direction_error_rad) {
  ASSERT_TRUE(result);
  EXPECT_LT(angleBetween(result->T_2_1, T_2_1), max_rotation_error_rad);
  EXPECT_GT(result->T_2_1.translation().dot(T_2_1.translation().normalized()),
            std::cos(max_direction_error_rad));
  EXPECT_NEAR(result->T_2_1.translation().norm(), 1, 1e-9);
}

TEST(TwoView, FindsTheMotionDespiteNoiseOutliersAndAPlane) {
  struct Case {
    const char* name;
    Eigen::Isometry3d T_2_1;
    double noise_px;
    std::size_t outliers;  // one in so many; 0: none
    int on_road;           // additional points
    double max_rotation_error, max_direction_error;
  };
  const Case cases[] = {
      {"scattered", pose({0.01, 0.04, -0.005}, {0.1, 0.02, -1.5}), 0.3, 0, 0, 0.003, 0.03},
      {"noise", pose({0.01, 0.06, -0.005}, {0.1, 0.02, -1.5}), 0.7, 0, 0, 0.001, 0.01},
      {"outliers", pose({0, 0.03, 0}, {0.1, 0, -1.5}), 0.2, 4, 0, 0.004, 0.04},
      {"mostly planar", pose({0.005, 0.02, 0}, {0.05, 0, -1.5}), 0.1, 0, 2000, 0.01, 0.08}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    auto points = randomPoints(400, 1);
    const auto road = roadPoints(c.on_road, 3);
    points.insert(points.end(), road.begin(), road.end());
    Views views = project(points, c.T_2_1, c.noise_px);
    if (c.outliers > 0) addOutliers(c.outliers, &views);
    const auto result = estimate(views);
    expectMotion(result, c.T_2_1, c.max_rotation_error, c.max_direction_error);
    EXPECT_EQ(result->T_2_1.matrix(), estimate(views)->T_2_1.matrix()) << "is not deterministic";
  }
}

TEST(TwoView, InliersHaveTheirDepthsInUnitsOfTheBaseline) {
  auto points = randomPoints(300, 2);
  const Views exact = project(points, pose({0, 0.02, 0}, {1, 0, 0}));
  const auto result = estimate(exact);
  ASSERT_TRUE(result);
  EXPECT_GT(std::count(result->inlier.begin(), result->inlier.end(), true), 270);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (result->inlier[i]) {
      EXPECT_NEAR(result->inverse_depth_1[i] * points[i].z(), 1, 1e-2);
    }
  }
  // From noise, some of the distant points are behind the camera.
  for (const Eigen::Vector3d& p : randomPoints(100, 16)) points.push_back(1e5 * p);
  const auto with_noise = estimate(project(points, pose({0, 0.02, 0}, {0.1, 0, -1.5}), 0.3));
  ASSERT_TRUE(with_noise);
  int behind = 0;
  for (std::size_t i = 0; i < with_noise->inlier.size(); ++i) {
    behind += with_noise->inverse_depth_1[i] < 0;
    EXPECT_FALSE(with_noise->inlier[i] && with_noise->inverse_depth_1[i] <= 0);
  }
  EXPECT_GT(behind, 10);
}

// The homography of a plane has two physically valid decompositions. The second one of the road is
// a camera that moves downwards in front of a frontal wall (translation and normal exchanged).
// Obliquely towards a wall, the other solution moves straight towards an oblique wall, with nearly
// the same rotation.
TEST(TwoView, APlaneAloneIsAmbiguous) {
  const Views road = project(roadPoints(400, 3), pose({0.005, 0.02, 0}, {0.05, 0, -1.5}), 0.1);
  EXPECT_FALSE(estimate(road));
  const auto rotation = estimateRotation(road);
  EXPECT_GT(rotation.sigma, 0.1);
  EXPECT_LT(rotation.sigma, 4);
  std::vector<Eigen::Vector3d> wall;
  for (const Eigen::Vector3d& p : randomPoints(400, 3)) wall.push_back(10 / p.z() * p);
  EXPECT_FALSE(estimate(project(wall, pose({0, 0.005, 0}, {0.16, 0, -0.6}), 0.05)));
}

TEST(TwoView, ReportsTooLittleParallax) {
  const Views turning = project(randomPoints(400, 7), pose({0.002, 0.06, 0}, {0, 0, 0}), 0.2);
  EXPECT_FALSE(estimate(turning));
  const Views standing = project(randomPoints(400, 8), Eigen::Isometry3d::Identity(), 0.2);
  EXPECT_FALSE(estimate(standing));
  Views slow = project(randomPoints(400, 17), pose({0, 0.02, 0}, {0, 0, -0.6}), 0.1);
  EXPECT_FALSE(estimate(slow));
  for (std::size_t i = 0; i < slow.u2.size(); ++i) {  // outliers have no parallax
    if (i % 5 < 2) slow.u2[i] += Eigen::Vector2d(0, i % 2 == 0 ? 60 : -60);
  }
  EXPECT_FALSE(estimate(slow));
}

TEST(TwoView, FindsNoMotionOfFewOrRandomMatches) {
  Views views = project(randomPoints(300, 10), pose({0, 0.06, 0}, {1, 0, 0}));
  const auto first = [&](std::ptrdiff_t n) {
    return Views{{views.u1.begin(), views.u1.begin() + n},
                 {views.u2.begin(), views.u2.begin() + n}};
  };
  EXPECT_FALSE(estimate(first(20)));
  EXPECT_TRUE(isKnown(estimateRotation(first(40))));
  EXPECT_FALSE(isKnown(estimateRotation(first(20))));
  EXPECT_FALSE(isKnown(estimateRotation({})));
  std::mt19937 generator(11);
  std::shuffle(views.u2.begin(), views.u2.end(), generator);
  EXPECT_FALSE(estimate(views));
  EXPECT_FALSE(isKnown(estimateRotation(views)));
  for (const std::size_t every : {2, 1}) {
    Views standing = project(randomPoints(400, 8), Eigen::Isometry3d::Identity(), 0.2);
    addOutliers(every, &standing);
    EXPECT_EQ(isKnown(estimateRotation(standing)), every == 2) << "one outlier in " << every;
  }
}

// Also of a side camera: a rotation about the vertical axis moves its points almost as a short
// displacement does.
TEST(TwoView, EstimatesTheRotationWithAndWithoutParallax) {
  const auto expectRotation = [](const Views& views, const Eigen::Isometry3d& T_2_1,
                                 double max_sigma) {
    const auto rotation = estimateRotation(views);
    EXPECT_LT(angleBetween(rotation.R_2_1, T_2_1.linear()), 2 * rotation.sigma);
    EXPECT_LT(rotation.sigma, max_sigma);
    EXPECT_GT(rotation.sigma, 1e-4);
  };
  for (const double baseline : {0.0, 0.05, 0.2, 0.3, 0.5, 3.0}) {
    SCOPED_TRACE(baseline);
    const Eigen::Isometry3d T_2_1 = pose({0.01, 0.3, -0.005}, {0, 0, -baseline});
    Views ahead = project(randomPoints(400, 1), T_2_1, 0.3);
    addOutliers(5, &ahead);
    expectRotation(ahead, T_2_1, 0.01);
    if (baseline > 1) continue;
    const Eigen::Isometry3d to_the_side = pose({0, 0.03, 0}, {-baseline, 0, 0});
    expectRotation(project(randomPoints(300, 1), to_the_side, 0.3), to_the_side, 0.005);
  }
}

}  // namespace
}  // namespace gsv
