#include "ground_scale_vo/scale/direct_plane_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/scale/lane_region.hpp"
#include "scale/direct/height_search.hpp"
#include "scale/direct/image_buffer.hpp"
#include "scale/direct/patch.hpp"
#include "scale/direct/patch_matcher.hpp"
#include "scale/direct/plane_solver.hpp"
#include "scale/direct/static_mask.hpp"

namespace ground_scale_vo {
namespace {

/// [camera heights] Least length of the visible part of the lane region. A tele lens sees no road
/// near the vehicle, so its region extends this far beyond the nearest visible road.
constexpr double kMinLaneLength = 6;
/// Least slope of a viewing ray towards the road at which patches still resolve its texture.
constexpr double kMinRaySlope = 0.02;

/// Cosine between optical axis and backward direction from which on a camera faces backwards: its
/// reference images show the road from nearer than the current one, so PatchExtractor smooths them
/// instead. To one that looks sideways the road is equally near in all images.
constexpr double kMinBackwards = 0.5;

/// [1 / camera height] Standard deviation of a curvature that is none.
constexpr double kNone = 1e-9;

/// The road is flat across the lane unless the lens is known.
DirectPlaneEstimator::Options forCamera(DirectPlaneEstimator::Options options,
                                        const PinholeCamera& camera) {
  if (!camera.lens_is_estimated) options.crown_sigma = options.twist_sigma = kNone;
  return options;
}

/// Distance at which the middle of the lower image border meets the road [camera heights]; 0 when
/// it does not, or at a slope below kMinRaySlope.
double nearestVisibleRoad(const PinholeCamera& camera, const NormalPrior& prior) {
  const Eigen::Vector3d ray(0, (camera.height - 1 - camera.cy) / camera.fy, 1);
  const double slope = -prior.n_c.dot(ray);
  return slope > kMinRaySlope ? (ray + slope * prior.n_c).norm() / slope : 0;
}

}  // namespace

void DirectPlaneEstimator::Options::validate() const {
  visitParameters(*this, RangeCheck("direct/"));
  requireInRange("direct/max_ahead_heights", max_ahead_heights, min_ahead_heights, 1000);
}

struct DirectPlaneEstimator::Impl {
  /// The steps of the method, for images of one camera with one mask. camera: of reduced images.
  struct Stages {
    Stages(const Options& options, const PinholeCamera& camera, int reduction, const cv::Mat& mask)
        : grid(camera, options.patch_size),
          extractor(camera, reduction, grid, options.image_noise, mask),
          images(options.baseline_heights),
          static_mask(camera, grid),
          matcher(camera, options.image_noise, extractor.allowed()),
          search(options),
          solver(forCamera(options, camera)) {}

    direct::PatchGrid grid;
    direct::PatchExtractor extractor;
    direct::ImageBuffer images;
    direct::StaticMask static_mask;
    direct::PatchMatcher matcher;
    direct::HeightSearch search;
    direct::PlaneSolver solver;
  };

  explicit Impl(const Options& o) : options(o) { options.validate(); }

  void setCamera(const PinholeCamera& new_camera, const cv::Mat& new_mask);
  LaneRegion laneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
                        double height) const;
  Eigen::Vector3d roadCentre(const Eigen::Vector3d& n_c, double height) const;
  void applyStaticMask();
  void setOrigin(const Eigen::Isometry3d& T_w_c, const NormalPrior& prior, double height,
                 const CameraPath& path);
  Result measure(const VoFrame& frame, const LaneRegion& lane, const NormalPrior& prior,
                 double height);
  void searchAndSolve(const VoFrame& frame, const LaneRegion& lane, const NormalPrior& prior,
                      Result* result);
  bool isSearchDue(double height) const;
  void updateStaticMask(const NormalPrior& prior, double height, bool is_aligned);

  const Options options;
  PinholeCamera image_camera, camera;  ///< of the images, and of the reduced ones
  cv::Mat mask;
  std::optional<Stages> stages;  ///< for camera and mask; empty before the first image
  std::vector<direct::Patch> patches;
  std::vector<direct::Reference> references;
  /// Of the camera whose height is measured, in this frame's camera axes [VO units].
  Eigen::Vector3d origin_c = Eigen::Vector3d::Zero();
  /// Camera position at the last success or search.
  std::optional<Eigen::Vector3d> last_attempt_w;
};

void DirectPlaneEstimator::Impl::setCamera(const PinholeCamera& new_camera,
                                           const cv::Mat& new_mask) {
  if (stages && isSameCamera(image_camera, new_camera) && mask.data == new_mask.data) return;
  const int reduction = direct::imageReduction(new_camera);
  image_camera = new_camera;
  camera = direct::reduced(image_camera, reduction);
  mask = new_mask;
  stages.emplace(options, camera, reduction, mask);
}

LaneRegion DirectPlaneEstimator::Impl::laneRegion(const NormalPrior& prior,
                                                  const std::optional<MotionHistory::Chord>& chord,
                                                  double height) const {
  const double max_ahead =
      std::max(options.max_ahead_heights, nearestVisibleRoad(camera, prior) + kMinLaneLength);
  return LaneRegion(prior, chord, height, options.min_ahead_heights, max_ahead,
                    options.lane_half_width_heights);
}

