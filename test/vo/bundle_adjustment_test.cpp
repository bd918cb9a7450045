#include "vo/bundle_adjustment.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <random>

#include "support/ceres_adjustment.hpp"
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

/// Largest difference between the keyframes' poses in two maps.
struct Difference {
  double distance = 0, angle = 0;

  Difference(const LocalMap& a, const LocalMap& b) {
    for (std::size_t k = 0; k < a.keyframes().size(); ++k) {
      const Eigen::Isometry3d &T_a = a.keyframes()[k].T_w_c, &T_b = b.keyframes()[k].T_w_c;
      distance = std::max(distance, (T_a.translation() - T_b.translation()).norm());
      angle = std::max(angle, angleBetween(T_a, T_b));
    }
  }
};

/// Largest difference of the landmarks' inverse depths in two maps, in standard deviations.
double depthDifference(LocalMap a, const LocalMap& b) {
  a.updateSigmas();
  double largest = 0;
  for (const Landmark& landmark : b.landmarks()) {
    if (!landmark.depth) continue;
    const InverseDepth& other = *a.find(landmark.id())->depth;
    largest = std::max(largest, std::abs(other.value - landmark.depth->value) / other.sigma);
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

TEST(BundleAdjustment, AgreesWithCeres) {
  for (const int keyframes : {2, 3, 6, 9, 14, 20}) {  // up to 8 leave the scale free
    SCOPED_TRACE(keyframes);
    const LocalMap map = randomMap(keyframes, static_cast<unsigned>(10 * keyframes));
    LocalMap ours = map, reference = map;
    ASSERT_TRUE(adjust(&ours));
    ASSERT_TRUE(test::adjustWithCeres(kWindow, &reference));
    const Difference difference(ours, reference);
    EXPECT_LT(difference.distance, 0.02 * Difference(map, reference).distance);
    EXPECT_LT(difference.angle, 0.05 * kObservationSigma);
    EXPECT_LT(depthDifference(ours, reference), 0.2);
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

/// Largest reprojection error of the landmarks with a depth.
double largestError(const LocalMap& map) {
  double largest = 0;
  for (const Landmark& landmark : map.landmarks()) {
    const auto point = map.point(landmark);
    if (!point) continue;
    for (const Observation& o : landmark.observations) {
      const Eigen::Vector3d p = map.keyframe(o.keyframe).T_w_c.inverse() * point->p_w;
      largest = std::max(largest, reprojectionError(p, o.x));
    }
  }
  return largest;
}

// So far from the minimum that steps are rejected.
TEST(BundleAdjustment, FindsTheMinimumFromFarAway) {
  const LocalMap exact = exactMap(6);
  for (unsigned seed = 0; seed < 6; ++seed) {
    LocalMap disturbed = exact;
    disturb(seed, &disturbed);
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(adjust(&disturbed));
    EXPECT_LT(largestError(disturbed), 0.01 * kObservationSigma) << seed;
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
