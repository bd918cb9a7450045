#include "ground_scale_vo/vo/local_map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::angleBetween;
using test::keyframePose;
using test::kObservationSigma;
using test::normalised;
using test::observe;
using test::pose;

constexpr int kPoints = 300;

std::vector<Eigen::Vector3d> farMapPoints() { return test::farPoints(kPoints); }

TEST(Triangulation, scaledDerivativeMatchesNumericDerivative) {
  const Eigen::Vector3d ray(0.2, -0.1, 1);
  const Eigen::Isometry3d T = pose({0.02, 0.1, -0.03}, {0.3, 0.1, 0.8});
  const double rho = 0.15, step = 1e-6;
  const auto x = [&](double at) { return normalised(projectOnRay(ray, at, T).p); };
  const RayProjection projection = projectOnRay(ray, rho, T);
  EXPECT_LT((normalised(T * (ray / rho)) - normalised(projection.p)).norm(), 1e-12);
  EXPECT_LT(((x(rho + step) - x(rho - step)) / (2 * step) -
             projection.scaled_derivative / projection.p.z())
                .norm(),
            1e-8);
}

TEST(LocalMap, triangulatesLandmarksWithParallax) {
  const auto points = farMapPoints();
  LocalMap map({});
  for (int k = 0; k < 6; ++k) {
    map.addKeyframe(keyframePose(k), observe(points, keyframePose(k)));
    map.triangulateNew();
  }
  int with_depth = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (const auto point = map.point(i)) {
      ++with_depth;
      EXPECT_LT((point->p_w - points[i]).norm(), 1e-6 * points[i].norm());
    }
  }
  EXPECT_GT(with_depth, kPoints * 8 / 10);
}

TEST(LocalMap, APointNeedsToFitAllItsObservations) {
  const Eigen::Vector3d p_w(2, -1, 8);
  for (const double limit : {0.003, 0.02}) {
    LocalMap::Options options;
    options.max_reprojection_error = limit;
    LocalMap map(options);
    for (int k = 0; k < 4; ++k) {
      auto corners = observe({p_w}, keyframePose(k));
      if (k == 2) corners[0].x.y() += 0.01;  // across the direction of motion
      map.addKeyframe(keyframePose(k), corners);
    }
    map.triangulateNew();
    EXPECT_EQ(map.point(0).has_value(), limit > 0.01);
  }
}

