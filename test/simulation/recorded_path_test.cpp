#include "simulation/recorded_path.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "simulation/world/cross_section.hpp"
#include "simulation/world/road_geometry.hpp"
#include "simulation/world/world.hpp"

namespace ground_scale_vo::simulation {
namespace {

using Positions = std::vector<Eigen::Vector3d>;  // x right, y down, z forward [m]

/// Straight on for `straight` m, then a left turn by `turn` rad with `radius`, one position per
/// `step` m, uphill by `slope`.
Positions curve(double straight, double radius, double turn, double step, double slope = 0) {
  Positions positions;
  const double length = straight + radius * turn;
  for (double s = 0; s <= length; s += step) {
    const double angle = std::max(s - straight, 0.0) / radius;
    positions.emplace_back(-radius * (1 - std::cos(angle)), -slope * s,
                           std::min(s, straight) + radius * std::sin(angle));
  }
  return positions;
}

void addNoise(Positions& positions, const Eigen::Vector3d& sigma) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (Eigen::Vector3d& p : positions) {
    p += sigma.cwiseProduct(Eigen::Vector3d(normal(random), normal(random), normal(random)));
  }
}

std::string refusal(const Positions& positions) {
  try {
    const RecordedPath path(positions, 10);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "";
}

TEST(UniformSpline, ReproducesALineAndItsDerivatives) {
  const UniformSpline line(-1, 0.5, {2, 3, 4, 5});
  for (const double x : {-4.0, -1.0, -0.7, 0.2, 0.5, 3.0}) {
    EXPECT_NEAR(line.value(x), 2 + 2 * (x + 1), 1e-12) << x;
    EXPECT_NEAR(line.derivative(x), 2, 1e-12) << x;
    EXPECT_NEAR(line.secondDerivative(x), 0, 1e-12) << x;
  }
  const UniformSpline wave(0, 0.1, {0, 1, 0, -1, 2, 1, 1});
  constexpr double kStep = 1e-5;
  for (double x = -0.05; x < 0.7; x += 0.013) {
    const double difference = wave.value(x + kStep) - wave.value(x - kStep);
    EXPECT_NEAR(wave.derivative(x), difference / (2 * kStep), 1e-3) << x;
    const double change = wave.derivative(x + kStep) - wave.derivative(x - kStep);
    EXPECT_NEAR(wave.secondDerivative(x), change / (2 * kStep), 1e-2) << x;
  }
}

TEST(RecordedPath, FollowsNoisyPositions) {
  Positions positions = curve(40, 20, M_PI, 0.8, 0.05);
  addNoise(positions, {0.01, 0.05, 0.01});
  const RecordedPath path(positions, 10);
  EXPECT_NEAR(path.length(), 40 + 20 * M_PI, 1.0);
  EXPECT_NEAR(path.topSpeed(), 8, 0.5);
  for (double s = 5; s < 35; s += 0.5) EXPECT_NEAR(path.heading(s), path.heading(20), 0.03) << s;
  for (double s = 46; s < 98; s += 0.5) EXPECT_NEAR(path.curvature(s), 0.05, 0.02) << s;
  EXPECT_NEAR(path.heading(98) - path.heading(20), 58 / 20.0, 0.05);
  for (double s = 0; s < 100; s += 0.5) {
    EXPECT_NEAR(path.slope(s), 0.05, 0.01) << s;
    EXPECT_NEAR(path.elevation(s), 0.05 * s, 0.08) << s;
  }
  for (double t = 0.5; t < 12; t += 0.03) {
    EXPECT_NEAR(path.at(t).s, 8 * t, 0.3) << t;
    EXPECT_NEAR(path.at(t).v, 8, 0.4) << t;
    EXPECT_LT(std::abs(path.at(t).a), 1.5) << t;
  }
}

TEST(RecordedPath, StandsStillInSpiteOfNoise) {
  Positions positions = curve(30, 20, 0.1, 0.6);
  const Positions rest = curve(30, 20, 0.1, 0.6);
  positions.resize(30);
  positions.insert(positions.end(), 60, rest[30]);
  positions.insert(positions.end(), rest.begin() + 31, rest.end());
  addNoise(positions, {0.002, 0.002, 0.002});
  const RecordedPath path(positions, 10);
  const double stop = path.at(5).s;
  for (int i = 48; i < 75; ++i) {
    EXPECT_EQ(path.at(i / 10.0).s, stop) << i;
    EXPECT_EQ(path.at(i / 10.0).v, 0) << i;
  }
  EXPECT_NEAR(path.at(2).v, 6, 0.3);
  EXPECT_GE(path.at(4).v, 0);
}

TEST(RecordedPath, RefusesWhatIsNoRoad) {
  EXPECT_EQ(refusal(curve(100, 20, 1, 1)), "");
  EXPECT_NE(refusal({}).find("has a path of 0 m"), std::string::npos);
  EXPECT_NE(refusal(curve(15, 20, 0, 1)).find("has a path of 15 m"), std::string::npos);
  Positions positions = curve(100, 20, 1, 1);
  positions[20].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(refusal(positions).find("pose 21 is not finite"), std::string::npos);
  positions = curve(100, 20, 1, 1);
  positions[50].z() += 30;
  EXPECT_NE(refusal(positions).find("pose 51 is more than 20 m"), std::string::npos);
  EXPECT_NE(refusal(curve(60, 1.5, 3, 0.5)).find("radius below 3.3 m"), std::string::npos);
}

/// A street along a path that crosses itself 30 m from its start: a loop to the left.
class StreetWithCrossing : public testing::Test {
 protected:
  StreetWithCrossing()
      : path_(std::make_shared<RecordedPath>(curve(60, 20, 1.9 * M_PI, 1), 10)),
        road_(shape(), -25, path_->length() + 60),
        world_(road_, WorldOptions()) {
    for (double s = road_.sBegin(); s < road_.sEnd(); s += 0.5) {
      lane_.emplace_back(s, road_.surfacePoint(s, 0).head<2>());
    }
  }

  RoadShape shape() const {
    RoadShape shape;
    shape.path = path_;
    return shape;
  }
  /// Distance in the plan from p to the lane at least `apart` m from s.
  double distanceToLane(double s, const Eigen::Vector3d& p, double apart) const {
    double squared = 1e9;
    for (const auto& [at, middle] : lane_) {
      if (std::abs(at - s) >= apart)
        squared = std::min(squared, (middle - p.head<2>()).squaredNorm());
    }
    return std::sqrt(squared);
  }

  const std::shared_ptr<const RecordedPath> path_;
  const RoadGeometry road_;
  const World world_;
  std::vector<std::pair<double, Eigen::Vector2d>> lane_;  // s and its middle [m]
};

TEST_F(StreetWithCrossing, NothingStandsOnTheRoad) {
  constexpr double kHeadroom = 2.6, kCar = 1.2;  // clear height, half the width of a car [m]
  int objects = 0, near_crossing = 0;
  for (const Instance& instance : world_.scene().instances) {
    if (std::isnan(instance.s) || !instance.reflected) continue;  // terrain, road
    ++objects;
    for (const Vertex& vertex : instance.mesh->vertices) {
      const Eigen::Vector3d p = instance.T_w_m * vertex.p;
      if (p.z() > kHeadroom) continue;
      const double distance = distanceToLane(instance.s, p, 0);
      ASSERT_GT(distance, kCar) << "at " << instance.s << " m: " << p.transpose();
      near_crossing += distance < 12;
    }
  }
  EXPECT_GT(objects, 30);
  EXPECT_GT(near_crossing, 0);
}

TEST_F(StreetWithCrossing, KerbsEndAtTheOtherCarriageway) {
  constexpr double kOther = 30;  // [m] along the lane to a part that is another one
  int raised = 0;
  for (const Instance& instance : world_.scene().instances) {
    if (std::isnan(instance.s) || instance.reflected) continue;
    for (const Vertex& vertex : instance.mesh->vertices) {
      if (vertex.p.z() < 0.06) continue;  // the carriageway
      ++raised;
      // A mesh begins at instance.s and is 10 m long.
      ASSERT_GT(distanceToLane(instance.s + 5, vertex.p, kOther), -kRightKerb)
          << "at " << instance.s << " m: " << vertex.p.transpose();
    }
  }
  EXPECT_GT(raised, 1000);
}

TEST_F(StreetWithCrossing, KerbsRemainElsewhere) {
  double left = -1e9, right = 1e9;  // offsets of raised vertices at s = 5 m, far from the crossing
  for (const Instance& instance : world_.scene().instances) {
    if (std::isnan(instance.s) || instance.reflected) continue;
    for (const Vertex& vertex : instance.mesh->vertices) {
      if (vertex.p.z() < 0.06 || std::abs(vertex.p.x() - 5) > 1) continue;
      left = std::max(left, vertex.p.y());
      right = std::min(right, vertex.p.y());
    }
  }
  EXPECT_GT(left, kLeftPavement);
  EXPECT_LT(right, kRightPavement);
}

TEST(RecordedRoad, OnlyASectionExists) {
  RoadShape shape;
  shape.path = std::make_shared<RecordedPath>(curve(600, 20, 1, 1), 10);
  const RoadGeometry road(shape, -25, 700), generated(RoadShape(), -25, 700);
  EXPECT_TRUE(road.isInSection(100, 100));
  EXPECT_TRUE(road.isInSection(100 + kSectionAhead - 1, 100));
  EXPECT_FALSE(road.isInSection(100 + kSectionAhead + 1, 100));
  EXPECT_FALSE(road.isInSection(100 - kSectionBehind - 1, 100));
  EXPECT_TRUE(generated.isInSection(600, 100));
}

SyntheticDrive::Options recordedDrive(const Positions& positions) {
  SyntheticDrive::Options options;
  options.path = positions;
  options.frames = static_cast<int>(positions.size());
  return options;
}

TEST(RecordedDrive, TheCameraFollowsThePositions) {
  const Positions positions = curve(50, 15, M_PI / 2, 0.9, 0.04);
  SyntheticDrive::Options options = recordedDrive(positions);
  options.suspension = 0;
  options.pitch_rad = 0;
  const SyntheticDrive drive(options);
  ASSERT_EQ(drive.size(), positions.size());
  // The first camera of the drive looks along the slope, that of the positions straight ahead.
  Eigen::Isometry3d T_p_c0 = Eigen::Isometry3d::Identity();
  T_p_c0.rotate(Eigen::AngleAxisd(std::atan(0.04), Eigen::Vector3d::UnitX()));
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Eigen::Vector3d p = T_p_c0 * drive.frame(i).T_c0_c.translation();
    EXPECT_LT((p - positions[i]).norm(), 0.3) << i << ": " << p.transpose();
    EXPECT_NEAR(drive.frame(i).height, options.camera_height, 1e-9);
  }
  const Eigen::Vector3d ahead =
      T_p_c0.linear() * drive.frame(drive.size() - 1).T_c0_c.linear().col(2);
  EXPECT_LT(ahead.x(), -0.95);  // after the left turn
}

TEST(RecordedDrive, RejectsMoreFramesThanPositions) {
  SyntheticDrive::Options options = recordedDrive(curve(50, 15, 1, 1));
  ++options.frames;
  EXPECT_THROW(SyntheticDrive{options}, OptionError);
}

TEST(RecordedDrive, VibratesNoMoreThanAtTheTopSpeed) {
  const auto bounce = [](double step) {
    const SyntheticDrive drive(recordedDrive(curve(200, 15, 0, step)));
    double largest = 0;
    for (std::size_t i = 0; i < drive.size(); ++i) {
      largest = std::max(largest, std::abs(drive.frame(i).height - drive.cameraHeight()));
    }
    return largest;
  };
  EXPECT_NEAR(bounce(2.7), bounce(0.9), 0.003);
}

}  // namespace
}  // namespace ground_scale_vo::simulation
