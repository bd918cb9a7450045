#include "vo/reference_alignment.hpp"

#include <algorithm>
#include <utility>

#include "ground_scale_vo/vo/exposure.hpp"
#include "vo/float_patch.hpp"
#include "vo/lucas_kanade.hpp"

namespace ground_scale_vo {
namespace {

/// If the last successful surface hypothesis reaches this normalised cross-correlation, the others
/// are not tried.
constexpr double kGoodCorrelation = 0.95;

/// Standard deviation of an aligned feature [normalised image coordinates].
constexpr double kAlignedSigma = 0.00025;

/// [px] that the pixels of most patches extend beyond the window, both sides together: the border
/// for the gradients, and the change of size.
constexpr int kPrefetchMargin_px = 4;

}  // namespace

ReferenceAlignment::ReferenceAlignment(const PinholeCamera& camera,
                                       const PatchAlignment::Options& options)
    : camera_(camera), alignment_(options) {}

void ReferenceAlignment::align(const LocalMap& map, const ImagePyramid& image,
                               const Eigen::Isometry3d& predicted_T_w_c,
                               std::vector<Feature>* features) {
  const Eigen::Isometry3d T_c_w = predicted_T_w_c.inverse();
  updateKeyframeImages(map, image.exposure);
  std::vector<KeyframePose> poses;
  for (const Keyframe& keyframe : map.keyframes()) {
    poses.push_back({keyframe.T_w_c.inverse(), T_c_w * keyframe.T_w_c});
  }
  std::vector<std::pair<Feature*, Reference>> references;
  LandmarkWalk landmarks(map.landmarks());
  for (Feature& feature : *features) {
    const Landmark* const landmark = landmarks.find(feature.id);
    const auto point = map.pointOf(landmark);
    if (!point) continue;
    const double depth = (T_c_w * point->p_w).z();
    if (!(depth > 0)) continue;
    const auto reference = findReference(map, *landmark, poses, point->p_w, depth);
    if (reference) references.emplace_back(&feature, *reference);
  }
  constexpr int side = kAlignedSide + kPrefetchMargin_px;
  for (std::size_t i = 0; i < references.size(); ++i) {
    if (i + 1 < references.size()) {
      const auto& [next, next_reference] = references[i + 1];
      prefetchPatch(keyframe_images_[next_reference.keyframe].image, toCv(next_reference.u), side);
      prefetchPatch(image.image, toCv(next->u), side);
    }
    auto& [feature, reference] = references[i];
    const auto aligned =
        alignFeature(*feature, reference, keyframe_images_[reference.keyframe].image,
                     poses[reference.keyframe].T_c_r, image.image);
    if (!aligned) continue;
    feature->u = aligned->match.u;
    feature->sigma = kAlignedSigma;
    feature->surface = aligned->surface;
  }
}

/// Applies the gain only for new keyframes or a changed gain.
void ReferenceAlignment::updateKeyframeImages(const LocalMap& map, double exposure) {
  std::vector<KeyframeImage> images;
  for (const Keyframe& keyframe : map.keyframes()) {
    const double gain = exposure / keyframe.exposure;
    const auto cached = std::find_if(
        keyframe_images_.begin(), keyframe_images_.end(),
        [&](const auto& k) { return k.original.data == keyframe.image.data && k.gain == gain; });
    images.push_back(cached != keyframe_images_.end()
                         ? *cached
                         : KeyframeImage{keyframe.image, gain, applyGain(keyframe.image, gain)});
  }
  keyframe_images_ = std::move(images);
}

/// The earliest keyframe observing the landmark whose scale change to the current image is at most
/// max_scale.
std::optional<ReferenceAlignment::Reference> ReferenceAlignment::findReference(
    const LocalMap& map, const Landmark& landmark, const std::vector<KeyframePose>& poses,
    const Eigen::Vector3d& p_w, double depth) const {
  for (const Observation& o : landmark.observations) {
    const Keyframe& keyframe = map.keyframe(o.keyframe);
    const std::size_t index = keyframe.id - map.keyframes().front().id;
    const Eigen::Vector3d p_r = poses[index].T_r_w * p_w;
    const double scale = p_r.z() / depth, max_scale = alignment_.options().max_scale;
    if (keyframe.image.empty() || scale > max_scale || scale < 1 / max_scale) continue;
    return Reference{index, camera_.project(o.x.homogeneous()) - o.to_stamp, p_r};
  }
  return std::nullopt;
}

/// Tries the last successful surface hypothesis, and the others when it does not fit well.
std::optional<ReferenceAlignment::AlignedFeature> ReferenceAlignment::alignFeature(
    const Feature& feature, const Reference& reference, const cv::Mat& reference_image,
    const Eigen::Isometry3d& T_c_r, const cv::Mat& image) const {
  std::optional<AlignedFeature> best;
  const auto trySurface = [&](PatchSurface surface) {
    const auto warp = patchWarp(camera_, reference.p_r, T_c_r, surface);
    if (!warp) return;
    const auto match = alignment_.align(reference_image, reference.u, *warp, image, feature.u);
    if (!match || (best && best->match.correlation >= match->correlation)) return;
    best = AlignedFeature{*match, surface};
  };
  trySurface(feature.surface);
  if (best && best->match.correlation >= kGoodCorrelation) return best;
  for (const auto surface :
       {PatchSurface::kFrontoParallel, PatchSurface::kFloor, PatchSurface::kWall}) {
    if (surface != feature.surface) trySurface(surface);
  }
  return best;
}

}  // namespace ground_scale_vo