// Bundle adjustment has refined it since.
TEST(LocalMap, ADepthIsNotTriangulatedAgain) {
  LocalMap map({});
  const Eigen::Vector3d p_w(2, -1, 8);
  for (int k = 0; k < 3; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  map.triangulateNew();
  ASSERT_TRUE(map.find(0)->depth);
  map.find(0)->depth->value = 0.12;
  map.addKeyframe(keyframePose(3), observe({p_w}, keyframePose(3)));
  map.triangulateNew();
  EXPECT_EQ(map.find(0)->depth->value, 0.12);
}

TEST(LocalMap, triangulatesNothingWithoutMotion) {
  const auto points = farMapPoints();
  LocalMap map({});
  for (int k = 0; k < 5; ++k) map.addKeyframe(keyframePose(0), observe(points, keyframePose(0)));
  map.triangulateNew();
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_FALSE(map.point(i));
}

TEST(LocalMap, landmarksOutliveTheirAnchorAndTheMapStaysBounded) {
  const auto points = farMapPoints();
  LocalMap::Options options;
  options.keyframes = 4;
  LocalMap map(options);
  for (int k = 0; k < 12; ++k) {
    map.addKeyframe(keyframePose(k), observe(points, keyframePose(k)));
    map.triangulateNew();
  }
  EXPECT_EQ(map.keyframes().size(), 4u);
  EXPECT_EQ(map.keyframes().front().id, 8u);
  int with_depth = 0;
  for (const auto& [id, landmark] : map.landmarks()) {
    EXPECT_LE(landmark.observations.size(), 4u);
    EXPECT_GE(landmark.observations.front().keyframe, 8u);
    if (const auto point = map.point(landmark)) {
      ++with_depth;
      EXPECT_LT((point->p_w - points[id]).norm(), 1e-6 * points[id].norm());
    }
  }
  EXPECT_GT(with_depth, kPoints * 8 / 10);
}

TEST(LocalMap, removesLandmarksThatAreNoLongerObserved) {
  const auto points = farMapPoints();
  LocalMap::Options options;
  options.keyframes = 4;
  LocalMap map(options);
  map.addKeyframe(keyframePose(0), observe(points, keyframePose(0)));
  map.addKeyframe(keyframePose(1), observe(points, keyframePose(1)));
  for (int k = 2; k < 8; ++k) map.addKeyframe(keyframePose(k), {});
  EXPECT_TRUE(map.landmarks().empty());
}

TEST(LocalMap, removesItsNewestKeyframe) {
  const auto points = farMapPoints();
  LocalMap map({});
  for (int k = 0; k < 3; ++k) {
    map.addKeyframe(keyframePose(k), observe(points, keyframePose(k)));
    map.triangulateNew();
  }
  const auto before = map.landmarks();
  auto corners = observe(points, keyframePose(3));
  const LocalMap::Corner only_here{1'000'000, Eigen::Vector2d::Zero(), kObservationSigma};
  corners.push_back(only_here);
  map.addKeyframe(keyframePose(3), corners);
  map.removeNewestKeyframe();
  EXPECT_EQ(map.keyframes().size(), 3u);
  EXPECT_EQ(map.find(only_here.id), nullptr);
  ASSERT_EQ(map.landmarks().size(), before.size());
  for (const auto& [id, landmark] : map.landmarks()) {
    EXPECT_EQ(landmark.observations.size(), before.at(id).observations.size());
    EXPECT_EQ(landmark.depth.has_value(), before.at(id).depth.has_value());
  }
  EXPECT_EQ(map.addKeyframe(keyframePose(3), corners), 3u);
}

TEST(LocalMap, removesWrongObservations) {
  const auto points = farMapPoints();
  LocalMap map({});
  for (int k = 0; k < 5; ++k) {
    auto corners = observe(points, keyframePose(k));
    if (k == 3) corners[7].x.x() += 0.05;
    map.addKeyframe(keyframePose(k), corners);
    if (k == 2) map.triangulateNew();
  }
  ASSERT_TRUE(map.find(7)->depth);
  map.removeOutliers(0.003);
  EXPECT_EQ(map.find(7)->observations.size(), 4u);
  EXPECT_EQ(map.find(8)->observations.size(), 5u);
}

TEST(LocalMap, AnAnchorAloneRemainsUnlessAWrongObservationWasRemoved) {
  const Eigen::Vector3d p_w(1, 1, 10);
  for (const bool wrong : {false, true}) {
    LocalMap map({});
    map.addKeyframe(keyframePose(0), observe({p_w}, keyframePose(0)));
    map.find(0)->depth = {0.1, 0.01};
    if (wrong) {
      auto corners = observe({p_w}, keyframePose(1));
      corners[0].x.x() += 0.05;
      map.addKeyframe(keyframePose(1), corners);
    }
    map.removeOutliers(0.003);
    EXPECT_EQ(map.find(0) == nullptr, wrong);
  }
}

/// Standard deviation of a point along its ray [VO units], from random errors of its observations.
double sampledSigma(const Eigen::Vector3d& p_w, int keyframes) {
  std::mt19937 generator(5);
  std::normal_distribution<double> noise(0, kObservationSigma);
  double squares = 0;
  constexpr int kRuns = 500;
  for (int run = 0; run < kRuns; ++run) {
    LocalMap map({});
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

TEST(LocalMap, SigmaOfAPointIsThatOfItsObservations) {
  constexpr int kKeyframes = 4;
  const Eigen::Vector3d p_w(2, -1, 8);
  LocalMap map({});
  for (int k = 0; k < kKeyframes; ++k) {
    map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  }
  map.triangulateNew();
  const double expected = sampledSigma(p_w, kKeyframes);
  const Eigen::Vector3d triangulated = map.point(0).value().sigma_w;
  EXPECT_NEAR(triangulated.norm(), expected, 0.1 * expected);
  const Eigen::Vector3d ray_w = p_w - keyframePose(0).translation();
  EXPECT_LT(triangulated.cross(ray_w.normalized()).norm(), 1e-9);  // along the anchor's ray
  map.find(0)->depth->sigma = 1;
  map.updateSigmas();
  EXPECT_NEAR(map.point(0)->sigma_w.norm(), expected, 0.1 * expected);
}

TEST(LocalMap, ANewAnchorKeepsThePointAndItsSigma) {
  LocalMap::Options options;
  options.keyframes = 4;
  LocalMap map(options);
  const Eigen::Vector3d p_w(2, -1, 8);
  for (int k = 0; k < 4; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  map.triangulateNew();
  const WorldPoint before = map.point(0).value();
  map.addKeyframe(keyframePose(4), observe({p_w}, keyframePose(4)));
  ASSERT_EQ(map.find(0)->observations.front().keyframe, 1u);
  const WorldPoint after = map.point(0).value();
  EXPECT_LT((after.p_w - before.p_w).norm(), 1e-9);
  EXPECT_NEAR(after.sigma_w.norm(), before.sigma_w.norm(), 0.2 * before.sigma_w.norm());
}

TEST(LocalMap, TheSigmaOfAPointDoesNotGrowWhenItsKeyframesLeaveTheMap) {
  LocalMap::Options options;
  options.keyframes = 3;
  LocalMap map(options);
  const Eigen::Vector3d p_w(2, -1, 8);
  for (int k = 0; k < 3; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  map.triangulateNew();
  map.addKeyframe(keyframePose(3), {});
  ASSERT_EQ(map.find(0)->observations.size(), 2u);
  const double before = map.find(0)->depth->sigma;
  map.updateSigmas();
  EXPECT_LE(map.find(0)->depth->sigma, before);
}

TEST(LocalMap, AnUncertainDepthDoesNotEnterTheMap) {
  const Eigen::Vector3d p_w(2, -1, 8);
  for (const double limit : {0.01, 1.0}) {
    LocalMap::Options options;
    options.max_relative_sigma = limit;
    LocalMap map(options);
    for (int k = 0; k < 2; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
    map.triangulateNew();
    EXPECT_EQ(map.point(0).has_value(), limit == 1.0);  // its relative sigma is about 0.03
  }
}

TEST(LocalMap, removesObservationsOfPointsBehindTheCamera) {
  const Eigen::Vector3d p_w(2, -1, 8);
  const Eigen::Isometry3d behind = pose({0, 0, 0}, {0, 0, 20});
  LocalMap map({});
  for (int k = 0; k < 3; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  map.triangulateNew();
  map.addKeyframe(behind, observe({p_w}, behind));
  map.removeOutliers(0.003);
  EXPECT_EQ(map.find(0)->observations.size(), 3u);
}

TEST(LocalMap, aNegativeDepthIsNoPointAndIsRemoved) {
  LocalMap map({});
  map.addKeyframe(keyframePose(0), observe({{2, -1, 8}, {1, 1, 9}}, keyframePose(0)));
  map.find(0)->depth = InverseDepth{-0.1, 0.01};
  map.find(1)->depth = InverseDepth{0.1, 0.01};
  EXPECT_FALSE(map.point(0));
  EXPECT_TRUE(map.point(1));
  map.removeOutliers(0.003);
  EXPECT_EQ(map.find(0), nullptr);
  EXPECT_NE(map.find(1), nullptr);
}

TEST(LocalMap, NewLandmarksStayWhenTheOldestKeyframeIsDropped) {
  LocalMap::Options options;
  options.keyframes = 3;
  LocalMap map(options);
  for (int k = 0; k < 3; ++k) map.addKeyframe(keyframePose(k), {});
  map.addKeyframe(keyframePose(3), observe({{2, -1, 8}}, keyframePose(3)));
  EXPECT_EQ(map.keyframes().size(), 3u);
  EXPECT_NE(map.find(0), nullptr);
}

TEST(LocalMap, ThereIsNoDepthInANewAnchorThatHasPassedThePoint) {
  LocalMap::Options options;
  options.keyframes = 3;
  LocalMap map(options);
  const std::vector<LocalMap::Corner> corners = observe({{2, -1, 8}}, keyframePose(0));
  map.addKeyframe(keyframePose(0), corners);
  map.find(0)->depth = InverseDepth{1.0 / 8, 0.01};
  for (int k = 1; k < 4; ++k) map.addKeyframe(pose({0, 0, 0}, {0, 0, 9.0 + k}), corners);
  ASSERT_EQ(map.find(0)->observations.front().keyframe, 1u);
  EXPECT_FALSE(map.find(0)->depth);
}

TEST(LocalMap, ClearRemovesEverything) {
  LocalMap map({});
  map.addKeyframe(keyframePose(0), observe(farMapPoints(), keyframePose(0)));
  map.clear();
  EXPECT_TRUE(map.keyframes().empty());
  EXPECT_TRUE(map.landmarks().empty());
}

/// Observations of the points for PoseEstimation. noise: standard deviation in normalised image
/// coordinates.
std::vector<PointObservation> pointObservations(const Eigen::Isometry3d& T_w_c, double noise) {
  std::mt19937 generator(51);
  std::normal_distribution<double> error(0, noise > 0 ? noise : 1);
  std::vector<PointObservation> result;
  for (const Eigen::Vector3d& p : farMapPoints()) {
    Eigen::Vector2d x = normalised(T_w_c.inverse() * p);
    if (noise > 0) x += Eigen::Vector2d(error(generator), error(generator));
    result.push_back({p, Eigen::Vector3d::Zero(), x, kObservationSigma});
  }
  return result;
}

TEST(PoseEstimation, ObservationsAreThoseOfTheCornersWithAMapPoint) {
  const Eigen::Vector3d p_w(2, -1, 8);
  LocalMap map({});
  for (int k = 0; k < 4; ++k) map.addKeyframe(keyframePose(k), observe({p_w}, keyframePose(k)));
  map.triangulateNew();
  const WorldPoint point = map.point(0).value();
  ASSERT_GT(point.sigma_w.norm(), 0);
  const LocalMap::Corner unknown{7, {0.3, 0.4}, 0.002}, known{0, {0.1, 0.2}, 0.001};
  for (const auto& corners : {std::vector{known, unknown}, std::vector{unknown, known}}) {
    std::vector<std::size_t> index;
    const auto observations = ground_scale_vo::pointObservations(map, corners, &index);
    ASSERT_EQ(observations.size(), 1u);
    EXPECT_EQ(observations[0].p_w, point.p_w);
    EXPECT_EQ(observations[0].sigma_w, point.sigma_w);
    EXPECT_EQ(observations[0].x, known.x);
    EXPECT_EQ(observations[0].sigma, known.sigma);
    EXPECT_EQ(index, std::vector<std::size_t>{corners[0].id == known.id ? 0u : 1u});
  }
}

TEST(PoseEstimation, isExactWithoutNoise) {
  const Eigen::Isometry3d true_T_w_c = pose({0.01, 0.05, -0.02}, {0.3, -0.1, 1.5});
  const auto result =
      PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), pointObservations(true_T_w_c, 0));
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT(angleBetween(result.T_w_c, true_T_w_c), 1e-8);
  EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 1e-7);
  EXPECT_EQ(result.inliers, kPoints);
}

TEST(PoseEstimation, RotationsAreOrthonormalAlsoFromARoundedPrediction) {
  Eigen::Isometry3d predicted = pose({0.01, 0.05, -0.02}, {0.3, -0.1, 1.5});
  const auto observations = pointObservations(predicted, 0.0005);
  predicted.linear() *= 1 + 1e-6;
  const auto result = PoseEstimation({}).estimate(predicted, observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  const Eigen::Matrix3d R = result.T_w_c.linear();
  EXPECT_TRUE((R.transpose() * R).isApprox(Eigen::Matrix3d::Identity(), 1e-12));
}

// It computes several observations at once, also when their number is not a multiple.
TEST(PoseEstimation, countsEachObservationOnce) {
  auto observations = pointObservations(pose({0, 0.03, 0}, {0.1, 0, 1}), 0.0005);
  for (const std::size_t count : {40, 39, 38, 37}) {
    observations.resize(count);
    auto reversed = observations;
    std::reverse(reversed.begin(), reversed.end());
    const auto a = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
    const auto b = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), reversed);
    EXPECT_TRUE(a.information.isApprox(b.information, 1e-6)) << count;
  }
}

TEST(PoseEstimation, rejectsOutliers) {
  const Eigen::Isometry3d true_T_w_c = pose({0, 0.03, 0}, {0.1, 0, 1});
  auto observations = pointObservations(true_T_w_c, 0.0005);
  for (std::size_t i = 0; i < observations.size(); i += 4) observations[i].x.x() += 0.05;
  const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT(angleBetween(result.T_w_c, true_T_w_c), 3e-4);
  for (std::size_t i = 0; i < observations.size(); i += 4) EXPECT_FALSE(result.inlier[i]);
}

TEST(PoseEstimation, recoversFromAWrongPredictionOfThePose) {
  const Eigen::Isometry3d true_T_w_c = pose({0.05, -0.5, 0.1}, {3, 1, -4});
  const auto result = PoseEstimation({}).estimate(pose({0, 0.6, 0}, {-5, 0, 8}),
                                                  pointObservations(true_T_w_c, 0.0005));
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT(angleBetween(result.T_w_c, true_T_w_c), 1e-3);
}

// The points of vehicles at the same speed fit a pose without motion.
TEST(PoseEstimation, keepsThePredictionWhenVehiclesThatMoveAlongHaveMorePoints) {
  const Eigen::Isometry3d true_T_w_c = pose({0, 0, 0}, {0, 0, 3});
  auto observations = pointObservations(true_T_w_c, 0.0005);
  std::size_t moving_along = 0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (i % 20 < 9) continue;
    observations[i].x = normalised(observations[i].p_w);
    ++moving_along;
  }
  ASSERT_GT(2 * moving_along, observations.size());
  const auto result = PoseEstimation({}).estimate(true_T_w_c, observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 0.05);
}

// The prediction is that pose, but clearly fewer points fit it.
TEST(PoseEstimation, leavesThePredictionWhenMuchMorePointsFitAnotherPose) {
  const Eigen::Isometry3d true_T_w_c = pose({0, 0, 0}, {0, 0, 3});
  auto observations = pointObservations(true_T_w_c, 0.0003);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (i % 50 < 21) observations[i].x = normalised(observations[i].p_w);
  }
  const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 0.1);
}

