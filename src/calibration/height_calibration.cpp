#include "ground_scale_vo/calibration/height_calibration.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace {

using Estimate = HeightCalibration::Estimate;

/// Way over which the error of the scale agrees with itself [camera heights].
constexpr double kScaleMemory = 6;
/// Corners of the polyline whose length is the way [camera heights]: what is nearer is noise.
constexpr double kStep = 0.5;
/// At least this share of a segment's moving frames must have measured the scale.
constexpr double kMinMeasured = 0.5;
/// Fewer stretches of road tell no mounting.
constexpr std::size_t kMinStretches = 3;

double wayBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (b.translation() - a.translation()).norm();
}

/// Two-sided 95 % of Student's t: Cornish-Fisher about the normal's, within 5 % from 3 on.
double studentFactor(double freedom) {
  constexpr double z = 1.959964;
  const double z3 = z * z * z, z5 = z3 * z * z;
  return z + (z3 + z) / (4 * freedom) + (5 * z5 + 16 * z3 + 3 * z) / (96 * freedom * freedom);
}

/// Weighted mean of values in the order of the way. Errors that last longer than one value are
/// found by the correlation with the next ones, as far as it is positive, and widen the error.
Estimate meanOf(const std::vector<double>& values, const std::vector<double>& weights) {
  const std::size_t n = values.size();
  double sum = 0, weight = 0;
  for (std::size_t i = 0; i < n; ++i) {
    sum += weights[i] * values[i];
    weight += weights[i];
  }
  Estimate mean;
  mean.value = sum / weight;
  const auto residual = [&](std::size_t i) {
    return weights[i] / weight * (values[i] - mean.value);
  };
  const auto product = [&](std::size_t lag) {
    double products = 0;
    for (std::size_t i = lag; i < n; ++i) products += residual(i) * residual(i - lag);
    return products;
  };
  double variance = product(0);
  for (std::size_t lag = 1; lag <= n / 3; ++lag) {
    const double shared = product(lag);
    if (shared <= 0) break;
    variance += 2 * shared;
  }
  const double freedom = static_cast<double>(n - 1);
  mean.sigma = std::sqrt(variance * static_cast<double>(n) / freedom);
  mean.factor95 = studentFactor(freedom);
  return mean;
}

/// The camera at a stamp, between two frames of one map with a metric pose; and how the scale was
/// known on the way there, counted from the record's start.
class Track {
 public:
  explicit Track(const std::vector<RunFrame>& frames) : frames_(frames) {
    measured_.push_back(0);
    moving_.push_back(0);
    for (const RunFrame& frame : frames) {
      const bool moves = frame.scale.reason != ScaleReason::kStandstill;
      measured_.push_back(measured_.back() + (frame.scale.status == ScaleStatus::kOk ? 1 : 0));
      moving_.push_back(moving_.back() + (moves ? 1 : 0));
    }
  }

  struct Place {
    std::size_t frame = 0;  ///< at or before the stamp
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
  };

  std::optional<Place> at(std::int64_t stamp_ns) const {
    const auto next =
        std::upper_bound(frames_.begin(), frames_.end(), stamp_ns,
                         [](std::int64_t stamp, const RunFrame& f) { return stamp < f.stamp_ns; });
    if (next == frames_.begin()) return {};
    const auto last = next - 1;
    Place place;
    place.frame = static_cast<std::size_t>(last - frames_.begin());
    if (!last->has_metric_pose) return {};
    place.p = last->T_o_c.translation();
    if (last->stamp_ns == stamp_ns) return place;
    if (next == frames_.end() || !next->has_metric_pose || next->map_id != last->map_id) return {};
    const double share = static_cast<double>(stamp_ns - last->stamp_ns) /
                         static_cast<double>(next->stamp_ns - last->stamp_ns);
    place.p += share * (next->T_o_c.translation() - place.p);
    return place;
  }

  /// All frames from a to b have a metric pose in one map.
  bool isWhole(std::size_t a, std::size_t b) const {
    for (std::size_t i = a; i <= b; ++i) {
      if (!frames_[i].has_metric_pose || frames_[i].map_id != frames_[a].map_id) return false;
    }
    return true;
  }

