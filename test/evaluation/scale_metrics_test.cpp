#include "ground_scale_vo/evaluation/metrics.hpp"
#include "scripted_run.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

/// Output of the scale stage in one frame. raw: scale of the single frame; 0: not measured.
struct Measurement {
  ScaleStatus status = ScaleStatus::kOk;
  double scale = 2, sigma = 0.1, raw = 0, height = 0;
  std::uint32_t map_id = 0;
};

/// Record of a camera that moves 0.5 VO units a frame. With metreAFrame() as ground truth, its true
/// scale is 2 m per unit.
RunRecord record(const std::vector<Measurement>& measurements) {
  RunRecord result;
  for (const Measurement& m : measurements) {
    const auto i = static_cast<double>(result.frames().size());
    ScaleEstimate scale;
    scale.status = m.status;
    const bool is_known = m.status != ScaleStatus::kUnknown;
    if (is_known) {
      scale.scale = m.scale;
      scale.sigma = m.sigma;
      scale.raw_scale = m.raw;
      scale.height = m.height;
    }
    const Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();
    appendFrame(&result, ahead(0.5 * i), is_known ? std::optional(origin) : std::nullopt,
                Matrix6d::Zero(), scale, m.map_id);
  }
  return result;
}

Poses metreAFrame(std::size_t n) {
  Poses poses;
  for (std::size_t i = 0; i < n; ++i) poses.push_back(ahead(static_cast<double>(i)));
  return poses;
}

constexpr ScaleStatus kUnknown = ScaleStatus::kUnknown, kOk = ScaleStatus::kOk,
                      kHeld = ScaleStatus::kHeld;

TEST(ScaleMetrics, CountsErrorsWithinSigma) {
  const RunRecord run = record({{kUnknown},
                                {kOk, 2.00, 0.10},
                                {kOk, 2.19, 0.10},
                                {kOk, 2.21, 0.10},
                                {kHeld, 1.82, 0.10},
                                {kHeld, 1.78, 0.10}});
  const ScaleMetrics m = computeScaleMetrics(run, metreAFrame(6), 2);
  EXPECT_DOUBLE_EQ(m.within_2_sigma, 3.0 / 5);
  EXPECT_DOUBLE_EQ(m.held_share, 2.0 / 5);       // from the first metric pose on
  EXPECT_NEAR(m.error_median_percent, 0, 1e-9);  // [%] 0, 9.5, 10.5, -9, -11
  EXPECT_NEAR(m.error_abs_median_percent, 9.5, 1e-9);
  EXPECT_TRUE(std::isnan(m.height_bias_percent));
}

TEST(ScaleMetrics, FirstErrorIsSignedAndOfTheFirstScale) {
  for (const auto& [scale, error] : {std::pair(2.3, 1.5), {1.8, -1.0}}) {
    const RunRecord run = record({{kUnknown}, {kHeld, scale, 0.2}, {kOk, 2.5, 0.1}});
    EXPECT_NEAR(computeScaleMetrics(run, metreAFrame(3), 2).first_error_sigmas, error, 1e-9);
  }
}

// Each map has its own unit, so a distance over two maps gives no true scale.
TEST(ScaleMetrics, TrueScaleIsThatOfOneMap) {
  std::vector<Measurement> measurements(8, Measurement{kOk, 2.0, 0.01});
  for (std::size_t i = 4; i < 8; ++i) measurements[i].map_id = 1;
  Poses ground_truth = metreAFrame(8);
  for (std::size_t i = 4; i < 8; ++i) ground_truth[i] = ahead(50 + static_cast<double>(i));
  EXPECT_DOUBLE_EQ(computeScaleMetrics(record(measurements), ground_truth, 2).within_2_sigma, 1);
}

TEST(ScaleMetrics, HeightBiasUsesTheTrueScale) {
  const RunRecord run =
      record({{kOk, 9, 0.1, 0, 0.80}, {kOk, 9, 0.1, 0, 0.81}, {kOk, 9, 0.1, 0, 0.85}});
  const ScaleMetrics m = computeScaleMetrics(run, metreAFrame(3), 2, {1.6, 1.6, 1.6});
  EXPECT_NEAR(m.height_bias_percent, 1.25, 1e-9);
  const ScaleMetrics other = computeScaleMetrics(run, metreAFrame(3), 2, {1.6, 1.62, 1.7});
  EXPECT_NEAR(other.height_bias_percent, 0, 1e-9);
}

TEST(ScaleMetrics, MissingValuesAreNan) {
  const RunRecord without_scale = record({{kUnknown}, {kUnknown}, {kUnknown}});
  ScaleMetrics m = computeScaleMetrics(without_scale, metreAFrame(3), 2);
  EXPECT_TRUE(std::isnan(m.within_2_sigma));
  EXPECT_TRUE(std::isnan(m.held_share));
  // The camera does not move, so no frame has a true scale.
  m = computeScaleMetrics(record({{}, {}, {kHeld}}), Poses(3, ahead(0)), 2, {1.6, 1.6, 1.6});
  EXPECT_TRUE(std::isnan(m.within_2_sigma));
  EXPECT_TRUE(std::isnan(m.error_median_percent));
  EXPECT_TRUE(std::isnan(m.height_bias_percent));
  EXPECT_DOUBLE_EQ(m.held_share, 1.0 / 3);
  EXPECT_THROW(computeScaleMetrics(without_scale, metreAFrame(2), 2), OptionError);
  EXPECT_THROW(computeScaleMetrics(without_scale, metreAFrame(3), 2, {1.6}), OptionError);
}

}  // namespace
}  // namespace gsv
