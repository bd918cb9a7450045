#include "ground_scale_vo/vo/visual_odometry.hpp"

#include <cmath>
#include <optional>
#include <utility>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "vo/feature.hpp"
#include "vo/frame_to_frame_tracking.hpp"
#include "vo/map_initialisation.hpp"
#include "vo/mapping.hpp"
#include "vo/motion_model.hpp"
#include "vo/pixel_prediction.hpp"
#include "vo/reference_alignment.hpp"

namespace ground_scale_vo {
namespace {

/// Minimum norm of the normal of an epipolar line [normalised image coordinates times VO units]. A
/// shorter normal has no direction: the camera has not moved, or the ray points to the epipole.
constexpr double kMinEpipolarLine = 1e-12;

/// Distance of ray_2 from the epipolar line of ray_1, in normalised image coordinates.
double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                     const Eigen::Vector3d& ray_2) {
  const Eigen::Vector3d line = T_2_1.translation().cross(T_2_1.linear() * ray_1);
  const double norm = line.head<2>().norm();
  return norm > kMinEpipolarLine ? std::abs(line.dot(ray_2)) / norm : 0;
}

}  // namespace

void VisualOdometry::Options::validate() const {
  visitParameters(*this, RangeCheck("odometry/"));
  tracker.validate();
  two_view.validate();
  alignment.validate();
  pose.validate();
  map.validate();
  bundle_adjustment.validate();
}

struct VisualOdometry::Impl {
  const Options options;
  const PinholeCamera camera;

  FrameToFrameTracking tracking;
  MapInitialisation initialisation;
  ReferenceAlignment reference_alignment;
  const PoseEstimation pose_estimation;
  Mapping mapping;
  MotionModel motion;

  VoStatus status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;
  std::uint32_t next_sequence = 0;
  int lost_frames = 0;

  Impl(const PinholeCamera& camera_in, const Options& options_in)
      : options((options_in.validate(), options_in)),
        camera((camera_in.validate(), camera_in)),
        tracking(camera, options),
        initialisation(camera, options),
        reference_alignment(camera, options.alignment, options.feature_sigma_aligned),
        pose_estimation(options.pose),
        mapping(camera, options) {}

  Output process(const cv::Mat& image, std::int64_t stamp_ns) {
    requireImage(image, camera);
    Output out;
    {
      ScopedTimer total(&out.times.total);
      out.frame.stamp_ns = stamp_ns;
      out.frame.sequence = next_sequence++;
      out.frame.camera = camera;
      ImagePyramid pyramid;
      {
        ScopedTimer timer(&out.times.pyramid);
        pyramid = tracking.pyramid(image);
      }
      const std::vector<Feature> visible = status == VoStatus::kInitialising
                                               ? initialise(std::move(pyramid), stamp_ns, &out)
                                               : track(std::move(pyramid), stamp_ns, &out);
      fill(visible, &out.frame);
    }
    return out;
  }

  /// Processes a frame while there is no map. Returns the features tracked in it.
  std::vector<Feature> initialise(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    std::vector<Feature> found;
    if (!tracking.features().empty()) {
      ScopedTimer timer(&out->times.track);
      const auto predicted =
          predictPixelsByFlow(tracking.features(), tracking.secondsUntil(stamp_ns));
      found =
          tracking.track(image, stamp_ns, predicted, Eigen::Matrix3d::Identity(), &out->rejected);
    }
    if (!initialisation.canContinueWith(found.size())) {
      ScopedTimer timer(&out->times.detect);
      restart(std::move(image), stamp_ns, out->frame.sequence);
      return tracking.features();
    }
    initialisation.addFrame(out->frame.sequence, stamp_ns, found);

    ScopedTimer timer(&out->times.pose);
    auto poses = initialisation.tryStartMap(found, image, &mapping);
    if (!poses) {
      tracking.advanceUnlessStandstill(std::move(image), stamp_ns, found);
      return found;
    }
    status = VoStatus::kTracking;
    lost_frames = 0;
    const StartPose& before = poses->end()[-2];
    motion.reset(before.T_w_c, before.stamp_ns);
    motion.update(poses->back().T_w_c, stamp_ns);
    out->start = std::move(*poses);
    out->frame.keyframe = true;
    tracking.advance(std::move(image), stamp_ns, found);
    tracking.detectNew();
    return found;
  }

  /// Restarts the initialisation with this image as the first one.
  void restart(ImagePyramid image, std::int64_t stamp_ns, std::uint32_t sequence) {
    status = VoStatus::kInitialising;
    mapping.map().clear();
    image.exposure = 1;
    tracking.advance(std::move(image), stamp_ns, {});
    tracking.detectNew();
    initialisation.restart(sequence, stamp_ns, tracking.features(), tracking.image().image);
  }

  /// Processes a frame when there is a map. Returns the features tracked in it; empty when lost.
  std::vector<Feature> track(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    std::vector<Feature> found = findFeatures(image, stamp_ns, out);
    if (!estimatePose(stamp_ns, &found, out)) {
      lose(std::move(image), stamp_ns, found.size(), out->frame.sequence);
      return {};
    }
    status = VoStatus::kTracking;
    lost_frames = 0;
    out->frame.keyframe = mapping.needsKeyframe(motion.T_w_c(), found);
    if (!out->frame.keyframe) {
      tracking.advanceUnlessStandstill(std::move(image), stamp_ns, found);
      return found;
    }
    tracking.advance(std::move(image), stamp_ns, found);
    {
      ScopedTimer timer(&out->times.detect);
      tracking.detectNew();
    }
    mapping.addKeyframe(motion.T_w_c(), tracking.features(), tracking.image(), &out->times);
    return found;
  }

