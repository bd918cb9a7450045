#include "scale/plane_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

namespace gsv {
namespace {

/// Portable random numbers; gauss() is approximately standard normal.
struct Noise {
  std::mt19937 random{5};
  double uniform(double a, double b) {
    return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
  }
  double gauss() {
    double sum = -6;
    for (int k = 0; k < 12; ++k) sum += uniform(0, 1);
    return sum;
  }
};

/// Points of the plane n . x + h = 0, seen from cameras up to `back` [VO units] behind; the inverse
/// depth has a relative standard deviation of `noise`.
std::vector<GroundPoint> pointsOn(const GroundPlane& plane, int n, double noise, double back,
                                  unsigned seed) {
  Noise random;
  random.random.seed(seed);
  std::vector<GroundPoint> points;
  for (int i = 0; i < n; ++i) {
    GroundPoint point;
    point.origin_c = Eigen::Vector3d(0, 0, -random.uniform(0, back));
    const double h = plane.height + plane.n_c.dot(point.origin_c);
    const Eigen::Vector3d ray(random.uniform(-0.3, 0.3), random.uniform(0.08, 0.25), 1);
    point.depth = -h / plane.n_c.dot(ray) / (1 + noise * random.gauss());
    point.depth_sigma =
        std::max(noise, 0.001) * point.depth * point.depth * -plane.n_c.dot(ray) / h;
    point.p_c = point.origin_c + point.depth * ray;
    points.push_back(point);
  }
  return points;
}

const GroundPlane kPlane{Eigen::Vector3d(0.01, -1, -0.02).normalized(), 0.8};

RoadPrior loosePrior() {
  RoadPrior prior;
  prior.pitch_sigma = prior.roll_sigma = 0.5;
  return prior;
}

std::vector<GroundPoint> inUnit(double unit, std::vector<GroundPoint> points) {
  for (GroundPoint& point : points) {
    point.p_c *= unit;
    point.origin_c *= unit;
    point.depth *= unit;
    point.depth_sigma *= unit;
  }
  return points;
}

TEST(PlaneFit, ExactPointsGiveTheExactPlaneInAnyUnit) {
  for (const bool homogeneous : {false, true}) {
    PlaneFitOptions options;
    options.homogeneous = homogeneous;
    for (const double unit : {0.01, 1.0, 300.0}) {
      SCOPED_TRACE(unit);
      const auto points = inUnit(unit, pointsOn(kPlane, 60, 0, 3, 1));
      const auto result = fitPlane(points, loosePrior(), unit, options);
      ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
      EXPECT_NEAR(result.plane.height / unit, 0.8, 1e-5);
      EXPECT_NEAR((result.plane.n_c - kPlane.n_c).norm(), 0, 1e-5);
      EXPECT_EQ(result.support, 60);
    }
  }
}

TEST(PlaneFit, NoiseOfTheInverseDepthDoesNotBiasTheHeight) {
  // Relative error 8 %: weights from measured depths would shrink the height by more than 1 %.
  const auto result = fitPlane(pointsOn(kPlane, 20000, 0.08, 3, 2), loosePrior(), 1.0);
  ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
  EXPECT_NEAR(result.plane.height / 0.8, 1, 0.004);
}

TEST(PlaneFit, SigmaIsThatOfRepeatedFits) {
  double squares = 0, sigma = 0;
  const int runs = 200;
  for (int i = 0; i < runs; ++i) {
    const auto result = fitPlane(pointsOn(kPlane, 120, 0.03, 3, 100u + static_cast<unsigned>(i)),
                                 loosePrior(), 1.0);
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    squares += std::pow(result.plane.height - 0.8, 2);
    sigma += result.sigma;
  }
  const double ratio = std::sqrt(squares / runs) / (sigma / runs);
  EXPECT_GT(ratio, 0.75);
  EXPECT_LT(ratio, 1.4);
}

// The reported errors of the depths are three times too large or too small.
TEST(PlaneFit, SigmaAndInliersAdaptToTheResiduals) {
  const auto points = pointsOn(kPlane, 2000, 0.03, 3, 3);
  const auto exact = fitPlane(points, loosePrior(), 1.0);
  for (const double factor : {3.0, 1 / 3.0}) {
    auto changed = points;
    for (GroundPoint& point : changed) point.depth_sigma *= factor;
    const auto result = fitPlane(changed, loosePrior(), 1.0);
    EXPECT_NEAR(result.sigma, exact.sigma, 0.1 * exact.sigma) << factor;
    EXPECT_NEAR(result.support, exact.support, 0.01 * 2000) << factor;
  }
}

/// Points of kPlane whose rays have x in [from, to].
std::vector<GroundPoint> pointsBetween(double from, double to) {
  std::vector<GroundPoint> points;
  for (GroundPoint& point : pointsOn(kPlane, 400, 0.02, 3, 7)) {
    const double x = (point.p_c - point.origin_c).x() / point.depth;
    if (x >= from && x <= to) points.push_back(point);
  }
  return points;
}

TEST(PlaneFit, GroundOnOneSideAloneIsUncertain) {
  PlaneFitOptions options;
  options.camber_sigma_rad = 0.06;  // twice the default
  const auto all = pointsBetween(-0.3, 0.3), on_the_right = pointsBetween(0.1, 0.2);
  RoadPrior prior;
  prior.n_c = kPlane.n_c;
  prior.pitch_sigma = prior.roll_sigma = 0.01;
  const auto both = fitPlane(all, prior, 0.8), right = fitPlane(on_the_right, prior, 0.8);
  ASSERT_EQ(both.status, MeasurementStatus::kMeasured);
  ASSERT_EQ(right.status, MeasurementStatus::kMeasured);
  EXPECT_LT(both.sigma, 0.01 * 0.8);
  // The points lie about one camera height to the right. There the standard deviation of the cross
  // slope, camber_sigma_rad = 0.03, is 0.03 of the height.
  EXPECT_GT(right.sigma, 0.02 * 0.8);
  EXPECT_LT(right.sigma, 0.045 * 0.8);
  EXPECT_EQ(fitPlane(on_the_right, prior, 0.8, options).status, MeasurementStatus::kNoPlane);
  EXPECT_EQ(fitPlane(all, prior, 0.8, options).status, MeasurementStatus::kMeasured);
  // The lane region is on that side: the points suffice, but the height is as uncertain.
  prior.region_offset = -1;
  const auto expected_right = fitPlane(on_the_right, prior, 0.8, options);
  EXPECT_EQ(expected_right.status, MeasurementStatus::kMeasured);
  EXPECT_NEAR(expected_right.sigma, 2 * right.sigma, 0.1 * right.sigma);
  prior.region_offset = 1;
  EXPECT_EQ(fitPlane(on_the_right, prior, 0.8, options).status, MeasurementStatus::kNoPlane);
}

TEST(PlaneFit, OutliersAreRejected) {
  // Objects nearer than the road, and reflections in it.
  for (const auto& [from, to] : {std::pair(0.3, 0.8), std::pair(1.25, 2.0)}) {
    auto points = pointsOn(kPlane, 150, 0.02, 3, 3);
    Noise random;
    for (int i = 0; i < 60; ++i) {
      GroundPoint point = points[static_cast<std::size_t>(i)];
      const double factor = random.uniform(from, to);
      point.p_c = point.origin_c + factor * (point.p_c - point.origin_c);
      point.depth *= factor;
      point.depth_sigma *= factor;
      points.push_back(point);
    }
    const auto result = fitPlane(points, loosePrior(), 1.0);
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured) << from;
    EXPECT_NEAR(result.plane.height / 0.8, 1, 0.01) << from;
    EXPECT_LE(result.support, 150) << from;
  }
}

// A wide but short band: the points observe the roll, the prior the pitch.
TEST(PlaneFit, PriorsOfPitchAndRollAreIndependent) {
  Noise random;
  std::vector<GroundPoint> points;
  const Eigen::Vector3d n_c = Eigen::Vector3d(0.1, -1, 0).normalized();
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d ray(random.uniform(-0.8, 0.8), random.uniform(0.16, 0.17), 1);
    const double depth = -0.8 / n_c.dot(ray) / (1 + 0.03 * random.gauss());
    points.push_back({0, depth * ray, Eigen::Vector3d::Zero(), depth, 0.03 * depth});
  }
  RoadPrior prior;
  prior.pitch_sigma = 0.001;
  prior.roll_sigma = 0.3;
  const auto result = fitPlane(points, prior, 0.8);
  ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
  EXPECT_NEAR((result.plane.n_c - n_c).norm(), 0, 0.01);
  EXPECT_NEAR(result.plane.height, 0.8, 0.02);
}

