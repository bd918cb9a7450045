#include "scale/scale_filter.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

namespace gsv {
namespace {

constexpr double kRoadDistance = 5;  ///< of the measured road [VO units]

/// A filter with a given camera height, which sees road at one distance.
struct Filter : ScaleFilter {
  explicit Filter(const Options& options = {}) : ScaleFilter(options, {1, 0, 0}) {}
  void predict(double distance, double angle, double k1_sigma = 0.02) {
    ScaleFilter::predict(distance, angle, k1_sigma);
  }
  bool measure(double height, double sigma, Source source = Source::kFeatureBased) {
    return update(height, sigma, kRoadDistance, source);
  }
  /// Drives `frames` steps of 0.5 VO units with the same measured height. Returns how many
  /// measurements it used.
  int drive(int frames, double height, double sigma, Source source = Source::kFeatureBased) {
    int used = 0;
    for (int i = 0; i < frames; ++i) {
      predict(0.5, 0);
      used += measure(height, sigma, source);
    }
    return used;
  }
  double sigma() const { return known() ? scaleSigma() * height() / scale() : 0; }  ///< of height()
};

/// At a height of 0.8, after a hundred measurements.
Filter convergedFilter() {
  Filter filter;
  filter.drive(100, 0.8, 0.02);
  return filter;
}

/// Without NIS scaling: the variance follows from the options alone.
ScaleFilter::Options withoutNisScaling() {
  ScaleFilter::Options options;
  options.nis_memory_heights = 1e6;
  return options;
}

TEST(ScaleFilter, AWrongStartOrRestartIsReplacedSoon) {
  Filter filter;
  filter.predict(1, 0);
  EXPECT_TRUE(filter.measure(2, 0.02));
  EXPECT_GT(filter.drive(4, 0.8, 0.02), 0);
  EXPECT_NEAR(filter.height(), 0.8, 1e-9);
  EXPECT_GT(filter.sigma(), 0.05 * 0.8);
  filter.drive(100, 0.8, 0.02);
  while (filter.height() < 1) filter.drive(1, 1.2, 0.02);
  filter.drive(1, 1.2, 0.02);
  filter.drive(5, 0.8, 0.02);  // two camera heights
  EXPECT_NEAR(filter.height(), 0.8, 0.01);
}

// The unit of the map changes in a turn with a radius of 7 m; the camera is 1.65 m above the road.
TEST(ScaleFilter, AcceptsConsistentMeasurementsWithinThreeMetresOfATurn) {
  Filter filter;
  filter.drive(100, 1, 0.02);
  constexpr double kHeight = 0.8, kMetre = kHeight / 1.65, kStep = 0.3;
  double driven = 0;  // [m]
  while (driven < 6 && std::abs(filter.height() - kHeight) > 0.02) {
    filter.predict(kStep * kMetre, kStep / 7);
    filter.measure(kHeight, 0.01);
    driven += kStep;
  }
  EXPECT_LE(driven, 3 + kStep);
}

/// Measured height of 1 in a map with a tilt [rad] that decays with the distance travelled.
double tiltedHeight(double tilt, double road_distance, double travelled) {
  return std::exp(tilt * road_distance * std::exp(-travelled / (0.8 * road_distance)));
}

// Monte Carlo of the model: a tilt with the standard deviation of the options, white noise of each
// measurement.
TEST(ScaleFilter, SigmaOfAYoungMapFitsRandomTilts) {
  constexpr double kNoise = 0.015, kDistance = 6;
  const ScaleFilter::Options options = withoutNisScaling();
  std::mt19937 random(3);
  std::normal_distribution<double> tilt(0, options.start_tilt_sigma_rad), noise(0, kNoise);
  constexpr int kRuns = 1000;
  constexpr double kSteps[] = {1, 5, 5};  // to the first measurement, to the second ... [VO units]
  double nees[std::size(kSteps)] = {};
  for (int run = 0; run < kRuns; ++run) {
    Filter filter(options);
    const double run_tilt = tilt(random);
    double travelled = 0;
    for (std::size_t i = 0; i < std::size(kSteps); ++i) {
      filter.predict(kSteps[i], 0);
      travelled += kSteps[i];
      // Its sigma of zero leaves the lower bound, which is kNoise.
      filter.update(tiltedHeight(run_tilt, kDistance, travelled) * std::exp(noise(random)), 0,
                    kDistance);
      nees[i] += std::pow(std::log(filter.height()) * filter.height() / filter.sigma(), 2) / kRuns;
    }
  }
  for (const double value : nees) {
    EXPECT_GT(value, 0.7);  // later heights drift less here than modelled
    EXPECT_LT(value, 1.15);
  }
}

TEST(ScaleFilter, DoesNotDependOnTheFrameRate) {
  Filter slow, fast;
  slow.drive(8, 0.8, 0.03);
  fast.drive(8, 0.8, 0.03);
  for (int i = 0; i < 10; ++i) {
    slow.predict(0.5, 0);
    slow.measure(0.84, 0.03);
    for (int k = 0; k < 10; ++k) {
      fast.predict(0.05, 0);
      fast.measure(0.84, 0.03);
    }
  }
  EXPECT_NEAR(slow.height(), fast.height(), 0.002);
  EXPECT_NEAR(slow.sigma(), fast.sigma(), 0.001);
}

TEST(ScaleFilter, IsTheSameInAnyUnit) {
  constexpr double kUnit = 100;
  Filter filter, scaled;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 0.01);
  for (int i = 0; i < 150; ++i) {
    const double angle = i % 10 == 0 ? 0.1 : 0;
    const double height = (i < 40 ? 0.8 : 1.6) + noise(random);  // a restart
    const auto source =
        i % 3 == 0 ? ScaleFilter::Source::kDirect : ScaleFilter::Source::kFeatureBased;
    filter.predict(0.3, angle);
    scaled.predict(0.3 * kUnit, angle);
    EXPECT_EQ(filter.update(height, 0.03, kRoadDistance, source),
              scaled.update(height * kUnit, 0.03 * kUnit, kRoadDistance * kUnit, source));
    ASSERT_NEAR(scaled.height() / kUnit, filter.height(), 1e-9) << i;
    ASSERT_NEAR(scaled.sigma() / kUnit, filter.sigma(), 1e-9) << i;
  }
  EXPECT_NEAR(filter.height(), 1.6, 0.1);
}

TEST(ScaleFilter, SingleOutliersAreRejectedAndAPersistentChangeRestarts) {
  Filter filter = convergedFilter();
  filter.predict(0.5, 0);
  EXPECT_FALSE(filter.measure(1.2, 0.02));
  EXPECT_NEAR(filter.height(), 0.8, 1e-6);
  EXPECT_EQ(filter.drive(5, 0.8, 0.02), 5);
  // Five VO units are about 4 camera heights of 1.2; a restart needs 12.
  EXPECT_EQ(filter.drive(10, 1.2, 0.02), 0);
  EXPECT_NEAR(filter.height(), 0.8, 1e-6);
  EXPECT_GT(filter.drive(40, 1.2, 0.02), 0);
  EXPECT_NEAR(filter.height(), 1.2, 0.01);
}

// The restart has the median of the latest measurements and the sigma of a new map. Outliers before
// them do not delay it.
TEST(ScaleFilter, ARestartIsLikeTheStartOfANewMap) {
  Filter filter = convergedFilter();
  for (const double outlier : {0.4, 2.0}) filter.drive(1, outlier, 0.02);
  for (const double height : {1.2, 1.2, 1.2, 1.32}) {
    filter.predict(6, 0);
    EXPECT_EQ(filter.measure(height, 0.02), height > 1.3);
  }
  EXPECT_NEAR(filter.height(), 1.2, 1e-9);
  Filter new_map;
  new_map.predict(1, 0);
  ASSERT_TRUE(new_map.measure(1.2, 0.02));
  EXPECT_NEAR(filter.sigma(), new_map.sigma(), 0.2 * new_map.sigma());
}

TEST(ScaleFilter, TheGateIsInStandardDeviationsOfTheInnovation) {
  ScaleFilter::Options options = withoutNisScaling();
  options.start_tilt_sigma_rad = 0;
  // State and measurement have the same variance.
  const double gate = 3 * std::sqrt(2) * 0.015;
  for (const double sign : {-1.0, 1.0}) {
    Filter filter(options);
    filter.predict(1, 0);
    filter.measure(0.8, 0);
    EXPECT_FALSE(filter.measure(0.8 * std::exp(1.02 * sign * gate), 0));
    EXPECT_TRUE(filter.measure(0.8 * std::exp(0.98 * sign * gate), 0));
  }
}

// Except outliers of the features among direct measurements, see
// DirectMeasurementsAtAWrongPeakDoNotPreventARestart.
TEST(ScaleFilter, OutliersAmongOtherMeasurementsOrThatDisagreeDoNotRestart) {
  using Source = ScaleFilter::Source;
  for (const auto& [outlier, other] : {std::pair(Source::kFeatureBased, Source::kFeatureBased),
                                       std::pair(Source::kDirect, Source::kFeatureBased),
                                       std::pair(Source::kDirect, Source::kDirect)}) {
    Filter filter = convergedFilter();
    for (int i = 0; i < 30; ++i) {
      EXPECT_EQ(filter.drive(1, 1.2, 0.02, outlier), 0);
      EXPECT_EQ(filter.drive(2, 0.8, 0.02, other), 2);
    }
    EXPECT_NEAR(filter.height(), 0.8, 1e-6);
  }
  for (const double other : {0.4, 2.0}) {
    Filter filter = convergedFilter();
    for (int i = 0; i < 30; ++i) {
      filter.drive(1, 1.2, 0.02);
      filter.drive(1, other, 0.02);
    }
    EXPECT_NEAR(filter.height(), 0.8, 1e-6) << other;
  }
}

TEST(ScaleFilter, IgnoresInvalidMeasurements) {
  Filter filter = convergedFilter();
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL, -1.0, 0.0}) {
    EXPECT_FALSE(filter.measure(bad, 0.02)) << bad;
    if (bad == 0) continue;
    EXPECT_FALSE(filter.measure(0.8, bad)) << bad;
    EXPECT_FALSE(filter.update(0.8, 0.02, bad)) << bad;
  }
  EXPECT_NEAR(filter.height(), 0.8, 1e-9);
  EXPECT_TRUE(std::isfinite(filter.scaleSigma()));
  EXPECT_TRUE(filter.measure(0.8, 0.02));
}

