#include "vo/bundle_adjustment.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <random>

#include "support/scene.hpp"

namespace gsv {
namespace {

using test::angleBetween;
using test::keyframePose;
using test::kObservationSigma;
using test::normalised;
using test::observe;
using test::pose;

constexpr int kWindow = 7;  // [keyframes] that are optimised
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool adjust(LocalMap* map) {
  BundleAdjustment adjustment(kWindow);
  adjustment.load(*map);
  const bool usable = adjustment.solve();
  adjustment.store(map);
  return usable;
}

/// A realistic map: landmarks appear and disappear, their noise differs, a few observations are
/// wrong, and the newest poses are inaccurate.
LocalMap randomMap(int keyframes, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> error(0, 1);
  std::uniform_real_distribution<double> share(0, 1);
  const auto random = [&](double scale) {
    return Eigen::Vector3d(scale * error(generator), scale * error(generator),
                           scale * error(generator));
  };
  struct ObservedPoint {
    Eigen::Vector3d p_w;
    int first, last;  // keyframes that observe it
    double sigma;     // of an observation
  };
  std::vector<ObservedPoint> world;
  for (const Eigen::Vector3d& p : test::randomPoints(600, seed)) {
    const int first = static_cast<int>(share(generator) * keyframes) - 3;
    const int last = first + 1 + static_cast<int>(share(generator) * 10);
    const double sigma = share(generator) < 0.6 ? 0.3 * kObservationSigma : kObservationSigma;
    world.push_back({keyframePose(last) * p, first, last, sigma});
  }
  LocalMap map;
  for (int k = 0; k < keyframes; ++k) {
    std::vector<Observation> corners;
    for (std::size_t i = 0; i < world.size(); ++i) {
      const ObservedPoint& point = world[i];
      if (k < point.first || k > point.last) continue;
      const double outlier_factor = share(generator) < 0.03 ? 5 : 1;
      const Eigen::Vector2d noise = outlier_factor * point.sigma * random(1).head<2>();
      corners.push_back(
          {i, normalised(keyframePose(k).inverse() * point.p_w) + noise, point.sigma});
    }
    map.addKeyframe(keyframePose(k) * pose(random(3e-4), random(3e-3)), corners);
    map.triangulateNew();
  }
  return map;
}

/// Exact poses, and noise-free observations of 300 points in all keyframes.
LocalMap exactMap(int keyframes) {
  const auto points = test::farPoints(300);
  LocalMap map;
  for (int k = 0; k < keyframes; ++k)
    map.addKeyframe(keyframePose(k), observe(points, keyframePose(k)));
  map.triangulateNew();
  return map;
}

/// Position in the map of the first keyframe whose pose is optimised.
std::size_t firstFree(const LocalMap& map) {
  const std::size_t count = map.keyframes().size();
  return count > kWindow ? count - kWindow : 1;
}

/// Huber's loss of the residuals of a landmark; 0 for one that is not optimised.
double costOf(const Landmark& landmark, const LocalMap& map) {
  const auto& observations = landmark.observations;
  if (!landmark.depth || observations.back().keyframe < map.keyframes()[firstFree(map)].id) {
    return 0;
  }
  const Eigen::Vector3d p_w = map.keyframe(observations.front().keyframe).T_w_c *
                              Eigen::Vector3d(landmark.ray() / landmark.depth->value);
  double cost = 0;
  for (std::size_t i = 1; i < observations.size(); ++i) {
    const Observation& o = observations[i];
    const Eigen::Vector3d p_c = map.keyframe(o.keyframe).T_w_c.inverse() * p_w;
    if (landmark.depth->value * p_c.z() <= 0) continue;  // behind the camera
    const double error = (normalised(p_c) - o.x).norm() / o.sigma;
    cost += error < kHuberSigma ? 0.5 * error * error : kHuberSigma * (error - 0.5 * kHuberSigma);
  }
  return cost;
}
double costOf(const LocalMap& map) {
  double cost = 0;
  for (const Landmark& landmark : map.landmarks()) cost += costOf(landmark, map);
  return cost;
}

/// Magnitude of the derivative at 0, in units of the standard deviation that the curvature gives.
double slopeOf(const std::function<double(double)>& cost) {
  constexpr double kStep = 1e-5;
  const double after = cost(kStep), before = cost(-kStep);
  return 0.5 * std::abs(after - before) / std::sqrt(after + before - 2 * cost(0));
}

/// Largest slope of the cost over any parameter that is optimised.
double largestSlope(const LocalMap& map) {
  double largest = 0;
  for (std::size_t k = firstFree(map); k < map.keyframes().size(); ++k) {
    for (int i = 0; i < 6; ++i) {
      largest = std::max(largest, slopeOf([&](double step) {
                           LocalMap moved = map;
                           Eigen::Isometry3d& T = moved.keyframes()[k].T_w_c;
                           T = T * motionFrom(step * Vector6d::Unit(i));
                           return costOf(moved);
                         }));
    }
  }
  for (const Landmark& landmark : map.landmarks()) {
    if (costOf(landmark, map) == 0) continue;
    largest = std::max(largest, slopeOf([&](double step) {
                         Landmark moved = landmark;
                         moved.depth->value *= 1 + step;
                         return costOf(moved, map);
                       }));
  }
  return largest;
}

/// Exactly the same poses and inverse depths; NaN equals NaN.
void expectEqual(const LocalMap& before, const LocalMap& after) {
  for (std::size_t k = 0; k < before.keyframes().size(); ++k) {
    const Eigen::Matrix4d a = before.keyframes()[k].T_w_c.matrix();
    const Eigen::Matrix4d b = after.keyframes()[k].T_w_c.matrix();
    EXPECT_TRUE(a == b || (a.hasNaN() && b.hasNaN())) << "keyframe " << k;
  }
  for (const Landmark& landmark : before.landmarks()) {
    const Landmark& other = *after.find(landmark.id());
    ASSERT_EQ(landmark.depth.has_value(), other.depth.has_value());
    if (!landmark.depth || std::isnan(landmark.depth->value)) continue;
    EXPECT_EQ(landmark.depth->value, other.depth->value);
  }
}

// The slopes are numerical derivatives of a cost that shares no code with the solver. One
// adjustment nearly reaches the minimum, some more reach it.
TEST(BundleAdjustment, FindsTheMinimumOfTheCostWithFixedGauge) {
  for (const int keyframes : {2, 3, 6, 9, 14, 20}) {  // up to 8 leave the scale free
    SCOPED_TRACE(keyframes);
    const LocalMap before = randomMap(keyframes, static_cast<unsigned>(10 * keyframes));
    LocalMap map = before;
    ASSERT_TRUE(adjust(&map));
    const double cost = costOf(map);
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(adjust(&map));
    EXPECT_LT(largestSlope(map), 0.05);
    EXPECT_LT(cost, 1.001 * costOf(map));
    for (std::size_t k = 0; k < firstFree(before); ++k) {
      EXPECT_EQ(map.keyframes()[k].T_w_c.matrix(), before.keyframes()[k].T_w_c.matrix());
    }
    const auto lengthOf = [](const LocalMap& m) {
      return (m.keyframes().back().T_w_c.translation() - m.keyframes().front().T_w_c.translation())
          .norm();
    };
    if (firstFree(before) < 2) {
      EXPECT_NEAR(lengthOf(map), lengthOf(before), 1e-9);
    }
  }
}

// Also when the solver is reused, and when the map is stored before it is solved.
TEST(BundleAdjustment, SolvesEachLoadedMapOnItsOwn) {
  BundleAdjustment reused(kWindow);
  for (const int keyframes : {14, 5, 9, 2, 12}) {
    const LocalMap before = randomMap(keyframes, 7);
    LocalMap expected = before, map = before, empty;
    ASSERT_TRUE(adjust(&expected));
    reused.load(map);
    reused.store(&map);
    expectEqual(before, map);
    ASSERT_TRUE(reused.solve());
    expectEqual(before, map);
    reused.store(&map);
    expectEqual(expected, map);
    reused.load(empty);
    EXPECT_FALSE(reused.solve());
  }
}

/// Adds large random errors to all poses but the first and to all inverse depths.
void disturb(unsigned seed, LocalMap* map) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0, 1);
  const auto error = [&] { return normal(generator); };
  const auto random = [&] { return Eigen::Vector3d(error(), error(), error()); };
  for (std::size_t k = 1; k < map->keyframes().size(); ++k) {
    Eigen::Isometry3d& T = map->keyframes()[k].T_w_c;
    T = T * pose(0.05 * random(), 0.3 * random());
  }
  for (Landmark& landmark : map->landmarks()) {
    if (landmark.depth) landmark.depth->value *= std::exp(error());
  }
}

