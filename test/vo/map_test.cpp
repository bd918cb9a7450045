#include "vo/map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::keyframePose;
using test::kObservationSigma;
using test::observe;
using test::pose;

constexpr int kPoints = 300;
const Eigen::Vector3d kLandmark(2, -1, 8);

constexpr int kMostKeyframes = static_cast<int>(kMaxKeyframes);

/// The map of keyframes 0 to n - 1 that observe these points.
LocalMap mapOf(const std::vector<Eigen::Vector3d>& points, int n) {
  LocalMap map;
  for (int k = 0; k < n; ++k) {
    map.addKeyframe(keyframePose(k), observe(points, keyframePose(k)));
    map.triangulateNew();
  }
  return map;
}

// Landmarks outlive the keyframes in which they are anchored, and the map stays bounded.
TEST(LocalMap, HasTheTruePointsAlsoAfterTheirAnchorsLeft) {
  const auto points = test::farPoints(kPoints);
  for (const int keyframes : {3, 16, 20}) {
    const LocalMap map = mapOf(points, keyframes);
    EXPECT_EQ(map.keyframes().size(),
              static_cast<std::size_t>(std::min(kMostKeyframes, keyframes)));
    int with_depth = 0;
    for (const Landmark& landmark : map.landmarks()) {
      EXPECT_LE(landmark.observations.size(), kMaxKeyframes);
      const auto point = map.point(landmark);
      if (!point) continue;
      ++with_depth;
      EXPECT_LT((point->p_w - points[landmark.id()]).norm(), 1e-6 * points[landmark.id()].norm());
    }
    EXPECT_GT(with_depth, kPoints * 8 / 10);
  }
  LocalMap map = mapOf(points, 2);
  for (int k = 2; k < kMostKeyframes + 4; ++k) map.addKeyframe(keyframePose(k), {});
  EXPECT_TRUE(map.landmarks().empty()) << "they are no longer observed";
}

TEST(LocalMap, OnlyPreciseDepthsThatFitAllObservationsEnterIt) {
  struct Case {
    double error;  // of one observation, across the direction of motion
    double sigma;  // of the observations
    bool enters;
  };
  for (const Case& c :
       {Case{0, 5 * kObservationSigma, true}, Case{0.01, 5 * kObservationSigma, false},
        Case{0.002, 5 * kObservationSigma, true}, Case{0, 60 * kObservationSigma, false}}) {
    LocalMap map;
    for (int k = 0; k < 4; ++k) {
      auto corners = observe({kLandmark}, keyframePose(k));
      corners[0].sigma = c.sigma;
      if (k == 2) corners[0].x.y() += c.error;
      map.addKeyframe(keyframePose(k), corners);
    }
    map.triangulateNew();
    EXPECT_EQ(map.point(0).has_value(), c.enters) << c.error << ' ' << c.sigma;
  }
  LocalMap at_rest;
  for (int k = 0; k < 5; ++k) {
    at_rest.addKeyframe(keyframePose(0), observe({kLandmark}, keyframePose(0)));
  }
  at_rest.triangulateNew();
  EXPECT_FALSE(at_rest.point(0));
}

TEST(LocalMap, RemovesWrongObservationsAndPointsBehindTheCamera) {
  LocalMap map = mapOf({kLandmark, {1, 1, 9}, {1, 1, 10}, {-1, 1, 9}}, 3);
  auto corners = observe({kLandmark, {1, 1, 9}}, keyframePose(3));
  corners[0].x.x() += 0.05;
  map.addKeyframe(keyframePose(3), corners);
  const Eigen::Isometry3d behind = pose({0, 0, 0}, {0, 0, 20});
  map.addKeyframe(behind, {observe({kLandmark, {1, 1, 9}, {1, 1, 10}}, behind)[2]});
  map.find(3)->depth = InverseDepth{-0.1, 0.01};
  EXPECT_FALSE(map.point(3)) << "a negative depth";
  map.removeOutliers();
  EXPECT_EQ(map.find(0)->observations.size(), 3u);
  EXPECT_EQ(map.find(1)->observations.size(), 4u);
  EXPECT_EQ(map.find(2)->observations.size(), 3u);
  EXPECT_EQ(map.find(3), nullptr);
}

/// Standard deviation of a point along its ray [VO units], from random errors of its observations.
double sampledSigma(const Eigen::Vector3d& p_w, int keyframes) {
  std::mt19937 generator(5);
  std::normal_distribution<double> noise(0, kObservationSigma);
  double squares = 0;
  constexpr int kRuns = 500;
  for (int run = 0; run < kRuns; ++run) {
    LocalMap map;
    for (int k = 0; k < keyframes; ++k) {
      auto corners = observe({p_w}, keyframePose(k));
      if (k > 0) corners.at(0).x += Eigen::Vector2d(noise(generator), noise(generator));
      map.addKeyframe(keyframePose(k), corners);
    }
    map.triangulateNew();
    squares += (map.point(0).value().p_w - p_w).squaredNorm() / kRuns;
  }
  return std::sqrt(squares);
}

TEST(LocalMap, SigmaOfAPointIsConsistentAlsoWithANewAnchor) {
  constexpr int kKeyframes = 4;
  LocalMap map = mapOf({kLandmark}, kKeyframes);
  const double expected = sampledSigma(kLandmark, kKeyframes);
  const Eigen::Vector3d ray_w = kLandmark - keyframePose(0).translation();
  map.find(0)->depth->sigma = 1;
  map.updateSigmas();
  EXPECT_NEAR(map.point(0)->sigma_w.norm(), expected, 0.1 * expected);
  EXPECT_LT(map.point(0)->sigma_w.cross(ray_w.normalized()).norm(), 1e-9);
  map.find(0)->depth.reset();
  map.triangulateNew();
  EXPECT_NEAR(map.point(0)->sigma_w.norm(), expected, 0.1 * expected);
  for (int k = kKeyframes; k <= kMostKeyframes; ++k) {  // the last ones at one place, before it
    map.addKeyframe(keyframePose(4), observe({kLandmark}, keyframePose(4)));
  }
  ASSERT_EQ(map.find(0)->observations.front().keyframe, 1u);
  EXPECT_LT((map.point(0)->p_w - kLandmark).norm(), 1e-9);
  EXPECT_NEAR(map.point(0)->sigma_w.norm(), expected, 0.3 * expected);
}

TEST(LocalMap, ThereIsNoDepthInANewAnchorThatHasPassedThePoint) {
  LocalMap map;
  const std::vector<Observation> corners = observe({kLandmark}, keyframePose(0));
  map.addKeyframe(keyframePose(0), corners);
  map.find(0)->depth = InverseDepth{1.0 / 8, 0.01};
  for (int k = 1; k <= kMostKeyframes; ++k) {
    map.addKeyframe(pose({0, 0, 0}, {0, 0, 9.0 + k}), corners);
  }
  ASSERT_EQ(map.find(0)->observations.front().keyframe, 1u);
  EXPECT_FALSE(map.find(0)->depth);
}

}  // namespace
}  // namespace ground_scale_vo
