// Degenerate input gives a failure status or a finite result, never a NaN.

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "support/scene.hpp"
#include "support/test.hpp"
#include "support/texture.hpp"
#include "vo/alignment.hpp"
#include "vo/bundle_adjustment.hpp"
#include "vo/lucas_kanade.hpp"
#include "vo/map.hpp"
#include "vo/pose.hpp"
#include "vo/two_view.hpp"

namespace gsv {
namespace {

using test::normalised;
using test::pose;
using test::randomPoints;
using test::testCamera;

struct Scene {
  std::string name;
  std::vector<Eigen::Vector3d> points;
};

/// Degenerate or extreme sets of 200 points.
std::vector<Scene> degenerateScenes() {
  using Point = Eigen::Vector3d;
  const auto points = randomPoints(200, 3);
  std::vector<Scene> scenes;
  const auto add = [&](const char* name, const std::function<Point(int)>& point) {
    scenes.push_back({name, {}});
    for (int i = 0; i < 200; ++i) scenes.back().points.push_back(point(i));
  };
  const auto random = [&](int i) { return points[static_cast<std::size_t>(i)]; };
  const auto across = [](int i) { return 0.01 * i - 1; };
  add("line across", [&](int i) { return Point(across(i), 0.2 * across(i), 10); });
  add("line along the optical axis", [](int i) { return Point(0, 0, 5 + i); });
  add("wall", [&](int i) { return Point(across(i), 0.3 * std::sin(7.0 * i), 12); });
  add("all points coincide", [](int) { return Point(0.4, 0.1, 9); });
  add("behind", [&](int i) { return Point(-random(i)); });
  add("far", [&](int i) { return Point(1e12 * random(i)); });
  add("near", [&](int i) { return Point(1e-12 * random(i)); });
  return scenes;
}

/// Standstill, pure rotation, a normal motion, a tiny and a huge one.
const std::vector<Eigen::Isometry3d>& motions() {
  static const std::vector<Eigen::Isometry3d> kMotions{
      pose({0, 0, 0}, {0, 0, 0}), pose({0, 0.05, 0}, {0, 0, 0}),
      pose({0.01, 0.02, 0}, {0.2, 0, -1}), pose({0, 0, 0}, {1e-14, 0, 0}),
      pose({0, 0, 0}, {1e14, 0, 0})};
  return kMotions;
}

TEST(DegenerateGeometry, TwoViewsGiveAFiniteMotionOrNone) {
  int motion = 0;  // index in motions()
  for (const Eigen::Isometry3d& T_2_1 : motions()) {
    for (const Scene& scene : degenerateScenes()) {
      SCOPED_TRACE(scene.name + ", motion " + std::to_string(motion));
      std::vector<Eigen::Vector2d> u1, u2;
      for (const Eigen::Vector3d& p : scene.points) {
        u1.push_back(testCamera().project(p));
        u2.push_back(testCamera().project(T_2_1 * p));
      }
      const auto result = estimateMotion(testCamera(), u1, u2);
      // Standstill and pure rotation never give a motion.
      EXPECT_TRUE(motion >= 2 || !result);
      if (!result) continue;
      EXPECT_TRUE(isFinite(result->T_2_1));
      EXPECT_NEAR(result->T_2_1.translation().norm(), 1, 1e-9);
      EXPECT_TRUE(isFinite(result->inverse_depth_1));
    }
    ++motion;
  }
  for (const double bad : {kNan, kInfinity, -kInfinity, 1e300}) {
    const std::vector<Eigen::Vector2d> u(200, {bad, 5});
    EXPECT_FALSE(estimateMotion(testCamera(), u, u)) << bad;
  }
}

TEST(DegenerateGeometry, TriangulationIsFiniteOrEmpty) {
  const Eigen::Vector3d ray(0.1, 0.05, 1);
  for (const double t : {0.0, 1e-200, 1e-9, 1.0, 1e9, 1e200, kNan, kInfinity}) {
    for (const double x : {0.1, -5.0, 1e9, 1e200, kNan, kInfinity}) {
      for (const double sigma : {1e-3, 1e-200, 1e200, kNan}) {
        const auto point =
            triangulate(ray, {pose({0, 0, 0}, {t, 0, 0}), pose({0, 0.1, 0}, {0, t, 0})},
                        {{0, {x, 0.05}, sigma}, {0, {0.1, x}, sigma}});
        if (!point) continue;
        EXPECT_TRUE(areFinite(point->value, point->sigma)) << t << ' ' << x << ' ' << sigma;
        EXPECT_GE(point->sigma, 0);
      }
    }
  }
}

TEST(DegenerateGeometry, PoseIsFiniteOrHasAFailureStatus) {
  for (const Scene& scene : degenerateScenes()) {
    SCOPED_TRACE(scene.name);
    for (const double outlier_offset : {0.0, 1e6, kNan}) {
      std::vector<PointObservation> observations;
      for (const Eigen::Vector3d& p : scene.points) {
        observations.push_back({{p, 0.01 * p}, normalised(p), 1e-3});
      }
      observations.front().p_w.x() += outlier_offset;
      std::vector<Eigen::Isometry3d> guesses = motions();
      guesses.push_back(pose({0, 0, 0}, {kNan, 0, 0}));
      for (const Eigen::Isometry3d& guess : guesses) {
        const auto result = estimatePose(guess, observations);
        EXPECT_TRUE(scene.name != "behind" || !result.ok);
        EXPECT_TRUE(!result.ok || areFinite(result.T_w_c, result.covariance));
      }
    }
  }
  EXPECT_FALSE(estimatePose(pose({0, 0, 0}, {0, 0, 0}), {}).ok);
}

TEST(DegenerateGeometry, BundleAdjustmentIsFiniteOrUnusable) {
  for (const Scene& scene : degenerateScenes()) {
    for (const double depth : {1.0, 1e-300, 1e300}) {
      SCOPED_TRACE(scene.name);
      LocalMap map;
      for (int k = 0; k < 4; ++k) {
        const Eigen::Isometry3d T_w_c = pose({0, 0, 0}, {0, 0, 1e-9 * k});  // almost no baseline
        std::vector<Observation> corners;
        for (std::size_t i = 0; i < scene.points.size(); ++i) {
          corners.push_back({i, normalised(T_w_c.inverse() * scene.points[i]), 1e-3});
        }
        map.addKeyframe(T_w_c, corners);
      }
      for (std::size_t i = 0; i < scene.points.size(); ++i) {
        map.find(i)->depth = InverseDepth{depth, depth};
      }
      BundleAdjustment adjustment(7);
      adjustment.load(map);
      adjustment.solve();
      adjustment.store(&map);
      for (const Keyframe& keyframe : map.keyframes()) EXPECT_TRUE(isFinite(keyframe.T_w_c));
      for (const Landmark& landmark : map.landmarks()) {
        EXPECT_TRUE(isFinite(landmark.depth->value)) << landmark.id();
      }
    }
  }
}

TEST(DegenerateGeometry, InvalidPredictionsAndWarpsGiveFiniteResultsOrNone) {
  const cv::Mat image = test::blurredNoise(7, {200, 100}, 0.5);
  const ImagePyramid pyramid = trackingPyramid(image);
  const Eigen::Matrix2d identity = Eigen::Matrix2d::Identity();
  const Eigen::Vector2d u(50, 50);
  for (const double bad : {kNan, kInfinity, 1e30, -1e30}) {
    const auto tracks =
        trackPoints(pyramid, pyramid, {{50, 50}}, {{static_cast<float>(bad), 50}}, {});
    EXPECT_TRUE(!tracks[0] || areFinite(tracks[0]->x, tracks[0]->y)) << bad;
    EXPECT_FALSE(alignPatch(image, u, bad * identity, image, u, 0.8)) << bad;
    EXPECT_FALSE(alignPatch(image, u, identity, image, {bad, 50}, 0.8)) << bad;
    EXPECT_FALSE(alignPatch(image, {50, bad}, identity, image, u, 0.8)) << bad;
    for (const auto surface :
         {PatchSurface::kFrontoParallel, PatchSurface::kFloor, PatchSurface::kWall}) {
      const auto warp = patchWarp(testCamera(), {1, 1, 9}, pose({0, 0, 0}, {0, 0, bad}), surface);
      EXPECT_TRUE(!warp || isFinite(*warp)) << bad;
    }
  }
}

TEST(DegenerateGeometry, UnusablePointsAreDetected) {
  const auto isUsable = [](float x, float z, float depth_sigma) {
    TrackedFeature feature;
    feature.has_point = true;
    feature.p_c = {x, 2, z};
    feature.depth_sigma = depth_sigma;
    return hasUsablePoint(feature);
  };
  EXPECT_FALSE(hasUsablePoint({}));
  EXPECT_TRUE(isUsable(1, 3, 0.1f));
  EXPECT_FALSE(isUsable(1, 0, 0.1f));
  for (const double number : {kNan, kInfinity, -kInfinity, 1e10, -1e30}) {
    const auto bad = static_cast<float>(number);
    EXPECT_FALSE(isUsable(bad, 3, 0.1f) || isUsable(1, bad, 0.1f) || isUsable(1, 3, bad)) << bad;
  }
}

}  // namespace
}  // namespace gsv
