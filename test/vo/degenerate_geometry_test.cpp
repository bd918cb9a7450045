// Degenerate input gives a failure status or a finite result, never a NaN.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "support/scene.hpp"
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

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

struct Scene {
  std::string name;
  std::vector<Eigen::Vector3d> points;
};

/// Degenerate or extreme sets of 200 points.
std::vector<Scene> degenerateScenes() {
  constexpr int kPoints = 200;
  std::vector<Scene> scenes{{"line across", {}}, {"line along the optical axis", {}},
                            {"wall", {}},        {"all points coincide", {}},
                            {"behind", {}},      {"far", {}},
                            {"near", {}}};
  for (int i = 0; i < kPoints; ++i) {
    const double s = 0.01 * i - 1;
    scenes[0].points.emplace_back(s, 0.2 * s, 10);
    scenes[1].points.emplace_back(0, 0, 5 + i);
    scenes[2].points.emplace_back(s, 0.3 * std::sin(7.0 * i), 12);
    scenes[3].points.emplace_back(0.4, 0.1, 9);
  }
  for (const Eigen::Vector3d& p : randomPoints(kPoints, 3)) {
    scenes[4].points.push_back(-p);
    scenes[5].points.push_back(1e12 * p);
    scenes[6].points.push_back(1e-12 * p);
  }
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
  for (const double bad : {kNan, kInf, -kInf, 1e300}) {
    const std::vector<Eigen::Vector2d> u(200, {bad, 5});
    EXPECT_FALSE(estimateMotion(testCamera(), u, u)) << bad;
  }
}

TEST(DegenerateGeometry, TriangulationIsFiniteOrEmpty) {
  const Eigen::Vector3d ray(0.1, 0.05, 1);
  for (const double t : {0.0, 1e-200, 1e-9, 1.0, 1e9, 1e200, kNan, kInf}) {
    for (const double x : {0.1, -5.0, 1e9, 1e200, kNan, kInf}) {
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
  for (const double bad : {kNan, kInf, 1e30, -1e30}) {
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
  TrackedFeature feature;
  EXPECT_FALSE(hasUsablePoint(feature));
  feature.has_point = true;
  feature.p_c = {1, 2, 3};
  feature.depth_sigma = 0.1f;
  EXPECT_TRUE(hasUsablePoint(feature));
  for (const double number : {kNan, kInf, -kInf, 1e10, -1e30}) {
    const auto bad = static_cast<float>(number);
    TrackedFeature bad_x = feature, bad_z = feature, bad_sigma = feature;
    bad_x.p_c.x() = bad_z.p_c.z() = bad_sigma.depth_sigma = bad;
    EXPECT_FALSE(hasUsablePoint(bad_x)) << number;
    EXPECT_FALSE(hasUsablePoint(bad_z)) << number;
    EXPECT_FALSE(hasUsablePoint(bad_sigma)) << number;
  }
  feature.p_c.z() = 0;
  EXPECT_FALSE(hasUsablePoint(feature));
}

}  // namespace
}  // namespace gsv