TEST(PlaneFit, FailuresAreReportedByStatus) {
  EXPECT_EQ(fitPlane({}, loosePrior(), 1.0).status, MeasurementStatus::kTooFewGroundPoints);
  EXPECT_EQ(fitPlane(pointsOn(kPlane, 5, 0, 0, 1), loosePrior(), 1.0).status,
            MeasurementStatus::kTooFewGroundPoints);
  const GroundPlane above{{0, 1, 0}, 0.8};
  EXPECT_EQ(fitPlane(pointsOn(above, 50, 0, 0, 1), loosePrior(), 1.0).status,
            MeasurementStatus::kNoPlane);
  // Collinear points, and points that coincide.
  std::vector<GroundPoint> line;
  for (int i = 0; i < 40; ++i) {
    const double z = 3 + 0.1 * i;
    line.push_back({0, {0, 0.8, z}, Eigen::Vector3d::Zero(), z, 0.01 * z});
  }
  EXPECT_EQ(fitPlane(line, loosePrior(), 1.0).status, MeasurementStatus::kNoPlane);
  const std::vector<GroundPoint> same(50, pointsOn(kPlane, 1, 0, 0, 1)[0]);
  EXPECT_EQ(fitPlane(same, loosePrior(), 1.0).status, MeasurementStatus::kNoPlane);
  // Of 18 points on the plane 14 are enough, 13 are not.
  for (const std::size_t outliers : {4u, 5u}) {
    auto some = pointsOn(kPlane, 18, 0, 3, 1);
    for (std::size_t i = 0; i < outliers; ++i) {
      some[i].p_c = 0.5 * (some[i].origin_c + some[i].p_c);
      some[i].depth *= 0.5;
    }
    EXPECT_EQ(fitPlane(some, loosePrior(), 1.0).status,
              outliers == 4 ? MeasurementStatus::kMeasured : MeasurementStatus::kNoPlane);
  }
}