  bool isMeasured(std::size_t a, std::size_t b) const {
    return measured_[b + 1] - measured_[a] >= kMinMeasured * (moving_[b + 1] - moving_[a]);
  }

 private:
  const std::vector<RunFrame>& frames_;
  std::vector<int> measured_, moving_;  ///< frames before this one
};

/// Metres of truth over metres of the odometry.
double similarityScale(const std::vector<Eigen::Vector3d>& estimated,
                       const std::vector<Eigen::Vector3d>& truth) {
  Eigen::Matrix3Xd from(3, estimated.size()), to(3, truth.size());
  for (std::size_t i = 0; i < estimated.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = estimated[i];
    to.col(static_cast<Eigen::Index>(i)) = truth[i];
  }
  const Eigen::Matrix4d similarity = Eigen::umeyama(from, to, true);
  return similarity.topLeftCorner<3, 1>().norm();
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
  return text;
}

}  // namespace

std::vector<TruePosition> readTruePositions(const std::filesystem::path& file,
                                            const std::vector<std::int64_t>& stamps_ns) {
  const TextFile text(file);
  std::size_t first = 0;
  while (first + 1 < text.size() && text.line(first).rfind('#', 0) == 0) ++first;
  std::vector<TruePosition> positions;
  if (text.wordCount(first) == 12) {
    const std::vector<Eigen::Isometry3d> poses = readKittiPoses(file);
    if (poses.size() != stamps_ns.size()) {
      throw DataError(file.string() + ": has " + std::to_string(poses.size()) +
                      " poses without stamps for " + std::to_string(stamps_ns.size()) + " images");
    }
    for (std::size_t i = 0; i < poses.size(); ++i) {
      positions.push_back({stamps_ns[i], poses[i].translation()});
    }
  } else {
    for (const StampedPose& pose : readTumTrajectory(file)) {
      if (!positions.empty() && pose.stamp_ns <= positions.back().stamp_ns) {
        throw DataError(file.string() + ": its stamps do not grow at " +
                        formatSeconds(pose.stamp_ns));
      }
      positions.push_back({pose.stamp_ns, pose.T_a_b.translation()});
    }
  }
  return positions;
}

std::vector<Eigen::Vector3d> eastNorthUp(const std::vector<Eigen::Vector3d>& fixes) {
  constexpr double kRadius = 6378137.0, kEccentricity2 = 6.69437999014e-3;  // WGS84
  constexpr double kRad = 3.14159265358979323846 / 180;
  const auto fromEarthCentre = [](const Eigen::Vector3d& fix) {
    const double lat = kRad * fix.x(), lon = kRad * fix.y();
    const double n = kRadius / std::sqrt(1 - kEccentricity2 * std::sin(lat) * std::sin(lat));
    return Eigen::Vector3d((n + fix.z()) * std::cos(lat) * std::cos(lon),
                           (n + fix.z()) * std::cos(lat) * std::sin(lon),
                           (n * (1 - kEccentricity2) + fix.z()) * std::sin(lat));
  };
  std::vector<Eigen::Vector3d> positions;
  if (fixes.empty()) return positions;
  const double lat = kRad * fixes.front().x(), lon = kRad * fixes.front().y();
  Eigen::Matrix3d axes;
  axes << -std::sin(lon), std::cos(lon), 0,  //
      -std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat),
      std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
  const Eigen::Vector3d origin = fromEarthCentre(fixes.front());
  for (const Eigen::Vector3d& fix : fixes) {
    positions.push_back(axes * (fromEarthCentre(fix) - origin));
  }
  return positions;
}

void HeightCalibration::Options::validate() const {
  requireInRange("segment_h", segment_h, 1, 1000);
  requireInRange("segment_position_sigmas", segment_position_sigmas, 0, 1e6);
  requireInRange("outlier_sigma", outlier_sigma, 1, 100);
  requireInRange("min_segments", min_segments, 3, 1000);
  requireInRange("max_error", max_error, 1e-4, 1);
  requireInRange("method_sigma", method_sigma, 0, 1);
}

HeightCalibration::HeightCalibration(const Options& options) : options_(options) {
  options_.validate();
}