// So far from the minimum that steps are rejected. The cost bounds each residual by 0.01.
TEST(BundleAdjustment, FindsTheMinimumFromFarAway) {
  const LocalMap exact = exactMap(6);
  for (unsigned seed = 0; seed < 6; ++seed) {
    LocalMap disturbed = exact;
    disturb(seed, &disturbed);
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(adjust(&disturbed));
    EXPECT_LT(costOf(disturbed), 0.5 * 0.01 * 0.01) << seed;
  }
}

TEST(BundleAdjustment, IgnoresPointsBehindTheCameraAndKeyframesWithoutObservations) {
  LocalMap map = exactMap(10);
  ASSERT_TRUE(adjust(&map));
  map.addKeyframe(keyframePose(10), {});
  map.find(7)->depth->value = 10;  // 0.1 units ahead of the first keyframe, behind all others
  EXPECT_TRUE(adjust(&map));
  EXPECT_EQ(map.find(7)->depth->value, 10);
  EXPECT_EQ(map.keyframes().back().T_w_c.matrix(), keyframePose(10).matrix());
}

/// The result is not usable, and the map is unchanged.
void expectRefused(const LocalMap& before) {
  LocalMap map = before;
  EXPECT_FALSE(adjust(&map));
  expectEqual(before, map);
}