// PCL prints an error for each degenerate sample, and when no plane has inliers.
TEST(PlaneFit, PrintsNothing) {
  auto points = pointsOn(kPlane, 60, 0.01, 3, 1);
  const GroundPlane slope{Eigen::Vector3d(0, -1, 0.5).normalized(), 0.8};
  const auto tilted = pointsOn(slope, 60, 0, 0, 1);
  // Half of the points in two places: most samples of three are degenerate.
  const auto two = pointsOn(kPlane, 2, 0, 0, 7);
  for (int i = 0; i < 60; ++i) points.push_back(two[static_cast<std::size_t>(i % 2)]);
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  EXPECT_EQ(fitPlane(points, loosePrior(), 1.0).status, MeasurementStatus::kMeasured);
  EXPECT_EQ(fitPlane(tilted, loosePrior(), 1.0).status, MeasurementStatus::kNoPlane);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(PlaneFit, TiltedPlaneIsReportedAsSuch) {
  const GroundPlane pitched{Eigen::Vector3d(0, -1, 0.1).normalized(), 0.8};
  const GroundPlane rolled{Eigen::Vector3d(0.1, -1, 0).normalized(), 0.8};
  const auto statusOf = [&](const GroundPlane& plane, double pitch_sigma, double roll_sigma) {
    RoadPrior prior;
    prior.pitch_sigma = pitch_sigma;
    prior.roll_sigma = roll_sigma;
    return fitPlane(pointsOn(plane, 80, 0.001, 0, 1), prior, 1.0).status;
  };
  EXPECT_EQ(statusOf(pitched, 0.5, 0.01), MeasurementStatus::kMeasured);
  EXPECT_EQ(statusOf(pitched, 0.01, 0.5), MeasurementStatus::kPlaneTilted);
  EXPECT_EQ(statusOf(rolled, 0.01, 0.5), MeasurementStatus::kMeasured);
  EXPECT_EQ(statusOf(rolled, 0.5, 0.01), MeasurementStatus::kPlaneTilted);
}

TEST(PlaneFit, TheHomogeneousFitRejectsOutliers) {
  PlaneFitOptions options;
  options.homogeneous = true;
  options.reject_distance_heights = 0.1;
  auto points = inUnit(100, pointsOn(kPlane, 1000, 0, 0, 1));
  Noise random;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double distance = i % 50 > 0 ? 2 * random.gauss() : i % 100 > 0 ? 30 : -30;
    points[i].p_c += distance * kPlane.n_c;
  }
  const auto result = fitPlane(points, loosePrior(), 80, options);
  ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
  EXPECT_LE(result.support, 980);
  EXPECT_GT(result.support, 950);
  EXPECT_NEAR(result.plane.height, 80, 1.5);
  EXPECT_NEAR(result.sigma, 2, 0.2);
}

}  // namespace
}  // namespace gsv