const char* toString(HeightCalibration::Status status) {
  switch (status) {
    case HeightCalibration::Status::kOk:
      return "ok";
    case HeightCalibration::Status::kNoScale:
      return "no_scale";
    case HeightCalibration::Status::kBroken:
      return "broken";
    case HeightCalibration::Status::kTooFew:
      return "too_few";
    case HeightCalibration::Status::kTooUncertain:
      return "too_uncertain";
  }
  return "";
}

HeightCalibration::Result HeightCalibration::fromLength(const RunRecord& record,
                                                        double nominal_height, double length_m,
                                                        double length_sigma_m) const {
  if (!(length_m > 0)) throw OptionError("the length of the drive must be positive");
  if (!(length_sigma_m >= 0)) throw OptionError("the sigma of the length must not be negative");
  const std::vector<RunFrame>& frames = record.frames();
  Result result;
  const auto measured = std::find_if(frames.begin(), frames.end(),
                                     [](const RunFrame& f) { return f.has_metric_pose; });
  if (measured == frames.end()) {
    result.reason = "no frame got a scale";
    return result;
  }
  // The way is whole when one map holds every frame from the first image on.
  result.status = Status::kBroken;
  if (!frames.front().has_vo_pose) {
    const auto first =
        std::find_if(frames.begin(), frames.end(), [](const RunFrame& f) { return f.has_vo_pose; });
    result.reason = "the way before frame " + std::to_string(first - frames.begin()) +
                    ", where the odometry started, is not known";
    return result;
  }
  const auto gap = std::find_if(measured, frames.end(), [&](const RunFrame& f) {
    return !f.has_metric_pose || f.map_id != frames.front().map_id;
  });
  if (gap != frames.end()) {
    result.reason = "the odometry was lost at frame " + std::to_string(gap - frames.begin()) +
                    " of " + std::to_string(frames.size()) +
                    ", so the length of the whole drive cannot be compared";
    return result;
  }

  // The scale's error is one number over a way of kScaleMemory, and another one after that.
  double way = 0, variance = 0, piece = 0, piece_error = 0;
  double sigma = measured->scale.sigma / measured->scale.scale;
  const auto closePiece = [&] {
    variance += piece_error * piece_error;
    piece = piece_error = 0;
  };
  Eigen::Isometry3d corner = frames.front().T_o_c;
  for (const RunFrame& frame : frames) {
    if (frame.has_metric_pose) sigma = frame.scale.sigma / frame.scale.scale;
    const double step = wayBetween(corner, frame.T_o_c) / nominal_height;
    if (step < kStep && &frame != &frames.back()) continue;
    corner = frame.T_o_c;
    way += step;
    piece += step;
    piece_error += step * sigma;
    if (piece >= kScaleMemory) closePiece();
  }
  closePiece();
  result.way_h = way;
  if (!(way > 0)) {
    result.reason = "the odometry says that the vehicle stood";
    return result;
  }
  result.height.value = length_m / way;
  const double relative = std::hypot(std::sqrt(variance) / way, length_sigma_m / length_m);
  result.height.sigma = result.height.value * std::hypot(relative, options_.method_sigma);
  measureMounting(record, nominal_height, &result);
  conclude(&result);
  return result;
}

