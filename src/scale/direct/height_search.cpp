#include "scale/direct/height_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo::direct {
namespace {

constexpr double kStep = 0.05;  ///< of ln h between samples
/// [rad] Step and range (in standard deviations of the prior) of the roll between hypotheses: half
/// a step changes the height at the border of the lane by 3 %.
constexpr double kRollStep = 0.06, kRollRange = 3;
/// [ln h] Samples this close to the maximum belong to its peak and are no second one.
constexpr double kPeakHalfWidth = 0.26;
/// Required correlation over the longer baseline as a share of that over the shorter one: farther
/// apart, patches differ more in resolution and occlusion.
constexpr double kLongBaselineShare = 0.75;
/// Only every second patch is used; the position of the peak needs no more.
constexpr std::size_t kPatchStride = 2;

}  // namespace

double medianFeatureHeight(const VoFrame& frame, const LaneRegion& lane, const NormalPrior& prior) {
  std::vector<double> heights;
  for (const TrackedFeature& feature : frame.features) {
    if (!hasUsablePoint(feature)) continue;
    if (!lane.contains(frame.camera.ray(feature.u.cast<double>()))) continue;
    const double height = -prior.n_c.dot(feature.p_c.cast<double>());
    if (height > 0) heights.push_back(height);
  }
  return heights.empty() ? 0 : median(&heights);
}

/// Mean correlation of the patches under the plane m, weighted by texture; -1 when too few patches
/// project into the reference image.
double HeightSearch::meanCorrelation(const std::vector<Patch>& patches, const Reference& reference,
                                     const PatchMatcher& matcher, const Eigen::Vector3f& m) const {
  double sum = 0, weights = 0, all_weights = 0;
  int inside = 0;
  Samples values;
  for (std::size_t i = 0; i < patches.size(); i += kPatchStride) {
    const Patch& patch = patches[i];
    if (patch.masked) continue;
    all_weights += patch.texture;
    if (!matcher.sample(reference, patch, m, &values)) continue;
    sum += patch.texture * correlate(patch, matcher.imageNoise(), &values);
    weights += patch.texture;
    ++inside;
  }
  const bool enough = static_cast<int>(kPatchStride) * inside >= options_.min_patches &&
                      weights > 0.5 * all_weights;
  return enough ? sum / weights : -1;
}

/// Correlation over the height; sample i belongs to centre * exp(kStep * (i - half)).
std::vector<double> HeightSearch::scores(const std::vector<Patch>& patches,
                                         const Reference& reference, const PatchMatcher& matcher,
                                         const Eigen::Vector3d& n_c, double centre) const {
  const int half = halfRange();
  std::vector<double> score;
  score.reserve(static_cast<std::size_t>(2 * half + 1));
  for (int i = -half; i <= half; ++i) {
    const double height = centre * std::exp(kStep * i);
    score.push_back(meanCorrelation(patches, reference, matcher, (n_c / height).cast<float>()));
  }
  return score;
}

int HeightSearch::halfRange() const {
  return static_cast<int>(std::ceil(std::log(options_.search_range) / kStep));
}

/// The normal within the roll range of the prior whose best plane correlates best.
Eigen::Vector3d HeightSearch::bestNormal(const std::vector<Patch>& patches,
                                         const Reference& reference, const PatchMatcher& matcher,
                                         const NormalPrior& prior, double centre) const {
  const int steps = static_cast<int>(kRollRange * prior.roll_sigma / kRollStep);
  if (steps == 0) return prior.n_c;
  Eigen::Vector3d best = prior.n_c;
  double best_score = -1;
  for (int k = -steps; k <= steps; ++k) {
    const Eigen::Vector3d n_c = Eigen::AngleAxisd(kRollStep * k, prior.forward_c) * prior.n_c;
    const std::vector<double> score = scores(patches, reference, matcher, n_c, centre);
    const double peak = *std::max_element(score.begin(), score.end());
    if (peak > best_score) {
      best_score = peak;
      best = n_c;
    }
  }
  return best;
}

std::optional<GroundPlane> HeightSearch::find(const std::vector<Patch>& patches,
                                              const std::vector<Reference>& references,
                                              const PatchMatcher& matcher, const NormalPrior& prior,
                                              double centre) const {
  if (references.size() < kReferences) return std::nullopt;
  const Eigen::Vector3d n_c = bestNormal(patches, references.front(), matcher, prior, centre);
  std::array<double, kReferences> found{};
  for (std::size_t k = 0; k < kReferences; ++k) {
    const std::vector<double> score = scores(patches, references[k], matcher, n_c, centre);
    const auto peak = std::max_element(score.begin(), score.end());
    double second_peak = -1;
    for (auto other = score.begin(); other != score.end(); ++other) {
      if (std::abs(static_cast<double>(other - peak)) * kStep > kPeakHalfWidth) {
        second_peak = std::max(second_peak, *other);
      }
    }
    const double min_correlation = k == 0 ? options_.search_min_correlation
                                          : kLongBaselineShare * options_.search_min_correlation;
    if (*peak < min_correlation || *peak - second_peak < options_.search_min_peak_margin) {
      return std::nullopt;
    }
    found[k] = centre * std::exp(kStep * static_cast<double>(peak - score.begin() - halfRange()));
  }
  const bool agree = std::abs(std::log(found[0] / found[1])) < options_.search_max_disagreement;
  if (!agree) return std::nullopt;
  return GroundPlane{n_c, found[1]};
}

}  // namespace ground_scale_vo::direct