/// Centre of the patches on a plane, in this frame's camera axes [VO units].
Eigen::Vector3d DirectPlaneEstimator::Impl::roadCentre(const Eigen::Vector3d& n_c,
                                                       double height) const {
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();
  for (const direct::Patch& patch : patches) {
    const Eigen::Vector3d ray(patch.ray_x.mean(), patch.ray_y.mean(), 1);
    centre_c -= height / (n_c.dot(ray) * static_cast<double>(patches.size())) * ray;
  }
  return centre_c;
}

void DirectPlaneEstimator::Impl::applyStaticMask() {
  for (direct::Patch& patch : patches) patch.masked = stages->static_mask.contains(patch.cell);
}

/// The camera of the path above the centre of the patches, see CameraPath.
void DirectPlaneEstimator::Impl::setOrigin(const Eigen::Isometry3d& T_w_c, const NormalPrior& prior,
                                           double height, const CameraPath& path) {
  origin_c.setZero();
  if (path.empty() || patches.empty()) return;
  const Eigen::Vector3d centre_c = roadCentre(prior.n_c, height);
  origin_c = T_w_c.inverse() * path.nearest(T_w_c * centre_c).T_w_c.translation();
}

/// In every frame while the height is not known; otherwise once per search_interval_heights without
/// a measurement, because the search is by far the most expensive step.
bool DirectPlaneEstimator::Impl::isSearchDue(double height) const {
  const Eigen::Vector3d& position_w = stages->images.current().T_w_c.translation();
  return !last_attempt_w || !(height > 0) ||
         (position_w - *last_attempt_w).norm() > options.search_interval_heights * height;
}

/// Solves from the best height of a search over all heights.
void DirectPlaneEstimator::Impl::searchAndSolve(const VoFrame& frame, const LaneRegion& lane,
                                                const NormalPrior& prior, Result* result) {
  const double centre = direct::medianFeatureHeight(frame, lane, prior);
  references = stages->images.selectReferences(centre);
  const std::optional<GroundPlane> found =
      centre > 0 ? stages->search.find(patches, references, stages->matcher, prior, centre)
                 : std::nullopt;
  if (found)
    *result = stages->solver.solve(patches, references, stages->matcher, prior, *found, origin_c);
  result->searched = true;
}

/// From the predicted height, then, if that fails and is due, from a search.
/// Precondition: references is not empty.
DirectPlaneEstimator::Result DirectPlaneEstimator::Impl::measure(const VoFrame& frame,
                                                                 const LaneRegion& lane,
                                                                 const NormalPrior& prior,
                                                                 double height) {
  Result result;
  if (height > 0) {
    const GroundPlane predicted{prior.n_c, height};
    result = stages->solver.solve(patches, references, stages->matcher, prior, predicted, origin_c);
  }
  const bool failed = result.status != ScaleReason::kNone;
  if (failed && isSearchDue(height)) searchAndSolve(frame, lane, prior, &result);
  if (!failed || result.searched) last_attempt_w = frame.T_w_c.translation();
  return result;
}

void DirectPlaneEstimator::Impl::updateStaticMask(const NormalPrior& prior, double height,
                                                  bool is_aligned) {
  if (references.empty() || stages->images.empty()) return;
  const double step = stages->images.stepLength();
  const auto rate =
      static_cast<float>(std::min(1.0, step / (options.static_memory_heights * height)));
  stages->static_mask.update(patches, references.front(), stages->matcher,
                             (prior.n_c / height).cast<float>(), is_aligned, rate);
}

DirectPlaneEstimator::DirectPlaneEstimator(const Options& options)
    : impl_(std::make_unique<Impl>(options)) {}

DirectPlaneEstimator::~DirectPlaneEstimator() = default;

void DirectPlaneEstimator::reset() {
  if (impl_->stages) impl_->stages->images.clear();
  impl_->last_attempt_w.reset();
}

DirectPlaneEstimator::Result DirectPlaneEstimator::estimate(
    const VoFrame& frame, const cv::Mat& image, const NormalPrior& prior,
    const std::optional<MotionHistory::Chord>& chord, double height, const CameraPath& path,
    const cv::Mat& mask) {
  Impl& s = *impl_;
  s.setCamera(frame.camera, mask);
  Impl::Stages& stages = *s.stages;
  direct::RoadImage& current = stages.images.current();
  current.T_w_c = frame.T_w_c;
  current.readout_motion = frame.readout_motion;
  const LaneRegion lane = s.laneRegion(prior, chord, height);
  const bool faces_backwards = prior.forward_c.z() < -kMinBackwards;
  stages.extractor.extract(image, lane, faces_backwards, &current, &s.patches);
  s.applyStaticMask();

  Result result;
  result.status = ScaleReason::kStandstill;
  const double rough_height = height > 0 ? height : direct::medianFeatureHeight(frame, lane, prior);
  if (!(rough_height > 0)) return result;
  s.setOrigin(frame.T_w_c, prior, rough_height, path);
  s.references = stages.images.selectReferences(rough_height);
  if (!s.references.empty()) {
    result = s.measure(frame, lane, prior, height);
    const bool is_aligned = result.status == ScaleReason::kNone;
    if (is_aligned) {
      result.road_distance =
          (s.roadCentre(result.plane.n_c, result.plane.height) - s.origin_c).norm();
    }
    s.updateStaticMask(prior, is_aligned ? result.plane.height : rough_height, is_aligned);
  }
  stages.images.keepCurrent(rough_height);
  return result;
}

}  // namespace ground_scale_vo