TEST(ScaleFilter, TheMovingAverageIsOverTheScaleNotTheHeight) {
  ScaleFilter::Options options;
  options.moving_average_frames = 2;
  Filter filter(options);
  filter.measure(1.0, 0.1);
  EXPECT_DOUBLE_EQ(filter.height(), 1.0);
  EXPECT_NEAR(filter.sigma(), std::hypot(0.1, 0.015), 1e-12);
  filter.measure(0.5, 0.1);
  EXPECT_NEAR(1 / filter.height(), 1.5, 1e-12);
  filter.measure(0.5, 0.1);
  EXPECT_NEAR(1 / filter.height(), 2.0, 1e-12);
}

TEST(ScaleFilter, ALearnedCameraHeightOutlastsTheMap) {
  ScaleFilter filter({}, {1.65, 0.5, 0});
  for (int i = 0; i < 100; ++i) {
    filter.predict(1, 0, 0.003);
    filter.updateSpeed(2, 0.01);
    filter.update(0.95, 0.01, kRoadDistance);  // 1.9 m
  }
  const double sigma = filter.cameraHeightSigma();
  EXPECT_NEAR(filter.cameraHeight(), 1.9, 0.02);
  EXPECT_LT(sigma, 0.05);
  filter.startMap();
  EXPECT_NEAR(filter.cameraHeight(), 1.9, 0.02);
  EXPECT_EQ(filter.cameraHeightSigma(), sigma);
  filter.predict(10, 0, 0.003);
  filter.update(3.8, 0.01, 4 * kRoadDistance);
  EXPECT_NEAR(filter.scale(), 0.5, 0.02);
}

