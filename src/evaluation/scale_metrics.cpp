#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"

namespace gsv {
namespace {

/// Maximum number of frames from a frame to either end of the segment that gives its true scale.
constexpr std::size_t kMaxReach = 25;

/// True scale around frame i [m per VO unit]; empty when the camera hardly moves or has no pose.
std::optional<double> trueScale(const std::vector<RunFrame>& frames,
                                const std::vector<Eigen::Isometry3d>& ground_truth,
                                double distance_m, std::size_t i) {
  const auto usable = [&](std::size_t k) {
    return frames[k].has_vo_pose && frames[k].map_id == frames[i].map_id;
  };
  if (!usable(i)) return {};
  std::size_t a = i, b = i;
  for (std::size_t reach = 1; reach <= kMaxReach; ++reach) {
    if (i >= reach && usable(i - reach)) a = i - reach;
    if (i + reach < frames.size() && usable(i + reach)) b = i + reach;
    const double distance = (ground_truth[b].translation() - ground_truth[a].translation()).norm();
    const double estimate = (frames[b].T_w_c.translation() - frames[a].T_w_c.translation()).norm();
    if (distance >= distance_m && estimate > 0) return distance / estimate;
  }
  return {};
}

/// part / whole; NaN if whole is 0.
double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? std::numeric_limits<double>::quiet_NaN()
                    : static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

ScaleMetrics computeScaleMetrics(const RunRecord& record,
                                 const std::vector<Eigen::Isometry3d>& ground_truth,
                                 double distance_m,
                                 const std::vector<double>& ground_truth_heights) {
  const std::vector<RunFrame>& frames = record.frames();
  if (ground_truth.size() != frames.size() ||
      (!ground_truth_heights.empty() && ground_truth_heights.size() != frames.size())) {
    throw OptionError("the run has " + std::to_string(frames.size()) +
                      " frames, the ground truth " + std::to_string(ground_truth.size()) +
                      " poses and " + std::to_string(ground_truth_heights.size()) + " heights");
  }
  if (!(distance_m > 0)) throw OptionError("the distance for a true scale must be positive");

  ScaleMetrics metrics;
  metrics.first_error_sigmas = std::numeric_limits<double>::quiet_NaN();
  std::size_t within = 0, held = 0, from_first = 0;
  double squares = 0;
  std::vector<double> errors, magnitudes, height_errors;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const ScaleEstimate& scale = frames[i].scale;
    if (from_first > 0 || frames[i].has_metric_pose) {
      ++from_first;
      held += scale.status == ScaleStatus::kHeld;
    }
    if (scale.status == ScaleStatus::kUnknown) continue;
    const std::optional<double> known = trueScale(frames, ground_truth, distance_m, i);
    if (!known) continue;
    if (errors.empty()) metrics.first_error_sigmas = (scale.scale - *known) / scale.sigma;
    errors.push_back(100 * (scale.scale / *known - 1));
    magnitudes.push_back(std::abs(errors.back()));
    within += std::abs(scale.scale - *known) <= 2 * scale.sigma;
    squares += std::pow((scale.scale - *known) / scale.sigma, 2);
    if (!ground_truth_heights.empty()) {
      height_errors.push_back(100 * (scale.height * *known / ground_truth_heights[i] - 1));
    }
  }
  metrics.within_2_sigma = share(within, errors.size());
  metrics.nees = errors.empty() ? std::numeric_limits<double>::quiet_NaN()
                                : squares / static_cast<double>(errors.size());
  metrics.error_median_percent = quantile(errors, 0.5);
  metrics.error_abs_median_percent = quantile(magnitudes, 0.5);
  metrics.held_share = share(held, from_first);
  metrics.height_bias_percent = quantile(height_errors, 0.5);
  return metrics;
}

}  // namespace gsv
