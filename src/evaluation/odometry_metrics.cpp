#include "ground_scale_vo/evaluation/odometry_metrics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;
using Lengths = std::array<double, 8>;

constexpr Lengths kDevkitLengths{100, 200, 300, 400, 500, 600, 700, 800};
constexpr Lengths kShortLengths{10, 20, 30, 40, 50, 60, 70, 80};
constexpr std::size_t kFramesBetweenStarts = 10;
constexpr double kMinMotion = 0.3;  // [m] the direction of a shorter motion is mostly noise

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

/// The devkit's segments: relative pose errors over their length, averaged for each length.
std::vector<OdometryMetrics::LengthError> segmentErrors(const Poses& ground_truth,
                                                        const Poses& estimate,
                                                        const Lengths& lengths) {
  const std::vector<double> travelled = distancesTravelled(ground_truth);
  std::vector<OdometryMetrics::LengthError> errors;
  for (const double length : lengths) {
    OdometryMetrics::LengthError sum;
    sum.length_m = length;
    for (std::size_t first = 0; first < ground_truth.size(); first += kFramesBetweenStarts) {
      const auto end = std::upper_bound(travelled.begin() + static_cast<std::ptrdiff_t>(first),
                                        travelled.end(), travelled[first] + length);
      if (end == travelled.end()) break;
      const auto last = static_cast<std::size_t>(end - travelled.begin());
      const Eigen::Isometry3d error = (estimate[first].inverse() * estimate[last]).inverse() *
                                      (ground_truth[first].inverse() * ground_truth[last]);
      ++sum.segments;
      sum.t_err_percent += 100.0 * error.translation().norm() / length;
      sum.r_err_deg_per_m += kDegreesPerRadian * Eigen::AngleAxisd(error.linear()).angle() / length;
    }
    if (sum.segments == 0) continue;
    sum.t_err_percent /= sum.segments;
    sum.r_err_deg_per_m /= sum.segments;
    errors.push_back(sum);
  }
  return errors;
}

/// The mean over all segments of all lengths.
std::optional<double> meanOverSegments(const std::vector<OdometryMetrics::LengthError>& errors,
                                       double OdometryMetrics::LengthError::*member) {
  double sum = 0;
  int segments = 0;
  for (const auto& error : errors) {
    sum += error.segments * (error.*member);
    segments += error.segments;
  }
  return segments > 0 ? std::make_optional(sum / segments) : std::nullopt;
}

std::optional<double> translationError(const Poses& ground_truth, const Poses& estimate) {
  return meanOverSegments(segmentErrors(ground_truth, estimate, kDevkitLengths),
                          &OdometryMetrics::LengthError::t_err_percent);
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

std::optional<double> medianDirectionError(const Poses& ground_truth, const Poses& estimate) {
  std::vector<double> angles;
  for (std::size_t i = 1; i < ground_truth.size(); ++i) {
    const Eigen::Vector3d t = (ground_truth[i - 1].inverse() * ground_truth[i]).translation();
    const Eigen::Vector3d e = (estimate[i - 1].inverse() * estimate[i]).translation();
    if (t.norm() <= kMinMotion || e.norm() == 0.0) continue;
    angles.push_back(kDegreesPerRadian * std::atan2(t.cross(e).norm(), t.dot(e)));
  }
  return angles.empty() ? std::nullopt : std::make_optional(quantile(angles, 0.5));
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
  return translationError(ground_truth, scaled);
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
  using Error = OdometryMetrics::LengthError;
  metrics.by_length = segmentErrors(reference, poses, kDevkitLengths);
  metrics.by_short_length = segmentErrors(reference, poses, kShortLengths);
  metrics.t_err_percent = meanOverSegments(metrics.by_length, &Error::t_err_percent);
  metrics.r_err_deg_per_m = meanOverSegments(metrics.by_length, &Error::r_err_deg_per_m);
  metrics.t_err_short_percent = meanOverSegments(metrics.by_short_length, &Error::t_err_percent);
  metrics.t_err_true_length_percent =
      translationError(reference, withTrueLengths(reference, poses));
  metrics.t_err_sim3_percent = translationErrorAfterSimilarity(reference, poses);
  metrics.direction_median_deg = medianDirectionError(reference, poses);
  metrics.ate_rmse_m = absoluteError(reference, poses);
  return metrics;
}

std::optional<double> largestRotationDifferenceDeg(const Poses& first, const Poses& second,
                                                   std::size_t frames) {
  if (first.size() != second.size() || frames == 0) {
    throw OptionError("rotations over " + std::to_string(frames) + " frames of " +
                      std::to_string(first.size()) + " and " + std::to_string(second.size()) +
                      " poses cannot be compared");
  }
  const Poses a = orthonormalised(first, "first");
  const Poses b = orthonormalised(second, "second");
  std::optional<double> largest;
  for (std::size_t i = 0; i + frames < a.size(); ++i) {
    const Eigen::Matrix3d turn_a = a[i].linear().transpose() * a[i + frames].linear();
    const Eigen::Matrix3d turn_b = b[i].linear().transpose() * b[i + frames].linear();
    const Eigen::AngleAxisd between(turn_a.transpose() * turn_b);
    largest = std::max(largest.value_or(0), kDegreesPerRadian * between.angle());
  }
  return largest;
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

}  // namespace ground_scale_vo
