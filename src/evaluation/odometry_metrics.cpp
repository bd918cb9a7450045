#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace gsv {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;
using Lengths = std::array<double, 8>;

constexpr Lengths kDevkitLengths{100, 200, 300, 400, 500, 600, 700, 800};
constexpr Lengths kShortLengths{10, 20, 30, 40, 50, 60, 70, 80};
constexpr std::size_t kFramesBetweenStarts = 10;

Poses orthonormalised(const Poses& poses, const char* name) {
  Poses result = poses;
  for (std::size_t i = 0; i < result.size(); ++i) {
    if (!isFinite(result[i]) || !isPlausiblePosition(result[i].translation())) {
      throw OptionError(std::string(name) + " pose " + std::to_string(i) +
                        " is not finite or implausibly far away");
    }
    result[i].linear() = nearestRotation(result[i].linear());
  }
  return result;
}

/// Errors of relative poses over their length: the mean over the devkit's segments of all lengths.
struct SegmentErrors {
  std::optional<double> t_err_percent, r_err_deg_per_m;  ///< empty without a segment
};
SegmentErrors segmentErrors(const Poses& ground_truth, const Poses& estimate,
                            const Lengths& lengths) {
  const std::vector<double> travelled = distancesTravelled(ground_truth);
  double segments = 0, translation = 0, rotation = 0;
  for (const double length : lengths) {
    for (std::size_t first = 0; first < ground_truth.size(); first += kFramesBetweenStarts) {
      const auto end = std::upper_bound(travelled.begin() + static_cast<std::ptrdiff_t>(first),
                                        travelled.end(), travelled[first] + length);
      if (end == travelled.end()) break;
      const auto last = static_cast<std::size_t>(end - travelled.begin());
      const Eigen::Isometry3d error = (estimate[first].inverse() * estimate[last]).inverse() *
                                      (ground_truth[first].inverse() * ground_truth[last]);
      ++segments;
      translation += 100.0 * error.translation().norm() / length;
      rotation += kDegreesPerRadian * Eigen::AngleAxisd(error.linear()).angle() / length;
    }
  }
  if (segments == 0) return {};
  return {translation / segments, rotation / segments};
}

Poses withTrueLengths(const Poses& ground_truth, const Poses& estimate) {
  Poses result = estimate;
  for (std::size_t i = 1; i < estimate.size(); ++i) {
    const Eigen::Vector3d step = estimate[i].translation() - estimate[i - 1].translation();
    const double length =
        (ground_truth[i].translation() - ground_truth[i - 1].translation()).norm();
    result[i].translation() = result[i - 1].translation() + length * step.normalized();
  }
  return result;
}

Eigen::Matrix3Xd positions(const Poses& poses) {
  Eigen::Matrix3Xd result(3, static_cast<Eigen::Index>(poses.size()));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    result.col(static_cast<Eigen::Index>(i)) = poses[i].translation();
  }
  return result;
}

/// Only the scale of the similarity matters: rotation and translation cancel in relative poses.
std::optional<double> translationErrorAfterSimilarity(const Poses& ground_truth,
                                                      const Poses& estimate) {
  if (pathLength(estimate) == 0.0) return std::nullopt;
  const Eigen::Matrix4d S = Eigen::umeyama(positions(estimate), positions(ground_truth), true);
  const double scale = S.col(0).head<3>().norm();
  Poses scaled = estimate;
  for (Eigen::Isometry3d& pose : scaled) pose.translation() *= scale;
  return segmentErrors(ground_truth, scaled, kDevkitLengths).t_err_percent;
}

double absoluteError(const Poses& ground_truth, const Poses& estimate) {
  const Eigen::Matrix3Xd from = positions(estimate);
  const Eigen::Matrix3Xd to = positions(ground_truth);
  const Eigen::Isometry3d T(Eigen::umeyama(from, to, false));
  return std::sqrt((T * from.colwise().homogeneous() - to).colwise().squaredNorm().mean());
}

}  // namespace

OdometryMetrics computeOdometryMetrics(const Poses& ground_truth, const Poses& estimate) {
  if (ground_truth.size() != estimate.size() || ground_truth.size() < 2) {
    throw OptionError("metrics need two or more poses and the same number of both, not " +
                      std::to_string(ground_truth.size()) + " ground truth and " +
                      std::to_string(estimate.size()) + " estimated");
  }
  const Poses reference = orthonormalised(ground_truth, "ground truth");
  const Poses poses = orthonormalised(estimate, "estimated");

  OdometryMetrics metrics;
  metrics.length_m = pathLength(poses);
  metrics.gt_length_m = pathLength(reference);
  if (metrics.gt_length_m > 0) {
    metrics.rle_percent =
        100.0 * std::abs(metrics.gt_length_m - metrics.length_m) / metrics.gt_length_m;
  }
  const SegmentErrors errors = segmentErrors(reference, poses, kDevkitLengths);
  metrics.t_err_percent = errors.t_err_percent;
  metrics.r_err_deg_per_m = errors.r_err_deg_per_m;
  metrics.t_err_short_percent = segmentErrors(reference, poses, kShortLengths).t_err_percent;
  metrics.t_err_true_length_percent =
      segmentErrors(reference, withTrueLengths(reference, poses), kDevkitLengths).t_err_percent;
  metrics.t_err_sim3_percent = translationErrorAfterSimilarity(reference, poses);
  metrics.ate_rmse_m = absoluteError(reference, poses);
  return metrics;
}

std::vector<double> distancesTravelled(const Poses& poses) {
  std::vector<double> travelled(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    travelled[i] = travelled[i - 1] + (poses[i].translation() - poses[i - 1].translation()).norm();
  }
  return travelled;
}

double pathLength(const Poses& poses) {
  return poses.empty() ? 0.0 : distancesTravelled(poses).back();
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  const double position = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(position);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (position - static_cast<double>(below)) * (values[above] - values[below]);
}

}  // namespace gsv
