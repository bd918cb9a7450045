#include "scale/direct/image_buffer.hpp"

#include <algorithm>

namespace ground_scale_vo::direct {
namespace {

/// [first baselines] between kept images.
constexpr double kMinSpacing = 0.2;
/// Kept images. Two baselines at the minimum spacing are ten intervals between eleven images; one
/// more, because the newest one may be closer to its predecessor.
constexpr int kCapacity = 12;
/// [first baselines] A shorter one leaves a parallax of the order of the pose error.
constexpr double kMinBaseline = 0.2;
/// Between the distance of an image and the one asked for: allows for large steps between frames.
constexpr double kMaxBaselineRatio = 8;

Reference makeReference(const RoadImage& image, const RoadImage& current) {
  Reference reference;
  reference.image = &image;
  reference.readout_motion_c = current.readout_motion;
  reference.setMotion(image.T_w_c.inverse() * current.T_w_c);
  return reference;
}

}  // namespace

void Reference::setMotion(const Eigen::Isometry3d& T_r_c) {
  R = T_r_c.linear().cast<float>();
  t = T_r_c.translation().cast<float>();
  perpendicular[0] = t.unitOrthogonal() * t.norm();
  perpendicular[1] = t.normalized().cross(perpendicular[0]);
}

ImageBuffer::ImageBuffer(double baseline_heights)
    : images_(kCapacity + 1), baseline_heights_(baseline_heights) {}

std::vector<Reference> ImageBuffer::selectReferences(double height) const {
  std::vector<Reference> references;
  references.reserve(kReferences);
  const double baseline = baseline_heights_ * height;
  const RoadImage* first = nullptr;
  for (int k = 1; k <= kReferences; ++k) {
    const RoadImage* best = nullptr;
    double best_ratio = kMaxBaselineRatio;
    for (std::size_t i = 1; i <= kept_; ++i) {
      const RoadImage& image = images_[i];
      const double distance = (image.T_w_c.translation() - current().T_w_c.translation()).norm();
      if (image.roi.empty() || &image == first || distance < kMinBaseline * baseline) continue;
      const double ratio = std::max(distance / (k * baseline), k * baseline / distance);
      if (ratio < best_ratio) {
        best_ratio = ratio;
        best = &image;
      }
    }
    if (best == nullptr) break;
    first = best;
    references.push_back(makeReference(*best, current()));
  }
  return references;
}

double ImageBuffer::stepLength() const {
  return (images_[1].T_w_c.translation() - images_[0].T_w_c.translation()).norm();
}

void ImageBuffer::keepCurrent(double height) {
  if (current().roi.empty()) return;
  const bool newest_is_redundant =
      kept_ >= 2 && (images_[1].T_w_c.translation() - images_[2].T_w_c.translation()).norm() <
                        kMinSpacing * baseline_heights_ * height;
  if (newest_is_redundant) {
    std::swap(images_[0], images_[1]);
  } else {
    std::rotate(images_.begin(), images_.end() - 1, images_.end());
    kept_ = std::min(kept_ + 1, images_.size() - 1);
  }
}

}  // namespace ground_scale_vo::direct