TEST(PoseEstimation, findsThePoseOfSlightlyMorePointsThanAFailedOne) {
  const Eigen::Isometry3d true_T_w_c = pose({0, 0, 0}, {0, 0, 3});
  auto observations = pointObservations(true_T_w_c, 0.0003);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    PointObservation& o = observations[i];
    if (i % 50 < 18) o.x = normalised(o.p_w);
    if (i % 50 >= 39) o.x += Eigen::Vector2d(0.05, i % 2 == 0 ? 0.1 : -0.1) * (1.0 + 0.1 * (i % 7));
  }
  const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 0.1);
}

// A minority of the points fits a prediction that is wrong by about ten standard deviations of the
// nearest points. With a narrow kernel from the start, the others would be outliers.
TEST(PoseEstimation, theMajorityOutweighsPointsThatFitAWrongPrediction) {
  const Eigen::Isometry3d true_T_w_c = pose({0, 0.02, 0}, {0, 0, 1});
  for (const Eigen::Vector3d& error : {Eigen::Vector3d(0.12, 0, 0), Eigen::Vector3d(0, 0.12, 0)}) {
    const Eigen::Isometry3d predicted = true_T_w_c * pose({0, 0, 0}, error);
    auto observations = pointObservations(true_T_w_c, 0.0003);
    for (std::size_t i = 0; i < observations.size(); ++i) {
      PointObservation& o = observations[i];
      if (i % 10 < 3) o.x = normalised(predicted.inverse() * o.p_w);
    }
    const auto result = PoseEstimation({}).estimate(predicted, observations);
    ASSERT_EQ(result.status, PoseStatus::kOk);
    EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 0.06);
  }
}

