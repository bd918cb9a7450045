#include "scale/direct/static_mask.hpp"

#include <cmath>

namespace ground_scale_vo::direct {
namespace {

/// [focal lengths] Minimum image motion of road at the first (upper left) sample of the patch; with
/// less, road looks static too.
constexpr float kMinFlow = 0.004f;
/// Minimum correlation with the same pixels of the reference image (hypothesis: static).
constexpr float kMinCorrelation = 0.8f;
/// Minimum excess of that correlation over the correlation at the position that the plane predicts
/// (hypothesis: road).
constexpr float kMinMargin = 0.1f;
/// Minimum share of the patch's grey-level variance that is not image noise; uniform patches
/// correlate with anything.
constexpr float kMinTextureShare = 0.5f;
/// Cells above this probability are masked.
constexpr float kMaskedProbability = 0.5f;

}  // namespace

StaticMask::StaticMask(const PinholeCamera& camera, const PatchGrid& grid)
    : camera_(camera), grid_(grid), probability_(grid.size(), 0.f) {}

bool StaticMask::contains(std::size_t cell) const {
  return probability_[cell] > kMaskedProbability;
}

void StaticMask::update(const std::vector<Patch>& patches, const Reference& reference,
                        const PatchMatcher& matcher, const Eigen::Vector3f& m, bool is_aligned,
                        float rate) {
  const cv::Rect& roi = reference.image->roi;
  for (const Patch& patch : patches) {
    const cv::Rect cell(patch.corner, cv::Size(grid_.patch_px, grid_.patch_px));
    if ((cell & roi) != cell) continue;
    const Eigen::Vector3f ray(patch.ray_x[0], patch.ray_y[0], 1.f);
    const Eigen::Vector3f y = reference.R * ray - reference.t * m.dot(ray);
    if (!((y / y.z() - ray).norm() > kMinFlow)) continue;
    float& probability = probability_[patch.cell];
    const bool is_static = isStatic(patch, reference, matcher, m, is_aligned);
    probability += rate * ((is_static ? 1.f : 0.f) - probability);
  }
}

bool StaticMask::isStatic(const Patch& patch, const Reference& reference,
                          const PatchMatcher& matcher, const Eigen::Vector3f& m,
                          bool is_aligned) const {
  Samples values;
  for (int i = 0; i < kPatchSamples; ++i) {
    const auto u = static_cast<int>(std::lround(patch.ray_x[i] * camera_.fx + camera_.cx));
    const auto v = static_cast<int>(std::lround(patch.ray_y[i] * camera_.fy + camera_.cy));
    values[i] = reference.image->row(v)[u];
  }
  const float noise = matcher.imageNoise();
  const float as_static = correlate(patch, noise, &values);
  const float as_road = is_aligned && matcher.sample(reference, patch, m, &values)
                            ? correlate(patch, noise, &values)
                            : 0.f;
  return patch.texture > kMinTextureShare && as_static > kMinCorrelation &&
         as_static > as_road + kMinMargin;
}

}  // namespace ground_scale_vo::direct
