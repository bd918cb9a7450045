#include "ground_scale_vo/lens/lens_estimator.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "common/text.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "lens/lens_solver.hpp"

namespace gsv {
namespace {

/// Cells of the image, for Result::field and the selection of tracks.
constexpr int kFieldColumns = 16, kFieldRows = 6;
/// Standard deviations of the distortion of a calibration.
constexpr double kPriorK1Sigma = 0.05, kPriorK2Sigma = 0.03;
constexpr double kKeyframeFlow = 0.02;  ///< [image widths] median flow between two keyframes
/// Numbers of keyframes that are adjusted together; longer drives are divided.
constexpr std::size_t kMinSegment = 5, kMaxSegment = 100;
constexpr double kMaxErrorPx = 2;  ///< observations with larger residuals are outliers
/// Residuals with the calibration, relative to those with the estimate, that contradict it: those
/// of published calibrations are at most 1.5 times as large.
constexpr double kContradictingRatio = 3;
constexpr std::size_t kMinKeyframes = 10, kMinTracks = 100;
/// [degrees] Range of what is said to be missing.
constexpr double kMinMissing = 10, kMaxMissing = 90;
/// Iterations with the lens fixed, in each round between rejections of outliers, and with the lens
/// of the prior. Poses and points of the odometry are a good start, so that more change the
/// estimate by less than 0.1 standard deviations.
constexpr int kFixedIterations = 1, kRoundIterations = 3, kRounds = 2, kPriorIterations = 2;
/// A track has parallax when its inverse depth times the length of the segment exceeds this.
constexpr double kMinParallax = 0.02;

/// Tracks in keyframes first to last - 1, numbered from first on, in pieces of at most
/// kMaxTrackKeyframes.
template <typename Keyframes>
std::vector<LensTrack> tracksOf(const Keyframes& keyframes, std::size_t first, std::size_t last,
                                std::size_t min_observations) {
  struct Feature {
    std::uint64_t id;
    LensObservation observation;
  };
  std::vector<Feature> features;
  for (std::size_t k = first; k < last; ++k) {
    for (const auto& [id, u] : keyframes[k].features) features.push_back({id, {k - first, u}});
  }
  std::stable_sort(features.begin(), features.end(),
                   [](const Feature& a, const Feature& b) { return a.id < b.id; });
  std::vector<LensTrack> result;
  for (auto begin = features.begin(), end = begin; begin != features.end(); begin = end) {
    const auto belongs = [&](const Feature& feature) {
      return feature.id == begin->id &&
             feature.observation.keyframe < begin->observation.keyframe + kMaxTrackKeyframes;
    };
    end = std::find_if_not(begin, features.end(), belongs);
    if (end - begin < static_cast<std::ptrdiff_t>(min_observations)) continue;
    result.emplace_back();
    for (auto it = begin; it != end; ++it) result.back().observations.push_back(it->observation);
  }
  return result;
}

std::size_t cellOf(const PinholeCamera& camera, const Eigen::Vector2d& u) {
  const auto index = [](double at, int size, int cells) {
    return std::clamp(static_cast<int>(at / size * cells), 0, cells - 1);
  };
  return static_cast<std::size_t>(index(u.y(), camera.height, kFieldRows) * kFieldColumns +
                                  index(u.x(), camera.width, kFieldColumns));
}

/// Keeps tracks that cover each keyframe evenly: in the order of their length in the image, those
/// of which at least half of the observations lie in cells with fewer than max_per_cell.
void selectTracks(const PinholeCamera& camera, std::size_t keyframes, int max_per_cell,
                  std::vector<LensTrack>* tracks) {
  const auto length = [](const LensTrack& track) {
    return (track.observations.back().u - track.observations.front().u).squaredNorm();
  };
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t i = 0; i < tracks->size(); ++i) order.emplace_back(-length((*tracks)[i]), i);
  std::sort(order.begin(), order.end());
  std::vector<int> counts(keyframes * kFieldRows * kFieldColumns);
  std::vector<LensTrack> selected;
  std::vector<std::size_t> cells;
  for (const auto& [key, i] : order) {
    cells.clear();
    std::size_t open = 0;
    for (const LensObservation& o : (*tracks)[i].observations) {
      cells.push_back(o.keyframe * kFieldRows * kFieldColumns + cellOf(camera, o.u));
      open += counts[cells.back()] < max_per_cell;
    }
    if (2 * open < cells.size()) continue;
    for (const std::size_t cell : cells) ++counts[cell];
    selected.push_back(std::move((*tracks)[i]));
  }
  *tracks = std::move(selected);
}

/// Sums the residuals by cell; `sum` is FieldCell::before or after.
double addResiduals(const LensSolver& solver, Eigen::Vector2d LensEstimator::FieldCell::*sum,
                    std::vector<LensEstimator::FieldCell>* field) {
  const PinholeCamera& camera = solver.lens().camera;
  double squares = 0;
  std::size_t n = 0;
  for (LensEstimator::FieldCell& cell : *field) cell.observations = 0;
  for (const LensSegment& segment : solver.segments()) {
    for (const LensResidual& residual : segment.residuals(solver.lens())) {
      LensEstimator::FieldCell& target = (*field)[cellOf(camera, residual.u)];
      target.*sum += residual.error;
      ++target.observations;
      squares += residual.error.squaredNorm();
      ++n;
    }
  }
  for (LensEstimator::FieldCell& cell : *field) cell.*sum /= std::max(1, cell.observations);
  return n > 0 ? std::sqrt(squares / static_cast<double>(n)) : 0;
}

std::vector<LensEstimator::FieldCell> emptyField(const PinholeCamera& camera) {
  std::vector<LensEstimator::FieldCell> field;
  for (int row = 0; row < kFieldRows; ++row) {
    for (int column = 0; column < kFieldColumns; ++column) {
      LensEstimator::FieldCell cell;
      cell.centre = {(column + 0.5) * camera.width / kFieldColumns - 0.5,
                     (row + 0.5) * camera.height / kFieldRows - 0.5};
      field.push_back(cell);
    }
  }
  return field;
}

/// Result::contradiction.
std::string contradictionOf(const LensEstimator::Result& result, const LensEstimate& estimate,
                            const LensEstimate& prior) {
  std::string how = estimate.contradiction(prior);
  if (how.empty() &&
      result.rms_before_px > std::max(kMaxErrorPx, kContradictingRatio * result.rms_after_px)) {
    how = format("the residuals are %.1f px with it, and %.1f px with another lens",
                 result.rms_before_px, result.rms_after_px);
  }
  if (how.empty()) return {};
  return "the motion contradicts the calibration: " + how +
         "; is it of these images? Without one, `ground_scale_vo run --fov DEG` estimates the lens";
}

}  // namespace

