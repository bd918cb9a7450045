#include "ground_scale_vo/simulation/fault_evaluation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

namespace ground_scale_vo {
namespace {

/// Metrics that violate no threshold.
FaultDriveMetrics goodMetrics() {
  FaultDriveMetrics metrics;
  metrics.frames = 100;
  FaultMetrics fault;
  fault.name = "black";
  fault.hides_ground = true;
  fault.duration_s = 4;
  fault.detection_delay_s = 0.1;
  fault.position_error_m = 20;
  fault.sigma_m = 15;
  metrics.faults = {fault};
  metrics.segments = {{10, 40, 30, 2}};
  return metrics;
}

TEST(FaultEvaluation, DetectsEveryViolatedThreshold) {
  EXPECT_EQ(violatedThreshold(goodMetrics()), "");
  using Metrics = FaultDriveMetrics;
  const std::vector<std::function<void(Metrics&)>> kChanges = {
      [](Metrics& f) { f.non_finite_frames = 1; },
      [](Metrics& f) { f.segments[0].error_percent = 5.1; },
      [](Metrics& f) { f.segments[0].error_percent = NAN; },
      [](Metrics& f) { f.segments.clear(); },
      [](Metrics& f) { f.faults[0].detection_delay_s = 3.1; },
      [](Metrics& f) { f.faults[0].detection_delay_s = NAN; },
      [](Metrics& f) { f.faults[0].ok_frames = 1; },
      [](Metrics& f) { f.faults[0].metric_recovery_frames = -1; },
      [](Metrics& f) { f.faults[0].excess_path_m = 3; },
      [](Metrics& f) { f.faults[0].sigma_m = 1; }};
  for (std::size_t i = 0; i < kChanges.size(); ++i) {
    FaultDriveMetrics metrics = goodMetrics();
    kChanges[i](metrics);
    EXPECT_NE(violatedThreshold(metrics), "") << "change " << i;
  }
}

TEST(FaultEvaluation, DetectsNonFiniteOutputs) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  VisualOdometry::Output vo;
  vo.frame.features.resize(2);
  EXPECT_TRUE(isFinite(vo));
  vo.frame.features[1].p_c.x() = static_cast<float>(kNan);
  EXPECT_TRUE(isFinite(vo)) << "the feature has no point";
  vo.frame.features[1].has_point = true;
  EXPECT_FALSE(isFinite(vo));
  vo.frame.features.clear();
  vo.frame.T_w_c.translation().x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(isFinite(vo));

  ScaleRecovery::Output scale;
  scale.pose = MetricPose();
  EXPECT_TRUE(isFinite(scale));
  scale.pose->covariance(2, 3) = kNan;
  EXPECT_FALSE(isFinite(scale));
  scale.pose->covariance.setIdentity();
  scale.pose->covariance(1, 1) = -1e-3;
  EXPECT_FALSE(isFinite(scale));
  scale.pose.reset();
  scale.scale.sigma = kNan;
  EXPECT_FALSE(isFinite(scale));
}

}  // namespace
}  // namespace ground_scale_vo
