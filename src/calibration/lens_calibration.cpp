#include "ground_scale_vo/calibration/lens_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

/// Prior of a start from a field of view.
constexpr double kRoughFocalSigma = 0.2;
constexpr double kRoughCentreSigma = 0.016;  // [image widths]
constexpr double kRoughK1Sigma = 0.1, kRoughK2Sigma = 0.1;
/// On the largest standard deviation of the principal point, without a calibration: metres need it
/// less well than a camera file does. The lens of the first run is wrong.
constexpr double kRoughFactor = 2, kFirstRunFactor = 3;
constexpr std::size_t kMaxStarts = 3;  ///< that are tried until one leads to a lens
/// Least number of tracks of a start, as a share of that of the start with most: the odometry of a
/// wrong lens is lost, and what it has tracked before fits.
constexpr double kMinTracks = 0.7;
/// Keyframes with which the starts are compared.
constexpr std::size_t kStartKeyframes = 60;

/// Lenses with the field of view of a pinhole, and the radial distortion of dash cams and phones;
/// without those whose distorted radius would decrease within the image.
std::vector<Lens> startsOf(const Lens& pinhole) {
  const double r = 0.5 * pinhole.camera.width / pinhole.camera.fx;  // at the border
  std::vector<Lens> starts;
  for (const double k1 : {0.0, -0.1, -0.2, -0.3, -0.4, 0.1}) {
    if (1 + 3 * k1 * r * r < 0.1) continue;
    starts.push_back(pinhole);
    starts.back().k1 = k1;
    starts.back().camera.fx /= 1 + k1 * r * r;
    starts.back().camera.fy /= 1 + k1 * r * r;
  }
  return starts;
}

/// Least number of observations of an arrow, and its magnification.
constexpr int kMinObservations = 10;
constexpr double kMagnification = 200;

/// The mean of estimates from the same images with different tracks, relative to `origin`. Their
/// scatter adds to the covariance of one of them.
LensEstimate meanOf(const std::vector<LensVector>& lenses, const Lens& origin,
                    const LensMatrix& covariance) {
  LensVector mean = LensVector::Zero();
  const double n = static_cast<double>(lenses.size());
  for (const LensVector& lens : lenses) mean += lens / n;
  LensMatrix scatter = LensMatrix::Zero();
  for (const LensVector& lens : lenses) {
    scatter += (lens - mean) * (lens - mean).transpose() / std::max(1.0, n - 1);
  }
  return {boxplus(origin, mean), covariance + scatter};
}

}  // namespace

void LensCalibration::Options::validate() const {
  requireInRanges(*this);
  requireInRange("max_runs", max_runs, 1, 100);
  requireInRange("min_significance", min_significance, 0, 1e6);
  requireInRange("converged_sigmas", converged_sigmas, 0, 10);
}

LensCalibration::LensCalibration(const Options& options) : options_(options) {
  options_.validate();
}

LensEstimator LensCalibration::track(const RepeatableDrive& drive, const Lens& lens,
                                     const cv::Mat& mask, bool is_first,
                                     std::size_t max_keyframes) const {
  const Undistortion undistortion(calibrationOf(lens), mask);
  VisualOdometry odometry(lens.camera, options_.vo, undistortion.mask());
  LensEstimator::Options options = options_.estimator;
  if (options_.is_rough) options.max_centre_sigma *= is_first ? kFirstRunFactor : kRoughFactor;
  LensEstimator estimator(options);
  drive([&](const cv::Mat& image, std::int64_t stamp_ns) {
    if (estimator.keyframes() >= max_keyframes) return;
    const VoFrame frame = odometry.process(undistortion.image(image).grey, stamp_ns).frame;
    estimator.add(withDistortedFeatures(frame, lens));
  });
  return estimator;
}

LensEstimate LensCalibration::priorOf(const Lens& calibration) const {
  if (!options_.is_rough) return LensEstimator(options_.estimator).priorOf(calibration);
  const double centre_sigma = kRoughCentreSigma * calibration.camera.width;
  LensVector sigmas;
  sigmas << kRoughFocalSigma, centre_sigma, centre_sigma, kRoughK1Sigma, kRoughK2Sigma;
  return {calibration, sigmas.cwiseAbs2().asDiagonal()};
}

std::vector<Lens> LensCalibration::bestStarts(const RepeatableDrive& drive, const Lens& pinhole,
                                              const cv::Mat& mask) const {
  const std::vector<Lens> starts = startsOf(pinhole);
  std::vector<LensEstimator::Result> results;
  std::size_t most_tracks = 0;
  for (const Lens& start : starts) {
    results.push_back(
        track(drive, start, mask, true, kStartKeyframes).estimate(priorOf(start), start));
    most_tracks = std::max(most_tracks, results.back().tracks);
  }
  std::vector<std::pair<double, std::size_t>> order;  // by the residuals
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const LensEstimator::Result& result = results[i];
    const bool is_lost =
        static_cast<double>(result.tracks) < kMinTracks * static_cast<double>(most_tracks);
    const bool is_usable = result.status != LensEstimator::Status::kTooFew && !is_lost;
    order.emplace_back(is_usable ? result.rms_before_px : std::numeric_limits<double>::infinity(),
                       i);
  }
  std::sort(order.begin(), order.end());
  std::vector<Lens> best;
  for (std::size_t i = 0; i < std::min(kMaxStarts, order.size()); ++i) {
    best.push_back(starts[order[i].second]);
  }
  return best;
}