  /// Tracks the features of the previous image, and aligns them to the patches of the keyframes.
  std::vector<Feature> findFeatures(const ImagePyramid& image, std::int64_t stamp_ns, Output* out) {
    std::vector<Feature> found;
    {
      ScopedTimer timer(&out->times.track);
      const Eigen::Isometry3d T_w_previous = motion.T_w_c();
      const Eigen::Isometry3d predicted = motion.predict(stamp_ns);
      found = tracking.track(
          image, stamp_ns,
          predictPixels(camera, mapping.map(), tracking.features(), T_w_previous, predicted),
          predicted.linear().transpose() * T_w_previous.linear(), &out->rejected);
    }
    if (const auto correction = mapping.takeAdjustedMap(&out->times)) {
      motion.correct(*correction * motion.T_w_c());
    }
    ScopedTimer timer(&out->times.align);
    reference_alignment.align(mapping.map(), image, motion.predict(stamp_ns), &found);
    return found;
  }

  /// Estimates the pose and removes the outliers from `found`. Returns false, and changes nothing,
  /// when there is no pose.
  bool estimatePose(std::int64_t stamp_ns, std::vector<Feature>* found, Output* out) {
    ScopedTimer timer(&out->times.pose);
    std::vector<std::size_t> index;  // indices of the observed features in `found`
    const auto observations = pointObservations(mapping.map(), toCorners(camera, *found), &index);
    const PoseEstimation::Result pose =
        pose_estimation.estimate(motion.predict(stamp_ns), observations);
    if (pose.status != PoseStatus::kOk) return false;

    const Eigen::Isometry3d T_w_previous = motion.T_w_c();
    motion.update(pose.T_w_c, stamp_ns);
    std::vector<bool> inlier(found->size(), true);
    for (std::size_t k = 0; k < index.size(); ++k) inlier[index[k]] = pose.inlier[k];
    removeOutliers(motion.T_w_c().inverse() * T_w_previous, inlier, found, &out->rejected);
    return true;
  }

  /// Removes features that were outliers of the pose in too many consecutive frames, and features
  /// without a map point that are off their epipolar line.
  void removeOutliers(const Eigen::Isometry3d& T_c_previous, const std::vector<bool>& inlier,
                      std::vector<Feature>* found, std::vector<RejectedFeature>* rejected) {
    const std::vector<Feature> previous = entriesOf(*found, tracking.features());
    std::vector<Feature> kept;
    for (std::size_t i = 0; i < found->size(); ++i) {
      const Feature& feature = (*found)[i];
      Landmark* landmark = mapping.map().find(feature.id);
      bool keep;
      if (landmark && landmark->depth) {
        landmark->outlier_count = inlier[i] ? 0 : landmark->outlier_count + 1;
        keep = landmark->outlier_count <= options.max_outlier_frames;
      } else {
        keep = epipolarError(T_c_previous, camera.ray(previous[i].u), camera.ray(feature.u)) <
               options.max_epipolar_error;
      }
      if (keep) {
        kept.push_back(feature);
      } else {
        rejected->push_back({feature.id, feature.u.cast<float>(), RejectReason::kOutlier});
      }
    }
    *found = std::move(kept);
  }

  /// Handles a frame without a pose. Starts a new map after several such frames with texture.
  void lose(ImagePyramid image, std::int64_t stamp_ns, std::size_t found, std::uint32_t sequence) {
    status = VoStatus::kLost;
    if (!tracking.isTextureless(image, found)) ++lost_frames;
    if (lost_frames < options.lost_frames_before_new_map) return;
    lost_frames = 0;
    ++map_id;
    restart(std::move(image), stamp_ns, sequence);
  }

  void fill(const std::vector<Feature>& visible, VoFrame* frame) const {
    frame->status = status;
    frame->map_id = map_id;
    if (status == VoStatus::kTracking) frame->T_w_c = motion.T_w_c();
    const Eigen::Isometry3d T_c_w = motion.T_w_c().inverse();
    for (const Feature& feature : visible) {
      TrackedFeature tracked;
      tracked.id = feature.id;
      tracked.age = feature.age;
      tracked.u = feature.u.cast<float>();
      if (const auto point = mapping.map().point(feature.id)) {
        TrackedFeature with_point = tracked;
        with_point.has_point = true;
        with_point.p_c = (T_c_w * point->p_w).cast<float>();
        with_point.depth_sigma =
            static_cast<float>(std::abs((T_c_w.linear() * point->sigma_w).z()));
        if (hasUsablePoint(with_point)) tracked = with_point;
      }
      frame->features.push_back(tracked);
    }
  }
};

VisualOdometry::VisualOdometry(const PinholeCamera& camera, const Options& options)
    : impl_(std::make_unique<Impl>(camera, options)) {}

VisualOdometry::~VisualOdometry() = default;

VisualOdometry::Output VisualOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  return impl_->process(image, stamp_ns);
}

}  // namespace ground_scale_vo
