#include "ground_scale_vo/lens/lens_refinement.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>

namespace gsv {
namespace {

constexpr double kTurnStep = 0.1;  // [rad]
/// [rad] Rotation before the first estimate, and the growth of it from one estimate to the next.
constexpr double kFirstTurn = 0.5, kTurnGrowth = 2;
constexpr std::size_t kCompareKeyframes = 40;  // of a drive without turns, with the calibration
constexpr std::size_t kMinEstimateKeyframes = 25, kMaxEstimateKeyframes = 800;  // of an estimate
/// Least squared Mahalanobis distance of an estimate from the lens in use.
constexpr double kMinLensSignificance = 25;
/// Estimates from different drives of a camera differ by up to so many of their standard
/// deviations.
constexpr double kEstimatesDiffer = 2;
constexpr int kDelayFrames = 20;  // from the start of an estimate to its use

}  // namespace

LensRefinement::LensRefinement(const Lens& given, const Options& options)
    : options_(options), estimator_(options.estimator), prior_(estimator_.priorOf(given)) {
  if (given.camera.lens_is_estimated) {
    const double k1_sigma = kEstimatesDiffer * given.camera.k1Sigma();
    prior_.covariance(3, 3) = std::min(prior_.covariance(3, 3), k1_sigma * k1_sigma);
  }
  restart();
}

std::optional<LensEstimate> LensRefinement::add(const VoFrame& frame, const Lens& in_use) {
  if (frame.continuity == Continuity::kOtherLens) restart();
  if (frame.continuity >= Continuity::kNewMapSameUnit) R_w_reference_.reset();
  const bool is_full = estimator_.keyframes() > kMaxEstimateKeyframes;
  if (!is_full) estimator_.add(frame);  // else its memory would grow without use
  if (const auto result = finished()) {
    compare(*result);
    if (is_for_use_ && result->status == LensEstimator::Status::kOk &&
        result->estimate.significance(in_use) >= kMinLensSignificance) {
      LensEstimate better = result->estimate;
      better.lens.camera.lens_is_estimated = true;
      better.lens.camera.k1_sigma = better.sigmas()[3];
      return better;
    }
  }
  addTurn(frame);
  if (isDue()) {
    frames_since_start_ = 0;
    pending_ = std::async(std::launch::async, [estimator = estimator_, prior = prior_, in_use] {
      return estimator.estimate(prior, in_use);
    });
  }
  return std::nullopt;
}

const std::string& LensRefinement::finalContradiction(const Lens& in_use) {
  if (pending_.valid()) compare(pending_.get());
  if (contradiction_.empty()) compare(estimator_.estimate(prior_, in_use));
  return contradiction_;
}

void LensRefinement::compare(const LensEstimator::Result& result) {
  if (result.status != LensEstimator::Status::kTooFew) contradiction_ = result.contradiction;
}

void LensRefinement::restart() {
  estimator_ = LensEstimator(options_.estimator);
  turned_ = 0;
  next_turn_ = kFirstTurn;
  R_w_reference_.reset();
}

/// Whether an estimate starts with this frame.
bool LensRefinement::isDue() {
  const std::size_t keyframes = estimator_.keyframes();
  if (pending_.valid() || keyframes > kMaxEstimateKeyframes) return false;
  is_for_use_ = turned_ >= next_turn_ && keyframes >= kMinEstimateKeyframes;
  if (is_for_use_) next_turn_ = turned_ * kTurnGrowth;
  const bool is_due = is_for_use_ || (!is_compared_ && keyframes >= kCompareKeyframes);
  is_compared_ = is_compared_ || is_due;
  return is_due;
}

/// Counts the rotation in steps, so that suspension and noise do not add up.
void LensRefinement::addTurn(const VoFrame& frame) {
  if (frame.status != VoStatus::kTracking) return;
  if (!R_w_reference_) R_w_reference_ = frame.T_w_c.linear();
  const double angle =
      Eigen::AngleAxisd(R_w_reference_->transpose() * frame.T_w_c.linear()).angle();
  if (angle < kTurnStep) return;
  turned_ += angle;
  R_w_reference_ = frame.T_w_c.linear();
}

/// The result of the pending estimate when it is to be used in this frame.
std::optional<LensEstimator::Result> LensRefinement::finished() {
  if (!pending_.valid() || ++frames_since_start_ < kDelayFrames) return std::nullopt;
  const bool is_ready = pending_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  if (!is_ready && !options_.deterministic) return std::nullopt;
  return pending_.get();
}

}  // namespace gsv
