#include "ground_scale_vo/vo/patch_alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "vo/exposure.hpp"
#include "vo/feature.hpp"
#include "vo/patch.hpp"

namespace ground_scale_vo {
namespace {

/// [px] step of the numeric derivative of the warp: small against a patch, large against rounding.
constexpr double kWarpStep_px = 2;
/// Least ratio of the areas of a patch in the two images, and the inverse of the largest.
constexpr double kMinAreaRatio = 0.1;
/// Sine of the minimum angle between the line of sight and the surface (1.1 degrees). Below it the
/// surface is edge-on and the warp is undetermined.
constexpr double kMinGrazingSine = 0.02;
/// If the last successful surface hypothesis reaches this correlation, the others are not tried.
constexpr float kGoodCorrelation = 0.95f;

/// Whether a patch around this pixel lies inside the image.
bool contains(const cv::Mat& image, const cv::Point2f& u) {
  constexpr auto kHalf = static_cast<float>(Patch::kSide / 2);
  return cv::Rect2f(kHalf, kHalf, static_cast<float>(image.cols) - 1 - 2 * kHalf,
                    static_cast<float>(image.rows) - 1 - 2 * kHalf)
      .contains(u);
}

}  // namespace

std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface) {
  const Eigen::Vector3d normal = Eigen::Vector3d::Unit(surface == PatchSurface::kFrontoParallel ? 2
                                                       : surface == PatchSurface::kFloor        ? 1
                                                                                         : 0);
  const Eigen::Vector3d p_c = T_c_r * p_r;
  const double distance = normal.dot(p_r);
  if (p_r.z() <= 0 || p_c.z() <= 0 || std::abs(distance) < kMinGrazingSine * p_r.norm())
    return std::nullopt;
  const Eigen::Vector2d u_r = camera.project(p_r), u_c = camera.project(p_c);
  Eigen::Matrix2d warp;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector3d ray = camera.ray(u_r + kWarpStep_px * Eigen::Vector2d::Unit(axis));
    const double depth = distance / normal.dot(ray);
    const Eigen::Vector3d q = T_c_r * Eigen::Vector3d(depth * ray);
    if (!(depth > 0) || q.z() <= 0) return std::nullopt;
    warp.col(axis) = (camera.project(q) - u_c) / kWarpStep_px;
  }
  const double area = std::abs(warp.determinant());
  if (!(area > kMinAreaRatio && area < 1 / kMinAreaRatio)) return std::nullopt;
  return warp;
}

void PatchAlignment::Options::validate() const { visitParameters(*this, RangeCheck("alignment/")); }

PatchAlignment::PatchAlignment(const PinholeCamera& camera, const Options& options)
    : camera_(camera), options_((options.validate(), options)) {}

void PatchAlignment::align(const LocalMap& map, const ImagePyramid& image,
                           const Eigen::Isometry3d& predicted_T_w_c,
                           std::vector<Feature>* features) {
  const Eigen::Isometry3d T_c_w = predicted_T_w_c.inverse();
  updateKeyframeImages(map, image.exposure);
  std::vector<Eigen::Isometry3d> T_r_w, T_c_r;
  for (const Keyframe& keyframe : map.keyframes()) {
    T_r_w.push_back(keyframe.T_w_c.inverse());
    T_c_r.push_back(T_c_w * keyframe.T_w_c);
  }
  std::vector<std::pair<Feature*, Reference>> references;
  LandmarkWalk landmarks(map.landmarks());
  for (Feature& feature : *features) {
    const Landmark* const landmark = landmarks.find(feature.id);
    const auto point = map.pointOf(landmark);
    if (!point) continue;
    const double depth = (T_c_w * point->p_w).z();
    if (!(depth > 0)) continue;
    const auto reference = findReference(map, *landmark, T_r_w, point->p_w, depth);
    if (reference) references.emplace_back(&feature, *reference);
  }
  for (std::size_t i = 0; i < references.size(); ++i) {
    if (i + 1 < references.size()) {
      const auto& [next, next_reference] = references[i + 1];
      Patch::prefetch(keyframe_images_[next_reference.keyframe].image, toCv(next_reference.u));
      Patch::prefetch(image.levels.front(), toCv(next->u));
    }
    const auto& [feature, reference] = references[i];
    alignFeature(reference, T_c_r[reference.keyframe], image.levels.front(), feature);
  }
}

/// Applies the gain only for new keyframes or a changed gain.
void PatchAlignment::updateKeyframeImages(const LocalMap& map, double exposure) {
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
/// max_scale. depth: of the point p_w in the current camera.
std::optional<PatchAlignment::Reference> PatchAlignment::findReference(
    const LocalMap& map, const Landmark& landmark, const std::vector<Eigen::Isometry3d>& T_r_w,
    const Eigen::Vector3d& p_w, double depth) const {
  for (const Observation& o : landmark.observations) {
    const Keyframe& keyframe = map.keyframe(o.keyframe);
    const std::size_t index = keyframe.id - map.keyframes().front().id;
    const Eigen::Vector3d p_r = T_r_w[index] * p_w;
    const double scale = p_r.z() / depth, max_scale = options_.max_scale;
    if (keyframe.image.empty() || scale > max_scale || scale < 1 / max_scale) continue;
    return Reference{index, camera_.project(o.x.homogeneous()) - o.to_stamp, p_r};
  }
  return std::nullopt;
}

/// Tries the last successful surface hypothesis, and the others when it does not fit well.
void PatchAlignment::alignFeature(const Reference& reference, const Eigen::Isometry3d& T_c_r,
                                  const cv::Mat& image, Feature* feature) const {
  const cv::Mat& reference_image = keyframe_images_[reference.keyframe].image;
  const cv::Point2f start = toCv(feature->u);
  const PatchSurface last = feature->surface;
  auto best = static_cast<float>(options_.min_correlation);
  const auto trySurface = [&](PatchSurface surface) {
    const auto warp = patchWarp(camera_, reference.p_r, T_c_r, surface);
    Patch patch;
    cv::Point2f point = start;
    if (!warp || !patch.cut(reference_image, toCv(reference.u), warp->inverse().cast<float>()) ||
        !patch.find(image, static_cast<float>(options_.max_shift_px), &point) ||
        !contains(image, point)) {
      return;
    }
    const float correlation = patch.correlation(image, point);
    if (!(correlation >= best)) return;
    best = correlation;
    feature->u = Eigen::Vector2d(point.x, point.y);
    feature->sigma = options_.sigma;
    feature->surface = surface;
  };
  trySurface(last);
  for (const auto surface :
       {PatchSurface::kFrontoParallel, PatchSurface::kFloor, PatchSurface::kWall}) {
    if (surface != last && best < kGoodCorrelation) trySurface(surface);
  }
}

}  // namespace ground_scale_vo