TEST(BundleAdjustment, IsNotUsableWithoutEnoughLandmarks) {
  LocalMap map;
  expectRefused(map);
  map.addKeyframe(keyframePose(0), observe(test::farPoints(300), keyframePose(0)));
  expectRefused(map);  // one keyframe
  map.addKeyframe(keyframePose(1), {});
  for (Landmark& landmark : map.landmarks()) landmark.depth = InverseDepth{0.05, 0.01};
  expectRefused(map);  // every landmark has one observation

  LocalMap behind = exactMap(10);
  for (Keyframe& keyframe : behind.keyframes()) {
    if (keyframe.id > 0) keyframe.T_w_c.translation().z() += 1000;
  }
  expectRefused(behind);
}

TEST(BundleAdjustment, IsNotUsableWithInputThatIsNotFinite) {
  const std::function<void(LocalMap*, Landmark*)> changes[] = {
      [](LocalMap*, Landmark* l) { l->observations.front().x.y() = kNaN; },
      [](LocalMap*, Landmark* l) { l->observations.back().sigma = kNaN; },
      [](LocalMap*, Landmark* l) { l->observations.back().sigma = 0; },
      [](LocalMap*, Landmark* l) { l->depth->value = kNaN; },
      [](LocalMap* map, Landmark*) { map->keyframes().back().T_w_c.translation().x() = kNaN; }};
  for (const auto& change : changes) {
    LocalMap map = exactMap(10);
    change(&map, map.find(3));
    SCOPED_TRACE(&change - changes);
    expectRefused(map);
  }
}

}  // namespace
}  // namespace gsv