TEST(PoseEstimation, uncertainDepthsConstrainOnlyPerpendicularToTheEpipolarLine) {
  // Forwards, and sideways along a diagonal of the image.
  for (const Eigen::Vector3d& moved : {Eigen::Vector3d(0.1, 0, 1), Eigen::Vector3d(0.7, 0.7, 0)}) {
    const Eigen::Isometry3d true_T_w_c = pose({0, 0.02, 0}, moved);
    auto observations = pointObservations(true_T_w_c, 0);
    // Half of the points have a wrong depth on their ray from the origin, within their sigma.
    for (std::size_t i = 0; i < observations.size(); i += 2) {
      observations[i].sigma_w = 0.5 * observations[i].p_w;
      observations[i].p_w *= 1.4;
    }
    const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
    ASSERT_EQ(result.status, PoseStatus::kOk);
    EXPECT_LT((result.T_w_c.translation() - moved).norm(), 0.03);
    EXPECT_EQ(result.inliers, kPoints);
  }
}

// The same with a camera that is turned: the uncertainty of a point is in world axes.
TEST(PoseEstimation, UncertaintiesOfPointsAreInWorldAxes) {
  const Eigen::Isometry3d T_w_v = pose({0.3, 1.5, -0.4}, {5, 6, 7});
  const Eigen::Isometry3d true_T_w_c = T_w_v * pose({0, 0.02, 0}, {0.1, 0, 1});
  auto observations = pointObservations(pose({0, 0.02, 0}, {0.1, 0, 1}), 0);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    PointObservation& o = observations[i];
    if (i % 2 == 0) {
      o.sigma_w = 0.5 * o.p_w;
      o.p_w *= 1.4;
    }
    o.p_w = T_w_v * o.p_w;
    o.sigma_w = T_w_v.linear() * o.sigma_w;
  }
  const auto result = PoseEstimation({}).estimate(T_w_v, observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT((result.T_w_c.translation() - true_T_w_c.translation()).norm(), 0.03);
  EXPECT_EQ(result.inliers, kPoints);
}