LensEstimator::LensEstimator(const Options& options) : options_(options) {
  requireInRanges(options_);
}

LensEstimate LensEstimator::priorOf(const Lens& calibration) const {
  LensVector sigmas;
  sigmas << options_.prior_focal_sigma, options_.prior_centre_sigma_px,
      options_.prior_centre_sigma_px, kPriorK1Sigma, kPriorK2Sigma;
  return {calibration, sigmas.cwiseAbs2().asDiagonal()};
}

double LensEstimator::flow(const Keyframe& a, const Keyframe& b) {
  std::vector<double> lengths;
  auto other = a.features.begin();
  for (const auto& [id, u] : b.features) {
    while (other != a.features.end() && other->first < id) ++other;
    if (other == a.features.end()) break;
    if (other->first == id) lengths.push_back((u - other->second).norm());
  }
  return lengths.empty() ? std::numeric_limits<double>::infinity() : median(&lengths);
}

VoFrame withDistortedFeatures(VoFrame frame, const Lens& lens) {
  for (TrackedFeature& feature : frame.features) {
    const Eigen::Vector2d x = lens.camera.ray(feature.u.cast<double>()).head<2>();
    feature.u = lens.project(x).cast<float>();
  }
  return frame;
}

void LensEstimator::add(const VoFrame& frame) {
  if (frame.status != VoStatus::kTracking) {
    interrupted_ = true;
    return;
  }
  if (interrupted_ || frame.continuity >= Continuity::kNewMapSameUnit) ++run_;
  interrupted_ = false;
  Keyframe keyframe{run_, frame.T_w_c, {}};
  for (const TrackedFeature& feature : frame.features) {
    keyframe.features.emplace_back(feature.id, feature.u.cast<double>());
  }
  const bool is_first = keyframes_.empty() || keyframes_.back().run != run_;
  const double min_flow = kKeyframeFlow * frame.camera.width;
  if (is_first || flow(keyframes_.back(), keyframe) >= min_flow) {
    keyframes_.push_back(std::move(keyframe));
  }
}

std::vector<LensSegment> LensEstimator::segments(const Lens& lens, const TrackNoise& noise) const {
  std::vector<LensSegment> result;
  for (std::size_t begin = 0, end = 0; begin < keyframes_.size(); begin = end) {
    while (end < keyframes_.size() && keyframes_[end].run == keyframes_[begin].run) ++end;
    const std::size_t pieces = (end - begin + kMaxSegment - 1) / kMaxSegment;
    for (std::size_t i = 0; i < pieces; ++i) {
      const std::size_t first = begin + (end - begin) * i / pieces;
      const std::size_t last = begin + (end - begin) * (i + 1) / pieces;
      std::vector<Eigen::Isometry3d> T_w_c;
      double length = 0;
      for (std::size_t k = first; k < last; ++k) {
        T_w_c.push_back(keyframes_[k].T_w_c);
        length =
            std::max(length, (T_w_c.back().translation() - T_w_c.front().translation()).norm());
      }
      if (last - first < kMinSegment || !(length > 0)) continue;
      std::vector<LensTrack> tracks =
          tracksOf(keyframes_, first, last, static_cast<std::size_t>(options_.min_observations));
      selectTracks(lens.camera, last - first, options_.tracks_per_cell, &tracks);
      result.emplace_back(T_w_c, std::move(tracks), lens, noise);
    }
  }
  return result;
}

