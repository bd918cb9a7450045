#include "scale/path_speed.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "support/learned_height.hpp"

namespace gsv {
namespace {

std::int64_t ns(double seconds) { return std::llround(1e9 * seconds); }

using SpeedAt = std::function<double(double)>;

/// Samples at 10 Hz from `from` up to `to` [s].
void add(SpeedTrack* track, double from, double to, const SpeedAt& speed) {
  for (int i = 0; from + 0.1 * i < to - 1e-9; ++i) {
    const double t = from + 0.1 * i;
    track->add({ns(t), speed(t), 0});
  }
}
SpeedTrack trackOf(double from, double to, const SpeedAt& speed) {
  SpeedTrack track(0.05);
  add(&track, from, to, speed);
  return track;
}

double metres(const SpeedTrack& track, double from, double to) {
  double sigma = 0;
  return track.distance(ns(from), ns(to), &sigma).value_or(std::nan(""));
}

TEST(SpeedTrack, IntegratesBetweenStampsThatItCovers) {
  const SpeedTrack track = trackOf(1, 6.05, [](double t) { return 2 * t; });
  EXPECT_NEAR(metres(track, 1.23, 4.56), 4.56 * 4.56 - 1.23 * 1.23, 1e-9);
  EXPECT_NEAR(track.speedAt(ns(2.345)), 4.69, 1e-9);
  EXPECT_TRUE(std::isnan(metres(track, 0.9, 2)));  // before the first
  EXPECT_TRUE(std::isnan(metres(track, 2, 6.1)));  // after the last
  EXPECT_TRUE(std::isnan(metres(track, 2, 2)));
  double sigma = 0;
  track.distance(ns(1), ns(5), &sigma);
  EXPECT_NEAR(sigma, 0.05 * std::sqrt(4 * 0.1), 0.002);
}

TEST(SpeedTrack, IgnoresWhatIsNoSpeed) {
  SpeedTrack track = trackOf(0, 1.05, [](double) { return 5; });
  track.add({ns(1.1), std::nan(""), 0});
  track.add({ns(1.1), 1e9, 0});
  track.add({ns(0.5), 7, 0});  // out of order
  EXPECT_EQ(track.samples().size(), 11u);
  track.add({ns(100), 5, 0});
  EXPECT_TRUE(std::isnan(metres(track, 0.5, 99)));  // a gap
  track.add({ns(50), 6, 0});                        // the clock was set back
  EXPECT_EQ(track.samples().size(), 1u);
}

TEST(SpeedTrack, LeavesOutASlipAndBelievesANewLevelLater) {
  const auto track = trackOf(0, 10.05, [](double t) { return t > 3.95 && t < 5.95 ? 13 : 10; });
  EXPECT_NEAR(metres(track, 1, 9), 80, 0.01);
  EXPECT_FALSE(track.jumped());
  SpeedTrack other = trackOf(0, 5.05, [](double t) { return t > 2.95 ? 13 : 10; });
  EXPECT_TRUE(other.jumped());
  EXPECT_TRUE(std::isnan(metres(other, 1, 4)));
  add(&other, 5.1, 9.05, [](double) { return 13; });
  EXPECT_FALSE(other.jumped());
  EXPECT_NEAR(metres(other, 8, 9), 13, 1e-9);
}

TEST(SpeedTrack, AStopIsOneThatTheVehicleBrakesTo) {
  SpeedTrack track = trackOf(0, 5.05, [](double t) { return std::max(0.0, 4 - 2 * t); });
  EXPECT_TRUE(track.standsStill(ns(3), ns(5)));
  EXPECT_TRUE(track.standsStill(ns(3), ns(5.1)));   // the next one is not due yet
  EXPECT_FALSE(track.standsStill(ns(3), ns(5.5)));  // silent
  EXPECT_FALSE(track.standsStill(ns(1), ns(5)));
  track.ignoreZero();
  EXPECT_FALSE(track.standsStill(ns(3), ns(5)));

  for (const double before : {8, 0}) {  // failed, dead
    const auto failed = trackOf(0, 5.05, [=](double t) { return t < 2 ? before : 0; });
    EXPECT_FALSE(failed.standsStill(ns(3), ns(5)));
  }
}

double speed(double t) { return 8 + 2 * std::sin(0.8 * t); }

/// The error or warning after a drive of 20 s at speed(), with a pose every 0.5 s in metres. sign:
/// of the motion along the optical axis.
std::string warningOf(const SpeedAt& sensor, double sign = 1) {
  PathSpeed path_speed(0.05);
  CameraPath path;
  for (double t = 0; t < 20; t += 0.5) {
    for (double s = t == 0 ? 0 : t - 0.4; s < t + 0.05; s += 0.1)
      path_speed.add({ns(s), sensor(s), 0});
    const double z = 8 * t + 2.5 * (1 - std::cos(0.8 * t));
    path.add({ns(t), Eigen::Isometry3d(Eigen::Translation3d(0, 0, sign * z))});
    if (path_speed.speeds().empty()) continue;
    if (const auto piece = path_speed.measure(path, 1)) {
      path_speed.add(*piece, std::abs(piece->error) < 0.15, path);
    }
  }
  const std::string error = path_speed.error();
  return error.empty() ? path_speed.warning(ns(19.5)) : error;
}

/// Of a sensor whose value is repeated for a time [s].
double held(double t, double time) { return speed(time * std::floor(t / time + 1e-9)); }

TEST(PathSpeed, NamesWhatIsWrong) {
  const SpeedAt correct[] = {speed, [](double t) { return held(t, 1); },  // a value at 1 Hz
                             [](double t) { return std::round(3.6 * held(t, 1)) / 3.6; },
                             [](double t) { return 1.03 * speed(t); }};
  for (const SpeedAt& sensor : correct) EXPECT_EQ(warningOf(sensor), "") << &sensor - correct;
  const auto expectNamed = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text << "; expected: " << part;
  };
  const std::string late = warningOf([](double t) { return speed(t - 0.2); });
  expectNamed(late, "0.2");
  expectNamed(late, "s later than the motion");
  expectNamed(warningOf([](double t) { return 1.3 * speed(t); }), "another unit");
  for (const SpeedUnit& unit : kSpeedUnits) {
    const double factor = 1 / unit.metres_per_second;
    if (factor == 1) continue;
    expectNamed(warningOf([=](double t) { return factor * speed(t); }),
                factor > 100 ? "is its unit m/s?" : unit.symbol);
    expectNamed(warningOf([=](double t) { return speed(t) / factor; }), unit.symbol);
  }
  expectNamed(warningOf([](double t) { return speed(std::min(t, 5.9)); }), "stuck");
  expectNamed(warningOf([](double t) { return t < 17 ? speed(t) : 1.4 * speed(t); }), "jumps to");
  expectNamed(warningOf([](double t) { return -speed(t); }), "sign");
  expectNamed(warningOf(speed, -1), "sign");
  PathSpeed none(0.05), other_clock(0.05);
  expectNamed(none.warning(0), "no speed");
  other_clock.add({ns(1000), 5, 0});
  expectNamed(other_clock.warning(0), "1000.0 s later than the images");
}

TEST(PathSpeed, OfTheMapBeforeIsNotCurrent) {
  PathSpeed path_speed(0.05);
  for (int i = 0; i < 10; ++i) path_speed.add({ns(0.5 * i), 8 + 0.1 * i, 0});
  CameraPath path;
  for (int i = 0; i < 5; ++i) {
    path.add({ns(0.5 * i), Eigen::Isometry3d(Eigen::Translation3d(0, 0, 4.0 * i))});
  }
  const auto piece = path_speed.measure(path, 1);
  ASSERT_TRUE(piece);
  path_speed.add(*piece, true, path);
  EXPECT_TRUE(path_speed.isCurrent(path, 1));
  path_speed.startMap();
  CameraPath next;
  next.add({ns(2.5), Eigen::Isometry3d::Identity()});
  EXPECT_FALSE(path_speed.isCurrent(next, 1));
}

TEST(CameraHeight, AnImplausibleOneIsNamedWithBothNumbers) {
  EXPECT_EQ(heightWarning(1.65, 0.02, learned(1.58, 0.01)),
            "the camera height is given as 1.65 +- 0.02 m, but by the speeds it is 1.58 +- 0.01 m: "
            "check the mounting, the load and the unit of the speed");
  EXPECT_NE(heightWarning(1.65, 0.02, learned(1.72, 0.01)), "");
  EXPECT_EQ(heightWarning(1.65, 0.02, learned(1.60, 0.01)), "");
  EXPECT_EQ(heightWarning(1.65, 0.02, learned(1.58, 0.03)), "") << "not known well enough yet";
  EXPECT_EQ(heightWarning(1.65, 0, learned(1.65, 0)), "");
  EXPECT_EQ(heightWarning(0, 0, learned(1.58, 0.01)), "") << "none is given";
  EXPECT_EQ(heightWarning(0, 0, learned(0, 0)), "") << "not known yet";
}

TEST(CameraHeight, ThatOfNoVehicleOrAnotherThanTheGivenIsAnError) {
  EXPECT_EQ(heightError(0, 0, 1.58), "");
  EXPECT_EQ(heightError(0, 0, 0), "") << "not known yet";
  EXPECT_EQ(heightError(0, 0, 5.94),
            "the camera height is 5.94 m by the speeds, outside 0.2 to 4 m: their unit looks like "
            "km/h (1.65 m) or mph (2.66 m) or knots (3.06 m)");
  EXPECT_EQ(heightError(0, 0, 0.15),
            "the camera height is 0.15 m by the speeds, outside 0.2 to 4 m: they look like m/s "
            "taken as km/h (0.54 m) or mph (0.34 m) or knots (0.29 m)");
  const std::string given = "the camera height is given as 1.65 m, but by the speeds it is ";
  EXPECT_EQ(heightError(1.65, 0.02, 1.76), "");
  EXPECT_EQ(heightError(1.65, 0.02, 1.8), given + "1.80 m: one of them is wrong");
  EXPECT_EQ(heightError(1.65, 0.02, 1.5), given + "1.50 m: one of them is wrong");
  EXPECT_EQ(heightError(1.65, 0.1, 1.8), "") << "it is given as uncertain";
  EXPECT_EQ(heightError(1.65, 0.02, 3.7), given + "3.70 m: their unit looks like mph taken as m/s");
}

}  // namespace
}  // namespace gsv