TEST(PoseEstimation, InliersAreWithinTheirSigmas) {
  auto observations = pointObservations(Eigen::Isometry3d::Identity(), 0);
  const double limit = PoseEstimation::Options().inlier_sigma * kObservationSigma;
  observations[3].x.x() += 0.95 * limit;
  observations[4].x.x() += 1.05 * limit;
  const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  EXPECT_TRUE(result.inlier[3]);
  EXPECT_FALSE(result.inlier[4]);
  EXPECT_EQ(result.inliers, kPoints - 1);
}

// On the optical axis, where a point and its mirror image project to the same place.
TEST(PoseEstimation, doesNotUseAPointBehindTheCamera) {
  auto observations = pointObservations(Eigen::Isometry3d::Identity(), 0);
  const auto expected = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  observations.push_back({{0, 0, -5}, Eigen::Vector3d::Zero(), {0, 0}, kObservationSigma});
  const auto result = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  ASSERT_EQ(result.status, PoseStatus::kOk);
  EXPECT_FALSE(result.inlier.back());
  EXPECT_EQ(result.inliers, kPoints);
  EXPECT_TRUE(result.information.isApprox(expected.information, 1e-9));
}

TEST(PoseEstimation, reportsWhenThereIsNoPose) {
  EXPECT_EQ(PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), {}).status,
            PoseStatus::kTooFewPoints);
  auto observations = pointObservations(Eigen::Isometry3d::Identity(), 0);
  std::mt19937 generator(61);
  std::uniform_real_distribution<double> anywhere(-0.5, 0.5);
  // A third of the points is consistent: enough points, but too small a share.
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (i % 3 > 0) observations[i].x = {anywhere(generator), anywhere(generator)};
  }
  const auto third = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations);
  EXPECT_EQ(third.status, PoseStatus::kTooFewInliers);
  EXPECT_GT(third.inliers, 2 * PoseEstimation::Options().min_inliers);
  for (auto& o : observations) o.x = {anywhere(generator), anywhere(generator)};
  EXPECT_EQ(PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations).status,
            PoseStatus::kTooFewInliers);
}