// The points of a map that turns before it has a scale are less accurate, too.
TEST(ScaleFilter, ATurnAddsNoiseAndLessWithAKnownLens) {
  const auto sigmaAfterTurn = [](double k1_sigma) {
    Filter filter(withoutNisScaling());
    filter.drive(100, 0.8, 0.01);
    filter.predict(0, 1.5, k1_sigma);
    return filter.sigma();
  };
  EXPECT_LT(sigmaAfterTurn(0.003), 0.6 * sigmaAfterTurn(0.02));
  const auto sigmaAtStart = [](double angle) {
    Filter filter;
    filter.predict(1, angle);
    EXPECT_TRUE(filter.measure(0.8, 0.01));
    return filter.sigma();
  };
  EXPECT_GT(sigmaAtStart(0.15), 2 * sigmaAtStart(0));
}

/// Points on a pavement that is 3 % of the camera height above the lane, and in every tenth frame
/// up to last_direct a direct measurement of the lane.
Filter driveBesideAPavement(int frames, int last_direct) {
  Filter filter(withoutNisScaling());
  for (int i = 0; i < frames; ++i) {
    filter.predict(0.5, 0);
    const bool is_beside_lane = true;
    filter.update(0.97 * 0.8, 0.01, kRoadDistance, ScaleFilter::Source::kFeatureBased,
                  is_beside_lane);
    if (i % 10 != 9 || i > last_direct) continue;
    EXPECT_TRUE(filter.measure(0.8, 0.01, ScaleFilter::Source::kDirect));
  }
  return filter;
}

