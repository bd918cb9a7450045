#include "ground_scale_vo/calibration/height_calibration.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "correlated_mean.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "interpolated_track.hpp"

namespace ground_scale_vo {
namespace {

/// Correlation length of the scale's error [camera heights]: errors are taken as equal over this
/// distance and as independent beyond. At 1.65 m that of MetricTrajectory (scale_correlation_m).
constexpr double kScaleCorrelation = 6;
/// Spacing of the polyline along which the path is measured [camera heights]: shorter steps would
/// add the noise of the positions.
constexpr double kPolylineStep = 0.5;
/// Minimum number of sections for an estimate of the mounting.
constexpr std::size_t kMinMountingSections = 3;

double distance(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (b.translation() - a.translation()).norm();
}

/// Scale of the least-squares similarity from `from` to `to`, of equal size.
double similarityScale(const std::vector<Eigen::Vector3d>& from,
                       const std::vector<Eigen::Vector3d>& to) {
  Eigen::Matrix3Xd from_columns(3, from.size()), to_columns(3, to.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_columns.col(static_cast<Eigen::Index>(i)) = from[i];
    to_columns.col(static_cast<Eigen::Index>(i)) = to[i];
  }
  const Eigen::Matrix4d similarity = Eigen::umeyama(from_columns, to_columns, true);
  return similarity.topLeftCorner<3, 1>().norm();
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
  return text;
}

bool hasMetricPose(const RunFrame& frame) { return frame.has_metric_pose; }

/// Why the path from the first frame to the last is not known completely. Empty when the first
/// frame has an odometry pose, and all frames from the first metric pose on have metric poses in
/// the first frame's map. Precondition: a frame has a metric pose.
std::string gapInPath(const std::vector<RunFrame>& frames) {
  if (!frames.front().has_vo_pose) {
    const auto first =
        std::find_if(frames.begin(), frames.end(), [](const RunFrame& f) { return f.has_vo_pose; });
    return "the distance travelled before frame " + std::to_string(first - frames.begin()) +
           ", where the odometry started, is not known";
  }
  const auto measured = std::find_if(frames.begin(), frames.end(), hasMetricPose);
  const auto gap = std::find_if(measured, frames.end(), [&](const RunFrame& f) {
    return !f.has_metric_pose || f.map_id != frames.front().map_id;
  });
  if (gap == frames.end()) return {};
  return "the odometry was lost at or before frame " + std::to_string(gap - frames.begin()) +
         " of " + std::to_string(frames.size()) +
         ", so the length of the whole drive cannot be compared";
}

/// Length of the metric path [camera heights], and its standard deviation from the reported sigma
/// of the scale (see kScaleCorrelation). Precondition: gapInPath() returns an empty string.
struct PathLength {
  double length = 0, sigma = 0;
};
PathLength measurePath(const std::vector<RunFrame>& frames, double nominal_height) {
  double length = 0, variance = 0, section = 0, section_error = 0;
  const ScaleEstimate& first = std::find_if(frames.begin(), frames.end(), hasMetricPose)->scale;
  double sigma = first.sigma / first.scale;
  const auto closeSection = [&] {
    variance += section_error * section_error;
    section = section_error = 0;
  };
  Eigen::Isometry3d corner = frames.front().T_o_c;
  for (const RunFrame& frame : frames) {
    if (frame.has_metric_pose) sigma = frame.scale.sigma / frame.scale.scale;
    const double step = distance(corner, frame.T_o_c) / nominal_height;
    if (step < kPolylineStep && &frame != &frames.back()) continue;
    corner = frame.T_o_c;
    length += step;
    section += step;
    section_error += step * sigma;
    if (section >= kScaleCorrelation) closeSection();
  }
  closeSection();
  return {length, std::sqrt(variance)};
}

}  // namespace

void HeightCalibration::Options::validate() const {
  requireInRange("segment_length_heights", segment_length_heights, 1, 1000);
  requireInRange("segment_position_sigmas", segment_position_sigmas, 0, 1e6);
  requireInRange("outlier_sigma", outlier_sigma, 1, 100);
  requireInRange("min_segments", min_segments, 3, 1000);
  requireInRange("max_error", max_error, 1e-4, 1);
  requireInRange("method_sigma", method_sigma, 0, 1);
}

HeightCalibration::HeightCalibration(const Options& options) : options_(options) {
  options_.validate();
}

HeightCalibration::Result HeightCalibration::fromLength(const RunRecord& record,
                                                        double nominal_height, double length_m,
                                                        double length_sigma_m) const {
  if (!(length_m > 0)) throw OptionError("the length of the drive must be positive");
  if (!(length_sigma_m >= 0)) throw OptionError("the sigma of the length must not be negative");
  const std::vector<RunFrame>& frames = record.frames();
  Result result;
  if (std::none_of(frames.begin(), frames.end(), hasMetricPose)) {
    result.reason = "no frame got a scale";
    return result;
  }
  result.status = Status::kBroken;
  result.reason = gapInPath(frames);
  if (!result.reason.empty()) return result;
  const PathLength path = measurePath(frames, nominal_height);
  if (!(path.length > 0)) {
    result.reason = "the camera did not move according to the odometry";
    return result;
  }
  result.height.value = length_m / path.length;
  const double relative = std::hypot(path.sigma / path.length, length_sigma_m / length_m);
  result.height.sigma = result.height.value * std::hypot(relative, options_.method_sigma);
  measureMounting(record, nominal_height, &result);
  judge(&result);
  return result;
}

HeightCalibration::Result HeightCalibration::fromPositions(
    const RunRecord& record, double nominal_height, const std::vector<StampedPosition>& positions,
    double position_sigma_m) const {
  if (!(position_sigma_m >= 0)) throw OptionError("the sigma of a position must not be negative");
  for (std::size_t i = 1; i < positions.size(); ++i) {
    if (positions[i].stamp_ns <= positions[i - 1].stamp_ns) {
      throw OptionError("the stamps of the positions do not increase");
    }
  }
  Result result;
  const std::vector<RunFrame>& frames = record.frames();
  if (std::none_of(frames.begin(), frames.end(), hasMetricPose)) {
    result.reason = "no frame got a scale";
    return result;
  }
  cutSegments(frames, nominal_height, positions, position_sigma_m, &result);
  averageSegments(&result);
  if (result.status != Status::kOk) return result;
  measureMounting(record, nominal_height, &result);
  judge(&result);
  return result;
}

void HeightCalibration::cutSegments(const std::vector<RunFrame>& frames, double nominal_height,
                                    const std::vector<StampedPosition>& positions,
                                    double position_sigma_m, Result* result) const {
  const InterpolatedTrack track(frames);
  std::vector<Eigen::Vector3d> estimated, known;  // of the segment under way
  InterpolatedTrack::Position start;
  std::int64_t start_ns = 0;
  for (const StampedPosition& position : positions) {
    const auto camera = track.at(position.stamp_ns);
    if (!camera || (!estimated.empty() && !track.isUnbroken(start.frame, camera->frame))) {
      estimated.clear();
      known.clear();
    }
    if (!camera) continue;
    if (estimated.empty()) {
      start = *camera;
      start_ns = position.stamp_ns;
    }
    estimated.push_back(camera->p);
    known.push_back(position.p);
    Segment segment;
    segment.length_heights = (camera->p - start.p).norm() / nominal_height;
    const double known_length = (position.p - known.front()).norm();
    if (segment.length_heights < options_.segment_length_heights || estimated.size() < 3 ||
        known_length < options_.segment_position_sigmas * position_sigma_m) {
      continue;
    }
    if (track.isMeasured(start.frame, camera->frame)) {
      segment.from_ns = start_ns;
      segment.to_ns = position.stamp_ns;
      segment.height = nominal_height * similarityScale(estimated, known);
      result->segments.push_back(segment);
    }
    // The next segment begins where this one ends.
    estimated.assign(1, camera->p);
    known.assign(1, position.p);
    start = *camera;
    start_ns = position.stamp_ns;
  }
}

void HeightCalibration::averageSegments(Result* result) const {
  std::vector<double> heights, deviations, used, weights;
  for (const Segment& segment : result->segments) heights.push_back(segment.height);
  if (!heights.empty()) {
    const double center = median(heights);
    for (const double height : heights) deviations.push_back(std::abs(height - center));
    const double sigma = std::max(kMadToSigma * median(deviations), options_.method_sigma * center);
    for (Segment& segment : result->segments) {
      segment.used = std::abs(segment.height - center) <= options_.outlier_sigma * sigma;
      if (!segment.used) continue;
      used.push_back(segment.height);
      weights.push_back(segment.length_heights);
    }
  }
  if (used.size() < static_cast<std::size_t>(options_.min_segments)) {
    result->status = Status::kTooFew;
    result->reason = std::to_string(used.size()) + " segments of the drive can be compared, " +
                     std::to_string(options_.min_segments) +
                     " are needed: it is too short, or tracking or positions have too many gaps";
    return;
  }
  result->status = Status::kOk;
  result->height = correlatedMean(used, weights);
  result->height.sigma =
      std::hypot(result->height.sigma, options_.method_sigma * result->height.value);
}

void HeightCalibration::measureMounting(const RunRecord& record, double nominal_height,
                                        Result* result) const {
  // Means over sections of segment_length_heights: pitch and roll of the vehicle average out.
  std::vector<double> pitches, rolls, weights;
  double pitch = 0, roll = 0, length = 0;
  int planes = 0;
  Eigen::Isometry3d last = Eigen::Isometry3d::Identity();
  bool has_last = false;
  for (const RunFrame& frame : record.frames()) {
    if (frame.has_metric_pose && has_last) length += distance(last, frame.T_o_c) / nominal_height;
    has_last = frame.has_metric_pose;
    last = frame.T_o_c;
    if (frame.scale.status == ScaleStatus::kOk) {
      const Eigen::Vector3d& n = frame.scale.n_c;
      pitch += std::atan2(-n.z(), -n.y());
      roll += -std::asin(std::clamp(n.x(), -1.0, 1.0));
      ++planes;
    }
    if (length < options_.segment_length_heights) continue;
    if (planes > 0) {
      pitches.push_back(pitch / planes);
      rolls.push_back(roll / planes);
      weights.push_back(planes);
    }
    pitch = roll = length = 0;
    planes = 0;
  }
  if (pitches.size() < kMinMountingSections) return;
  result->pitch = correlatedMean(pitches, weights);
  result->roll = correlatedMean(rolls, weights);
}

void HeightCalibration::judge(Result* result) const {
  result->status = Status::kOk;
  const double error = result->height.error95() / result->height.value;
  if (error > options_.max_error) {
    char height[32];
    std::snprintf(height, sizeof height, "%.2f m", result->height.value);
    result->status = Status::kTooUncertain;
    result->reason = "the height would be " + std::string(height) + ", but uncertain by " +
                     percent(error) + " (95 %), more than " + percent(options_.max_error) +
                     ": drive farther, or measure the length better";
  }
}

}  // namespace ground_scale_vo