HeightCalibration::Result HeightCalibration::fromPositions(const RunRecord& record,
                                                           double nominal_height,
                                                           const std::vector<TruePosition>& truth,
                                                           double position_sigma_m) const {
  if (!(position_sigma_m >= 0)) throw OptionError("the sigma of a position must not be negative");
  for (std::size_t i = 1; i < truth.size(); ++i) {
    if (truth[i].stamp_ns <= truth[i - 1].stamp_ns) {
      throw OptionError("the stamps of the true positions do not grow");
    }
  }
  Result result;
  const std::vector<RunFrame>& frames = record.frames();
  if (std::none_of(frames.begin(), frames.end(),
                   [](const RunFrame& frame) { return frame.has_metric_pose; })) {
    result.reason = "no frame got a scale";
    return result;
  }

  const Track track(frames);
  std::vector<Eigen::Vector3d> estimated, known;
  Track::Place start;
  std::int64_t start_ns = 0;
  for (const TruePosition& position : truth) {
    const std::optional<Track::Place> place = track.at(position.stamp_ns);
    if (!place || (!estimated.empty() && !track.isWhole(start.frame, place->frame))) {
      estimated.clear();
      known.clear();
    }
    if (!place) continue;
    if (estimated.empty()) {
      start = *place;
      start_ns = position.stamp_ns;
    }
    estimated.push_back(place->p);
    known.push_back(position.p);
    Segment segment;
    segment.way_h = (place->p - start.p).norm() / nominal_height;
    const double true_way = (position.p - known.front()).norm();
    if (segment.way_h < options_.segment_h || estimated.size() < 3 ||
        true_way < options_.segment_position_sigmas * position_sigma_m) {
      continue;
    }
    if (track.isMeasured(start.frame, place->frame)) {
      segment.from_ns = start_ns;
      segment.to_ns = position.stamp_ns;
      segment.height = nominal_height * similarityScale(estimated, known);
      result.segments.push_back(segment);
    }
    // The next one begins where this one ends.
    estimated.assign(1, place->p);
    known.assign(1, position.p);
    start = *place;
    start_ns = position.stamp_ns;
  }

  std::vector<double> heights, distances, used, weights;
  for (const Segment& segment : result.segments) heights.push_back(segment.height);
  if (!heights.empty()) {
    const double middle = median(heights);
    for (const double height : heights) distances.push_back(std::abs(height - middle));
    const double spread = std::max(kSigmaOfMad * median(distances), options_.method_sigma * middle);
    for (Segment& segment : result.segments) {
      segment.used = std::abs(segment.height - middle) <= options_.outlier_sigma * spread;
      if (!segment.used) continue;
      used.push_back(segment.height);
      weights.push_back(segment.way_h);
      result.way_h += segment.way_h;
    }
  }
  if (used.size() < static_cast<std::size_t>(options_.min_segments)) {
    result.status = Status::kTooFew;
    result.reason = std::to_string(used.size()) + " segments of the drive can be compared, " +
                    std::to_string(options_.min_segments) +
                    " are needed: it is too short, or tracked or positioned too seldom";
    return result;
  }
  result.height = meanOf(used, weights);
  result.height.sigma =
      std::hypot(result.height.sigma, options_.method_sigma * result.height.value);
  measureMounting(record, nominal_height, &result);
  conclude(&result);
  return result;
}

void HeightCalibration::measureMounting(const RunRecord& record, double nominal_height,
                                        Result* result) const {
  // Means over stretches as long as a segment; the vehicle nods and leans about them.
  std::vector<double> pitches, rolls, weights;
  double pitch = 0, roll = 0, way = 0;
  int planes = 0;
  Eigen::Isometry3d last = Eigen::Isometry3d::Identity();
  bool has_last = false;
  for (const RunFrame& frame : record.frames()) {
    if (frame.has_metric_pose && has_last) way += wayBetween(last, frame.T_o_c) / nominal_height;
    has_last = frame.has_metric_pose;
    last = frame.T_o_c;
    if (frame.scale.status == ScaleStatus::kOk) {
      const Eigen::Vector3d& n = frame.scale.n_c;
      pitch += std::atan2(-n.z(), -n.y());
      roll += -std::asin(std::clamp(n.x(), -1.0, 1.0));
      ++planes;
    }
    if (way < options_.segment_h) continue;
    if (planes > 0) {
      pitches.push_back(pitch / planes);
      rolls.push_back(roll / planes);
      weights.push_back(planes);
    }
    pitch = roll = way = 0;
    planes = 0;
  }
  if (pitches.size() < kMinStretches) return;
  result->pitch = meanOf(pitches, weights);
  result->roll = meanOf(rolls, weights);
}

void HeightCalibration::conclude(Result* result) const {
  result->status = Status::kOk;
  const double error = result->height.error95() / result->height.value;
  if (error > options_.max_error) {
    char height[32];
    std::snprintf(height, sizeof height, "%.2f m", result->height.value);
    result->status = Status::kTooUncertain;
    result->reason = "the height would be " + std::string(height) + ", but uncertain by " +
                     percent(error) + " (95 %), more than " + percent(options_.max_error) +
                     ": drive farther, or know the length better";
  }
}

}  // namespace ground_scale_vo