// With points beside the lane alone, the height is uncertain.
TEST(ScaleFilter, DirectMeasurementsGiveTheHeightOfTheGroundBesideTheLane) {
  EXPECT_NEAR(driveBesideAPavement(200, 200).height(), 0.8, 0.005 * 0.8);
  // For a while without direct measurements, the height that they have given is used.
  EXPECT_NEAR(driveBesideAPavement(210, 200).height(), 0.8, 0.01 * 0.8);
  const Filter beside = driveBesideAPavement(200, 0);
  EXPECT_NEAR(beside.height(), 0.97 * 0.8, 0.005 * 0.8);
  EXPECT_GT(beside.sigma(), 0.015 * 0.8);
  Filter lane(withoutNisScaling());
  lane.drive(200, 0.8, 0.01);
  EXPECT_LT(lane.sigma(), 0.8 * beside.sigma());
}

// A direct measurement at a wrong peak repeats the state.
TEST(ScaleFilter, DirectMeasurementsAtAWrongPeakDoNotPreventARestart) {
  for (const double wrong : {0.4, 1.6}) {
    Filter filter;
    filter.drive(20, wrong, 0.01, ScaleFilter::Source::kDirect);
    ASSERT_NEAR(filter.height(), wrong, 0.01);
    for (int i = 0; i < 40; ++i) {
      filter.drive(1, 0.8, 0.01);
      filter.measure(filter.height(), 0.01, ScaleFilter::Source::kDirect);
    }
    EXPECT_NEAR(filter.height(), 0.8, 0.01);
  }
}

TEST(ScaleFilter, BiasedPointsDoNotRestartWhileDirectMeasurementsAgree) {
  Filter filter;
  for (int i = 0; i < 200; ++i) {
    filter.drive(1, i < 50 ? 0.8 : 0.72, 0.001);
    filter.measure(0.8, 0.001, ScaleFilter::Source::kDirect);
  }
  EXPECT_NEAR(filter.height(), 0.8, 0.01);
}

// Measurement errors larger or smaller than modelled change sigma, by a factor that the gate
// limits; the gain does not depend on them.
TEST(ScaleFilter, RejectedSpeedsBetweenAcceptedOnesDoNotRestart) {
  Filter filter = convergedFilter();
  const double scale = filter.scale();
  for (int i = 0; i < 200; ++i) {
    filter.predict(0.5, 0);
    filter.updateSpeed(i % 2 == 0 ? scale : 1.15 * scale, 0.01);
    ASSERT_NEAR(filter.scale(), scale, 0.02 * scale) << i;
  }
}

TEST(ScaleFilter, SigmaContainsTheFactorOfTheSpeeds) {
  ScaleFilter filter({}, {0, 0, 0.03});
  filter.predict(1, 0, 0.02);
  ASSERT_TRUE(filter.updateSpeed(2, 0.01));
  EXPECT_NEAR(filter.scaleSigma() / filter.scale(), std::hypot(0.03, 0.01), 1e-3);
}

TEST(ScaleFilter, SigmaIsScaledByTheNis) {
  // Ratio of the variances, for an error of ln h. A measurement has a standard deviation of 0.015.
  const auto ratio = [](double error) {
    Filter filter, reference(withoutNisScaling());
    for (int i = 0; i < 1000; ++i) {
      const double height = 0.8 * std::exp(i % 2 == 0 ? error : -error);
      filter.drive(1, height, 0);
      reference.drive(1, height, 0);
    }
    EXPECT_EQ(filter.height(), reference.height());
    return std::pow(filter.sigma() / reference.sigma(), 2);
  };
  EXPECT_GT(ratio(0), 0.01);
  EXPECT_LT(ratio(0), 0.2);
  EXPECT_NEAR(ratio(0.03) / ratio(0.01), 9, 2);  // 9 without the limits
  EXPECT_GT(ratio(1), 3);
  EXPECT_LT(ratio(1), 10);
  // What the camera height contributes is not: the measurements contain nothing of it.
  ScaleFilter filter({}, {1.65, 0.05, 0});
  for (int i = 0; i < 1000; ++i) {
    filter.predict(1, 0, 0.02);
    filter.update(0.8, 0, kRoadDistance, ScaleFilter::Source::kFeatureBased);
  }
  EXPECT_GT(filter.scaleSigma() / filter.scale(), 0.05 / 1.65);
}

}  // namespace
}  // namespace gsv
