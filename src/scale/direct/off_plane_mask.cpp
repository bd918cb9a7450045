#include "scale/direct/off_plane_mask.hpp"

#include <algorithm>
#include <cmath>

namespace ground_scale_vo::direct {
namespace {

/// [standard deviations] of a feature's depth, added to the threshold.
constexpr double kDepthSigmas = 3;

}  // namespace

OffPlaneMask::OffPlaneMask(const PatchGrid& grid, double threshold_heights)
    : grid_(grid), threshold_heights_(threshold_heights), votes_(grid.size(), 0) {}

void OffPlaneMask::update(const VoFrame& frame, const NormalPrior& prior, double height) {
  std::fill(votes_.begin(), votes_.end(), 0);
  if (!(height > 0)) return;
  const auto right = static_cast<float>(grid_.columns * grid_.patch_px);
  const auto bottom = static_cast<float>(grid_.rows * grid_.patch_px);
  for (const TrackedFeature& feature : frame.features) {
    const Eigen::Vector2f& u = feature.u;
    const bool inside = u.x() >= 0 && u.y() >= 0 && u.x() < right && u.y() < bottom;
    if (!hasUsablePoint(feature) || !inside) continue;
    const int column = static_cast<int>(u.x()) / grid_.patch_px;
    const int row = static_cast<int>(u.y()) / grid_.patch_px;
    // Compared as inverse depths, whose error is nearly normal.
    const double expected = -prior.n_c.dot(frame.camera.ray(u.cast<double>())) / height;
    const double z = feature.p_c.z();
    const double deviation = std::abs(1 / z - expected);
    const double allowed =
        threshold_heights_ * expected + kDepthSigmas * feature.depth_sigma / (z * z);
    votes_[grid_.index(row, column)] += deviation > allowed ? 1 : -1;
  }
}

}  // namespace ground_scale_vo::direct
