#include "simulation/world/recorded_path.hpp"

#include "simulation/synthetic_drive.hpp"
#include "support/test.hpp"

namespace gsv::simulation {
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
    EXPECT_NEAR(path.elevation(s) - path.elevation(50), 0.05 * (s - 50), 0.08) << s;
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
  const Positions good = curve(100, 20, 1, 1);
  EXPECT_NO_THROW(RecordedPath(good, 10));
  Positions broken = good, jumping = good;
  broken[20].x() = kNan;
  jumping[50].z() += 30;
  const std::pair<Positions, const char*> kCases[] = {
      {{}, "has a path of 0 m"},
      {curve(15, 20, 0, 1), "has a path of 15 m"},
      {broken, "pose 21 is not finite"},
      {jumping, "pose 51 is more than 20 m"},
      {curve(60, 1.5, 3, 0.5), "radius below 3.3 m"}};
  for (const auto& [positions, reason] : kCases) {
    expectThrows<OptionError>([p = positions] { RecordedPath(p, 10); }, reason);
  }
}

TEST(RecordedDrive, TheCameraFollowsThePositions) {
  const Positions positions = curve(50, 15, M_PI / 2, 0.9, 0.04);
  SyntheticDrive::Options options;
  options.path = positions;
  options.frames = static_cast<int>(positions.size()) + 1;
  EXPECT_THROW(SyntheticDrive{options}, OptionError) << "more frames than positions";
  --options.frames;
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

}  // namespace
}  // namespace gsv::simulation