LensEstimator::Result LensEstimator::estimate(const LensEstimate& prior,
                                              const Lens& initial) const {
  Result result;
  result.estimate = prior;
  const TrackNoise noise;
  LensSolver solver(segments(initial, noise), prior, initial, noise);
  const auto min_observations = static_cast<std::size_t>(options_.min_observations);
  if (!count(solver.segments(), &result)) return result;
  solver.rejectOutliers(std::numeric_limits<double>::infinity(), min_observations);
  solver.optimise(false, kFixedIterations);
  for (int round = 0; round < kRounds; ++round) {
    solver.optimise(true, kRoundIterations);
    solver.rejectOutliers(kMaxErrorPx, min_observations);
    if (!count(solver.segments(), &result)) return result;
  }
  const LensEstimate estimate = solver.combineWithPrior();
  result.model_error_px = solver.fieldSigma();
  judge(solver, estimate, &result);

  result.field = emptyField(prior.lens.camera);
  result.rms_after_px = addResiduals(solver, &FieldCell::after, &result.field);
  solver.setLens(prior.lens);
  solver.optimise(false, kPriorIterations);
  result.rms_before_px = addResiduals(solver, &FieldCell::before, &result.field);
  result.contradiction = contradictionOf(result, estimate, prior);
  if (!(result.rms_after_px < kMaxErrorPx)) {
    result.estimate = prior;
    result.status = Status::kDiverged;
    result.reason = format(
        "the adjustment diverges, with residuals of %.1f px and then %.1f px: the start is too far "
        "from the lens",
        result.rms_before_px, result.rms_after_px);
  }
  return result;
}

/// Counts keyframes and tracks; false, with status and reason, when they are too few.
bool LensEstimator::count(const std::vector<LensSegment>& segments, Result* result) const {
  result->keyframes = result->tracks = 0;
  std::size_t with_parallax = 0;
  for (const LensSegment& segment : segments) {
    result->keyframes += segment.keyframes();
    for (const LensTrack& track : segment.tracks()) {
      result->tracks += track.used;
      with_parallax += track.used && track.point.z() > kMinParallax;
    }
  }
  const bool only_rotates = segments.empty() && keyframes_.size() >= kMinKeyframes;
  if (!only_rotates && (result->keyframes < kMinKeyframes || result->tracks < kMinTracks)) {
    result->status = Status::kTooFew;
    result->reason = "the drive has " + std::to_string(result->keyframes) + " keyframes with " +
                     std::to_string(result->tracks) + " tracks, fewer than " +
                     std::to_string(kMinKeyframes) + " or " + std::to_string(kMinTracks);
    return false;
  }
  if (with_parallax < kMinTracks) {
    result->status = Status::kUnobservable;
    result->reason = "the camera hardly moves: " + std::to_string(with_parallax) +
                     " tracks have parallax, fewer than " + std::to_string(kMinTracks);
    return false;
  }
  return true;
}

void LensEstimator::judge(const LensSolver& solver, const LensEstimate& estimate,
                          Result* result) const {
  const double sigma_px = std::sqrt(solver.information().inverse()(1, 1));
  const double limit_px = options_.max_centre_sigma * estimate.lens.camera.fx;
  if (!(sigma_px <= limit_px)) {
    result->status = Status::kUnobservable;
    double turned = 0;  // [rad]
    for (const LensSegment& segment : solver.segments()) turned += segment.turned();
    // The standard deviation falls with the angle.
    const double missing = turned * (sigma_px / limit_px - 1);
    result->reason = format(
        "the drive turns by %.0f degrees and determines the principal point to %.0f px only, %.0f "
        "are needed: drive with turns of about %.0f degrees more",
        turned / kRadiansPerDegree, sigma_px, limit_px,
        std::clamp(missing / kRadiansPerDegree, kMinMissing, kMaxMissing));
    return;
  }
  result->status = Status::kOk;
  result->reason.clear();
  result->estimate = estimate;
}

const char* toString(LensEstimator::Status status) {
  switch (status) {
    case LensEstimator::Status::kOk:
      return "ok";
    case LensEstimator::Status::kTooFew:
      return "too few";
    case LensEstimator::Status::kUnobservable:
      return "unobservable";
    case LensEstimator::Status::kDiverged:
      return "diverged";
  }
  return "invalid";
}

}  // namespace gsv