TEST(PoseEstimation, needsAMinimumNumberOfInliers) {
  auto observations = pointObservations(Eigen::Isometry3d::Identity(), 0);
  observations.resize(40);
  for (int i = 0; i < 20; ++i) {
    observations[static_cast<std::size_t>(i)].x += Eigen::Vector2d(0.1 + 0.01 * i, 0.1);
  }
  PoseEstimation::Options options;
  ASSERT_LT(options.min_inlier_share, 0.5);
  for (const int min_inliers : {15, 20, 21}) {
    options.min_inliers = min_inliers;
    const auto result =
        PoseEstimation(options).estimate(Eigen::Isometry3d::Identity(), observations);
    EXPECT_EQ(result.inliers, 20);
    EXPECT_EQ(result.status, min_inliers <= 20 ? PoseStatus::kOk : PoseStatus::kTooFewInliers);
  }
  options.min_inliers = 20;
  observations.erase(observations.begin(), observations.begin() + 20);
  EXPECT_EQ(PoseEstimation(options).estimate(Eigen::Isometry3d::Identity(), observations).status,
            PoseStatus::kOk);
}

TEST(PoseEstimation, rejectsAnImplausiblePosition) {
  const auto statusAt = [](double distance) {
    const Eigen::Isometry3d T_w_c = pose({0, 0, 0}, {0, distance, 0});
    auto observations = pointObservations(Eigen::Isometry3d::Identity(), 0);
    for (auto& o : observations) o.p_w = T_w_c * o.p_w;
    return PoseEstimation({}).estimate(T_w_c, observations).status;
  };
  EXPECT_EQ(statusAt(1e6), PoseStatus::kOk);
  EXPECT_EQ(statusAt(2e9), PoseStatus::kTooFewInliers);
}

TEST(VoOptions, rejectsValuesOutOfRange) {
  LocalMap::Options map;
  map.keyframes = 1;
  EXPECT_THROW(LocalMap{map}, OptionError);
  PoseEstimation::Options estimation;
  estimation.min_inliers = 2;
  EXPECT_THROW(PoseEstimation{estimation}, OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
