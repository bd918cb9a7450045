#include "vo/map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "support/scene.hpp"
#include "vo/mapping.hpp"

namespace gsv {
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

// At a standstill they would displace all others. But small steps add up: otherwise a camera that
// creeps would never get another keyframe.
TEST(Mapping, KeyframesAtOnePlaceReplaceEachOther) {
  const auto points = test::farPoints(150);
  Mapping mapping(test::kCamera, {});
  const auto& keyframes = mapping.map().keyframes();
  const Vector6d readout_motion = Vector6d::LinSpaced(0.1, 0.6);
  const auto add = [&](const Eigen::Isometry3d& T_w_c, std::uint64_t first_id = 0) {
    std::vector<Feature> features;
    for (const Observation& corner : observe(points, T_w_c)) {
      Feature feature;
      feature.id = first_id + corner.id;
      feature.u = test::kCamera.project(corner.x.homogeneous());
      feature.sigma = corner.sigma;
      features.push_back(feature);
    }
    double duration_ms = 0;
    mapping.addKeyframe(T_w_c, features, {}, readout_motion);
    EXPECT_EQ(keyframes.back().readout_motion, readout_motion);
    mapping.applyAdjustment(&duration_ms);
  };
  mapping.map().addKeyframe(keyframePose(0), observe(points, keyframePose(0)));
  for (const int k : {1, 2, 3, 3, 3, 3}) add(keyframePose(k));
  EXPECT_EQ(keyframes.size(), 5u);
  EXPECT_EQ(mapping.map().find(7)->observations.size(), 5u);
  for (const double step : {1, 2, 3}) {
    // About 0.7 of the least parallax between two places for each step.
    add(keyframePose(3) * pose({0, 0, 0}, {0.035 * step, 0, 0}));
    EXPECT_EQ(keyframes.size(), step < 3 ? 5u : 6u) << step;
  }
  // Without known features, after a gap of the images, it is not at the place of the last one.
  add(keyframePose(8), 1000);
  EXPECT_TRUE(keyframes.back().has_parallax);
}

}  // namespace
}  // namespace gsv
