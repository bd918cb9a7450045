#include "ground_scale_vo/evaluation/clock_offset.hpp"
#include "ground_scale_vo/evaluation/speed_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

constexpr double kStart = 1.7e9;  // [s]

/// A drive in a town: accelerations and a stop.
double speedAt(double t) {
  return std::max(0.0, 8 + 5 * std::sin(0.21 * t) + 3 * std::sin(0.53 * t + 1) - 0.02 * t);
}

/// Samples of a function of the true time [s], from one to another, whose clock is late.
template <typename Speed>
std::vector<SpeedSample> samples(const Speed& speed, double from, double to, double rate,
                                 double late = 0, double noise = 0, double unit = 1) {
  std::mt19937_64 random(static_cast<std::uint64_t>(7 + 1000 * std::abs(late)));
  std::normal_distribution<double> error(0, 1);
  std::vector<SpeedSample> result;
  for (int i = 0; from + i / rate <= to; ++i) {
    const double t = from + i / rate;
    result.push_back(
        {std::llround(1e9 * (kStart + t + late)), unit * (speed(t) + noise * error(random)), 0});
  }
  return result;
}

struct Case {
  double from, to, rate, late, noise, unit;
  double tolerance;
};

class ClockOffsets : public testing::TestWithParam<Case> {};

TEST_P(ClockOffsets, IsFound) {
  const Case& c = GetParam();
  const auto offset = clockOffset(samples(speedAt, 0, 40, 10),
                                  samples(speedAt, c.from, c.to, c.rate, c.late, c.noise, c.unit));
  ASSERT_TRUE(offset);
  EXPECT_NEAR(offset->offset_s, -c.late, c.tolerance);
  EXPECT_LT(std::abs(offset->offset_s + c.late), 4 * offset->sigma_s + 0.01);
  EXPECT_LT(offset->sigma_s, c.tolerance);
}

INSTANTIATE_TEST_SUITE_P(
    Cases, ClockOffsets,
    testing::Values(Case{0, 40, 10, 0, 0, 1, 0.02},         // the same clock
                    Case{0, 40, 10, 18, 0.1, 1, 0.1},       // time of GPS against UTC
                    Case{0, 40, 1, 1, 0.1, 3.6, 0.1},       // one sample a second, km/h
                    Case{-600, 900, 5, -0.4, 0.1, 1, 0.1},  // a long log beside a short video
                    Case{15, 40, 10, -kStart, 0.1, 2.24,
                         0.1},                                // a clock that starts with the drive
                    Case{0, 40, 10, 2.5, 0.5, 0.001, 0.3}));  // noise

TEST(ClockOffset, IsNotGuessed) {
  const auto reference = samples(speedAt, 0, 40, 10);
  const auto constant = [](double) { return 12.0; };
  const auto periodic = [](double t) { return 8 + 3 * std::sin(0.8 * t); };
  const auto another = [](double t) { return speedAt(700 - 1.7 * t); };
  EXPECT_FALSE(clockOffset(reference, samples(constant, 0, 40, 10)));
  EXPECT_FALSE(
      clockOffset(samples(constant, 0, 40, 10, 0, 0.1), samples(constant, 0, 40, 10, 1, 0.1)));
  EXPECT_FALSE(clockOffset(samples(periodic, 0, 40, 10), samples(periodic, 0, 40, 10, 1)));
  EXPECT_FALSE(clockOffset(reference, samples(another, 0, 40, 10)));
  EXPECT_FALSE(clockOffset(reference, samples(speedAt, 0, 5, 10)));  // too short
  EXPECT_FALSE(clockOffset(reference, {}));
}

/// The interval without samples is not interpolated.
TEST(ClockOffset, IgnoresGaps) {
  auto other = samples(speedAt, 0, 18, 10, 1);
  const auto rest = samples(speedAt, 25, 40, 10, 1);
  other.insert(other.end(), rest.begin(), rest.end());
  const auto offset = clockOffset(samples(speedAt, 0, 40, 10), other);
  ASSERT_TRUE(offset);
  EXPECT_NEAR(offset->offset_s, -1, 0.02);
}

using SpeedFile = TemporaryFolder;

TEST_F(SpeedFile, SpeedsAndTheirDeviationsAreOfTheStatedUnit) {
  const std::vector<SpeedSample> speeds = readSpeeds(
      write("speeds.csv", "stamp,speed_kmh,sigma\n10.5,36,3.6\n10.6,-18,7.2\n"), "", true);
  ASSERT_EQ(speeds.size(), 2u);
  EXPECT_EQ(speeds[0].stamp_ns, 10500000000);
  EXPECT_NEAR(speeds[0].speed, 10, 1e-9);
  EXPECT_NEAR(speeds[0].sigma, 1, 1e-9);
  EXPECT_NEAR(speeds[1].speed, -5, 1e-9);
  EXPECT_NEAR(speeds[1].sigma, 2, 1e-9);
}

}  // namespace
}  // namespace gsv
