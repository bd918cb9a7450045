#include "vo/alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "vo/float_patch.hpp"
#include "vo/lucas_kanade.hpp"
#include "vo/tracking.hpp"

namespace ground_scale_vo {
namespace {

/// [px] largest shift from the tracked position.
constexpr double kMaxShift_px = 1.5;
/// Largest ratio of the sizes of a patch in the current and the reference image.
constexpr double kMaxSizeRatio = 1.6;
constexpr int kMaxAlignmentIterations = 10;  // of Gauss-Newton
/// [px] step of the numeric derivative of the warp: small against a patch, large against rounding.
constexpr double kWarpStep_px = 2;
/// [px] step length at convergence: far below the noise of an aligned corner (0.2 px).
constexpr float kConverged_px = 0.003f;
/// While iterating, a patch may be this many times max_shift_px from its start.
constexpr float kMaxIntermediateShift = 2;
/// Minimum determinant over squared trace of the gradient matrix: the ratio of its eigenvalues is
/// then at least about 1e-3. Below this value the patch is an edge.
constexpr float kMinCornerness = 1e-3f;
/// [grey levels^2] guards the division by the sum of squared deviations from the mean of a uniform
/// patch in the current image.
constexpr float kMinSumOfSquares = 1e-3f;
/// Least ratio of the areas of a patch in the two images, and the inverse of the largest.
constexpr double kMinAreaRatio = 0.1;
/// Sine of the minimum angle between the line of sight and the surface (1.1 degrees). Below it the
/// surface is edge-on and the warp is undetermined.
constexpr double kMinGrazingSine = 0.02;

constexpr float kPixels = kAlignedSide * kAlignedSide;  ///< of a patch

/// Whether the square of half side `margin` [px] around u lies inside the image, with the
/// neighbours that bilinear interpolation needs.
bool contains(const cv::Mat& image, const Eigen::Vector2f& u, float margin) {
  return u.x() >= margin && u.y() >= margin &&
         u.x() + margin < static_cast<float>(image.cols - 1) &&
         u.y() + margin < static_cast<float>(image.rows - 1);
}

/// Normalised, of a patch with the pixels of which these are the sums.
float correlation(const MatchSums& sums, const ZeroMeanPatch& patch) {
  const float sum = total(sums.grey);
  const float squares = total(sums.squares) - sum * sum / kPixels;
  return total(sums.products) / std::sqrt(std::max(kMinSumOfSquares, squares) * patch.squares);
}

/// What is aligned, in single precision.
struct AlignmentTask {
  const cv::Mat& reference;
  Eigen::Vector2f u_ref;         ///< [px]
  Eigen::Matrix2f inverse_warp;  ///< from the current image to the reference
  const cv::Mat& current;
  Eigen::Vector2f start;  ///< [px]
  float max_shift_px;
};

struct AlignmentResult {
  bool found = false;
  Eigen::Vector2f u{0, 0};  ///< [px]
  float correlation = -1;
};

/// Not found when a patch lacks texture in two directions, or the search leaves the image or the
/// neighbourhood of the start. flatten: all that it calls becomes part of it, and so of its version
/// for AVX2.
GSV_VECTOR_LOOP __attribute__((flatten)) AlignmentResult alignPatch(const AlignmentTask& task) {
  FloatPatch wide;
  ZeroMeanPatch patch;
  sample(task.reference, task.u_ref, task.inverse_warp, &wide);
  differentiate(wide, &patch);
  Eigen::Matrix2f hessian;
  hessian << patch.xx, patch.xy, patch.xy, patch.yy;
  const float trace = hessian.trace();
  if (patch.squares < kPixels) return {};  // variance below 1 grey level^2
  if (hessian.determinant() < kMinCornerness * trace * trace) return {};
  const Eigen::Matrix2f inverse_hessian = hessian.inverse();

  constexpr float half = kAlignedSide / 2;
  FloatWindow around(task.current);
  Eigen::Vector2f u = task.start;
  MatchSums sums;
  for (int iteration = 0; iteration < kMaxAlignmentIterations; ++iteration) {
    if (!((u - task.start).norm() < kMaxIntermediateShift * task.max_shift_px) ||
        !contains(task.current, u, half)) {
      return {};
    }
    const Eigen::Vector2f corner = u - Eigen::Vector2f::Constant(half);
    const int column = static_cast<int>(corner.x()), row = static_cast<int>(corner.y());
    around.moveTo(column, row);
    sums = compare(around.data(), corner.x() - static_cast<float>(column),
                   corner.y() - static_cast<float>(row), patch);
    const Eigen::Vector2f step =
        inverse_hessian * Eigen::Vector2f(total(sums.along_x), total(sums.along_y));
    u -= step;
    if (step.norm() < kConverged_px) break;
  }
  return {true, u, correlation(sums, patch)};
}

/// If the last successful surface hypothesis reaches this normalised cross-correlation, the others
/// are not tried.
constexpr double kGoodCorrelation = 0.95;

/// Standard deviation of an aligned feature [normalised image coordinates].
constexpr double kAlignedSigma = 0.00025;

/// [px] that the pixels of most patches extend beyond the window, both sides together: the border
/// for the gradients, and the change of size.
constexpr int kPrefetchMargin_px = 4;

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

std::optional<PatchAlignment::Match> PatchAlignment::align(const cv::Mat& reference,
                                                           const Eigen::Vector2d& u_ref,
                                                           const Eigen::Matrix2d& warp,
                                                           const cv::Mat& current,
                                                           const Eigen::Vector2d& start) const {
  const AlignmentTask task{reference, u_ref.cast<float>(), warp.cast<float>().inverse(),
                           current,   start.cast<float>(), static_cast<float>(kMaxShift_px)};
  // Half the side in the reference, including the border that the gradients need.
  const float reach = static_cast<float>(kAlignedSide / 2 + 1) *
                          task.inverse_warp.cwiseAbs().rowwise().sum().maxCoeff() +
                      1;
  if (!isFinite(reach) || !contains(reference, task.u_ref, reach)) return std::nullopt;
  const AlignmentResult result = alignPatch(task);
  if (!result.found || !((result.u - task.start).norm() <= task.max_shift_px) ||
      !(result.correlation >= min_correlation_)) {
    return std::nullopt;
  }
  return Match{result.u.cast<double>(), result.correlation};
}

ReferenceAlignment::ReferenceAlignment(const PinholeCamera& camera, double min_correlation)
    : camera_(camera), alignment_(min_correlation) {}

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
    const double scale = p_r.z() / depth;
    if (keyframe.image.empty() || scale > kMaxSizeRatio || scale < 1 / kMaxSizeRatio) continue;
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