LensCalibration::Result LensCalibration::calibrate(const std::vector<RepeatableDrive>& drives,
                                                   const Lens& given, const cv::Mat& mask) const {
  if (!options_.is_rough) return calibrateFrom(given, drives, mask);
  std::optional<Result> first;
  for (const Lens& start : bestStarts(drives.front(), given, mask)) {
    Result result = calibrateFrom(start, drives, mask);
    if (result.status == LensEstimator::Status::kOk) return result;
    if (!first) first = std::move(result);
  }
  return *first;
}

LensCalibration::Result LensCalibration::calibrateFrom(const Lens& calibration,
                                                       const std::vector<RepeatableDrive>& drives,
                                                       const cv::Mat& mask) const {
  Result result;
  result.prior = result.estimate = priorOf(calibration);
  std::vector<LensVector> lenses;  // of the runs whose mean is the estimate
  const int max_runs = options_.is_rough ? 2 * options_.max_runs : options_.max_runs;
  while (result.runs < max_runs && !result.converged) {
    const Lens previous = result.estimate.lens;
    LensEstimate estimate = result.prior;
    bool observed = false;
    ++result.runs;
    result.drives.clear();
    for (const RepeatableDrive& drive : drives) {
      result.drives.push_back(
          track(drive, previous, mask, result.runs == 1).estimate(estimate, previous));
      if (result.drives.back().status != LensEstimator::Status::kOk) continue;
      estimate = result.drives.back().estimate;
      observed = true;
    }
    if (!observed) {
      result.status = result.drives.front().status;
      result.reason = result.drives.front().reason;
      result.estimate = result.prior;
      return result;
    }
    // The first run had the tracks of another lens.
    if (result.runs == 2) lenses.clear();
    lenses.push_back(boxminus(estimate.lens, calibration));
    result.estimate = meanOf(lenses, calibration, estimate.covariance);
    const LensVector change =
        boxminus(result.estimate.lens, previous).cwiseQuotient(estimate.sigmas());
    result.converged = change.cwiseAbs().maxCoeff() < options_.converged_sigmas;
  }
  result.status = LensEstimator::Status::kOk;
  result.confirmed =
      !options_.is_rough && result.estimate.significance(calibration) < options_.min_significance;
  if (result.confirmed) result.estimate.lens = calibration;
  return result;
}

std::string lensTable(const LensCalibration::Result& result) {
  const Lens& old_lens = result.prior.lens;
  const Lens& lens = result.estimate.lens;
  const LensVector before = result.prior.sigmas(), after = result.estimate.sigmas();
  std::string text = format("%-8s %22s %22s\n", "", "calibration", "estimate");
  const auto add = [&](const char* name, double a, double sigma_a, double b, double sigma_b) {
    text += format("%-8s %11.5g ± %-8.2g %11.5g ± %-8.2g\n", name, a, sigma_a, b, sigma_b);
  };
  add("fx px", old_lens.camera.fx, before[0] * old_lens.camera.fx, lens.camera.fx,
      after[0] * lens.camera.fx);
  add("fy px", old_lens.camera.fy, before[0] * old_lens.camera.fy, lens.camera.fy,
      after[0] * lens.camera.fy);
  add("cx px", old_lens.camera.cx, before[1], lens.camera.cx, after[1]);
  add("cy px", old_lens.camera.cy, before[2], lens.camera.cy, after[2]);
  add("k1", old_lens.k1, before[3], lens.k1, after[3]);
  add("k2", old_lens.k2, before[4], lens.k2, after[4]);
  return text;
}

cv::Mat drawResiduals(const LensEstimator::Result& drive, const PinholeCamera& camera) {
  cv::Mat canvas(2 * camera.height + 1, camera.width, CV_8UC3, cv::Scalar::all(255));
  cv::line(canvas, {0, camera.height}, {camera.width, camera.height}, cv::Scalar::all(128));
  for (int half = 0; half < 2; ++half) {
    const int top = half * (camera.height + 1);
    const double rms = half == 0 ? drive.rms_before_px : drive.rms_after_px;
    cv::putText(canvas,
                format("%s: residual rms %.3f px, mean residuals x %.0f",
                       half == 0 ? "calibration" : "estimate", rms, kMagnification),
                {8, top + 20}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(0), 1, cv::LINE_AA);
    for (const LensEstimator::FieldCell& cell : drive.field) {
      if (cell.observations < kMinObservations) continue;
      const Eigen::Vector2d tip =
          cell.centre + kMagnification * (half == 0 ? cell.before : cell.after);
      const cv::Scalar colour = half == 0 ? cv::Scalar(40, 40, 200) : cv::Scalar(150, 90, 30);
      cv::arrowedLine(canvas, cv::Point2d(cell.centre.x(), top + cell.centre.y()),
                      cv::Point2d(tip.x(), top + tip.y()), colour, 1, cv::LINE_AA, 0, 0.3);
    }
  }
  return canvas;
}

}  // namespace gsv
