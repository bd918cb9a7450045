#include "ground_scale_vo/simulation/scenario_evaluation.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

using Metrics = ScenarioMetrics;
using Thresholds = ScenarioThresholds;

/// The violated threshold of metrics that violate none before the change.
template <typename Change>
std::string violation(const Change& change) {
  Metrics metrics;
  metrics.frames = metrics.tracked_frames = 100;
  metrics.metric_frames = 90;
  metrics.rle_percent = 0.5;
  metrics.displacement_sigmas = 1;
  metrics.rotation_error_deg = 0.3;
  metrics.within_2_sigma = 0.9;
  Thresholds thresholds;
  change(metrics, thresholds);
  return violatedThreshold(metrics, thresholds);
}

TEST(ScenarioEvaluation, NamesTheViolatedThreshold) {
  EXPECT_EQ(violation([](Metrics&, Thresholds&) {}), "");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.tracked_frames = 99; }), "lost");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.lost_events = 1; }), "lost");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.metric_frames = 50; }), "late scale");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.rotation_error_deg = 2.1; }), "rotation");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.rle_percent = 1.6; }), "RLE");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.rle_percent = NAN; }), "RLE");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.within_2_sigma = 0.7; }), "2 sigma");
  EXPECT_EQ(violation([](Metrics& m, Thresholds&) { m.ok_while_unobservable = 0.1; }),
            "ok while unobservable");
}

TEST(ScenarioEvaluation, MayLoseTrackForSomeFrames) {
  const auto lost = [](std::size_t tracked) {
    return violation([tracked](Metrics& m, Thresholds& t) {
      m.lost_events = 1;
      m.tracked_frames = tracked;
      t.max_untracked_frames = 13;
    });
  };
  EXPECT_EQ(lost(87), "");
  EXPECT_EQ(lost(86), "lost");
}

TEST(ScenarioEvaluation, AcceptsADisplacementWithinItsSigma) {
  const auto gap = [](double sigmas) {
    return violation([sigmas](Metrics& m, Thresholds& t) {
      m.rle_percent = 5;
      m.displacement_sigmas = sigmas;
      t.max_displacement_sigmas = 2;
    });
  };
  EXPECT_EQ(gap(1.9), "");
  EXPECT_EQ(gap(2.1), "RLE");
  EXPECT_EQ(gap(NAN), "RLE");
}

TEST(ScenarioEvaluation, DoubledThresholdsAllowTwiceTheErrorsAndFrames) {
  const auto clear = [](const auto& change) {
    return violation([&](Metrics& m, Thresholds& t) {
      t.max_untracked_frames = 5;
      t.max_displacement_sigmas = 2;
      t.max_ok_while_unobservable = 0.1;
      t = doubled(t);
      change(m);
    });
  };
  EXPECT_EQ(clear([](Metrics& m) { m.tracked_frames = 90; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.tracked_frames = 89; }), "lost");
  EXPECT_EQ(clear([](Metrics& m) { m.metric_frames = 1; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.metric_frames = 0; }), "late scale");
  EXPECT_EQ(clear([](Metrics& m) { m.rotation_error_deg = 3.9; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.rotation_error_deg = 4.1; }), "rotation");
  EXPECT_EQ(clear([](Metrics& m) { m.rle_percent = 2.9, m.displacement_sigmas = 9; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.rle_percent = 9, m.displacement_sigmas = 3.9; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.rle_percent = 3.1, m.displacement_sigmas = 4.1; }), "RLE");
  EXPECT_EQ(clear([](Metrics& m) { m.within_2_sigma = 0.51; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.within_2_sigma = 0.49; }), "2 sigma");
  EXPECT_EQ(clear([](Metrics& m) { m.ok_while_unobservable = 0.19; }), "");
  EXPECT_EQ(clear([](Metrics& m) { m.ok_while_unobservable = 0.21; }), "ok while unobservable");
}

}  // namespace
}  // namespace ground_scale_vo
