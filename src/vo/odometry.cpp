#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "common/time.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "vo/alignment.hpp"
#include "vo/descriptors.hpp"
#include "vo/feature.hpp"
#include "vo/initialisation.hpp"
#include "vo/mapping.hpp"
#include "vo/motion.hpp"
#include "vo/pose_search.hpp"
#include "vo/recovery.hpp"
#include "vo/tracking.hpp"

namespace ground_scale_vo {
namespace {

/// After an interruption, features with a reprojection error above this multiple of
/// kMaxAdjustedError are wrong. It exceeds 1 because that limit applies after
/// bundle adjustment, which has fitted poses and points to the observations.
constexpr double kMaxInconsistency = 2;

/// [normalised image coordinates] Largest epipolar distance of a feature without depth.
constexpr double kMaxEpipolarError = 0.0028;

/// Consecutive frames in which a feature may be an outlier.
constexpr int kMaxOutlierFrames = 2;
/// Consecutive images with texture but without a pose after which a new map starts.
constexpr int kLostImagesBeforeNewMap = 3;

/// [image intervals] The pose search begins when more images than this have no texture or are
/// missing. Irregular stamps of images that follow each other look like fewer.
constexpr double kMaxMissingImages = 4;

/// [matches] minimum number from which the positions of the other features are predicted.
constexpr std::size_t kMinPredictingMatches = 25;

/// Standard deviation of the rotation rate at a stamp against the mean over the interval before it,
/// as a share of the change between two intervals: at a constant angular acceleration it is half.
constexpr double kRotationRateSigma = 0.5;

MotionModel motionBetween(const StampedPose& from, const StampedPose& to) {
  MotionModel motion(from.T_w_c, from.stamp_ns);
  motion.update(to.T_w_c, to.stamp_ns);
  return motion;
}

}  // namespace

struct VisualOdometry::Impl {
  const Options options;
  const PinholeCamera camera;

  FrameToFrameTracking tracking;
  MapInitialisation initialisation;
  ReferenceAlignment reference_alignment;
  const PoseEstimation pose_estimation;
  const Relocalisation relocalisation;
  const PoseSearch pose_search;
  Mapping mapping;
  MotionModel motion;
  Matrix6d pose_covariance = Matrix6d::Zero();  ///< see VoFrame

  VoStatus status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;
  Continuity continuity = Continuity::kNewTrajectory;  ///< of the frame that is processed
  std::uint32_t next_sequence = 0;
  MapStart map_start;
  /// From the last frame with a pose, or from the first image, to the first frame of the next map.
  RotationChain rotation_to_start;
  Interruption interruption;

  Impl(const PinholeCamera& camera_in, const Options& options_in, const cv::Mat& mask)
      : options((options_in.validate(), options_in)),
        camera((camera_in.validate(), requireMask(mask, camera_in), camera_in)),
        tracking(camera, options, mask),
        initialisation(camera, options),
        reference_alignment(camera, options.min_correlation),
        relocalisation(camera),
        pose_search(camera, mask),
        mapping(camera, options),
        interruption(camera) {}

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
        pyramid = tracking.preprocess(image);
      }
      const std::vector<Feature> visible = status == VoStatus::kInitialising
                                               ? initialise(std::move(pyramid), stamp_ns, &out)
                                               : track(std::move(pyramid), stamp_ns, &out);
      fill(visible, &out.frame);
      continuity = Continuity::kSameMap;
    }
    return out;
  }

  /// Processes a frame while there is no map. Returns the features tracked in it.
  std::vector<Feature> initialise(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    std::vector<Feature> found;
    if (!tracking.features().empty()) {
      ScopedTimer timer(&out->times.track);
      const bool has_flow = tracking.features().front().age > 0;
      const auto predicted =
          has_flow ? predictPixelsByFlow(tracking.features(), tracking.secondsUntil(stamp_ns))
                   : std::vector<cv::Point2f>();
      found =
          tracking.track(image, stamp_ns, predicted, Eigen::Matrix3d::Identity(), &out->rejected);
    }
    if (!tracking.features().empty() && tracking.isTextureless(image, found.size())) return {};
    if (!initialisation.canContinueWith(found.size())) {
      trackByMatching(image, stamp_ns, &found, &out->rejected);
    }
    if (!initialisation.canContinueWith(found.size())) {
      ScopedTimer timer(&out->times.detect);
      if (out->frame.sequence > 0) {
        rotation_to_start.append(initialisation.rotationSinceFirst(found));
      }
      restart(std::move(image), stamp_ns);
      return tracking.features();
    }
    if (options.readout_time > 0) {
      shiftToStampByFlow(camera, options.readout_time, tracking.secondsUntil(stamp_ns), &found);
    }
    initialisation.addFrame(stamp_ns, found);

    ScopedTimer timer(&out->times.pose);
    auto poses = initialisation.tryStartMap(found, image, &mapping);
    if (!poses) {
      if (!tracking.advanceUnlessStandstill(std::move(image), stamp_ns, found)) {
        initialisation.newestStandsStill();
      }
      return found;
    }
    status = VoStatus::kTracking;
    motion = motionBetween(poses->end()[-2], poses->back());
    mapping.map().keyframes().front().readout_motion =
        readoutMotion(motionBetween((*poses)[0], (*poses)[1]));
    mapping.map().keyframes().back().readout_motion = readoutMotion(motion);
    map_start = {poses->front().stamp_ns, rotation_to_start.R_first_last(),
                 rotation_to_start.sigma()};
    pose_covariance = pose_estimation
                          .estimate(motion.T_w_c(),
                                    pointObservations(mapping.map(), observationsOf(camera, found)))
                          .covariance;
    out->start = std::move(*poses);
    out->frame.keyframe = true;
    tracking.advance(std::move(image), stamp_ns, found);
    detectNew();
    return found;
  }

  /// Detects new features in a frame with a pose.
  void detectNew() {
    tracking.detectNew();
    shiftToStamp(motion, &tracking.features());
  }

  Vector6d readoutMotion(const MotionModel& moved) const {
    return options.readout_time * moved.velocity();
  }

  /// Sets Feature::to_stamp. moved: the pose and the velocity of their image.
  void shiftToStamp(const MotionModel& moved, std::vector<Feature>* features) const {
    if (options.readout_time == 0) return;
    ground_scale_vo::shiftToStamp(
        camera, mapping.map(), moved.T_w_c(), readoutMotion(moved),
        kRotationRateSigma * options.readout_time * moved.rotationRateChange(), features);
  }

  /// Tracks the features again from positions predicted by descriptor matches. Changes nothing when
  /// that finds fewer.
  void trackByMatching(const ImagePyramid& image, std::int64_t stamp_ns,
                       std::vector<Feature>* found, std::vector<RejectedFeature>* rejected) const {
    const Descriptors previous = tracking.describeFeatures();
    const Descriptors next = tracking.describeCorners(image);
    const auto matches = matchDescriptors(previous, next);
    if (matches.size() < kMinPredictingMatches) return;
    std::vector<RejectedFeature> rejected_again;
    std::vector<Feature> again = tracking.track(
        image, stamp_ns, predictPixelsByMatches(previous.points(), next.points(), matches),
        Eigen::Matrix3d::Identity(), &rejected_again);
    if (again.size() <= found->size()) return;
    *found = std::move(again);
    *rejected = std::move(rejected_again);
  }

  /// Restarts the initialisation with this image as the first one.
  void restart(ImagePyramid image, std::int64_t stamp_ns) {
    status = VoStatus::kInitialising;
    mapping.map().clear();
    image.exposure = 1;
    tracking.advance(std::move(image), stamp_ns, {});
    tracking.detectNew();
    initialisation.restart(stamp_ns, tracking.features(), tracking.image().image);
  }

  /// Processes a frame when there is a map. Returns the features tracked in it; empty when lost.
  std::vector<Feature> track(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    const bool was_lost = status == VoStatus::kLost;
    std::vector<Feature> found = findFeatures(image, stamp_ns, std::nullopt, out);
    if (!estimatePose(stamp_ns, std::nullopt, &found, out) &&
        !relocalise(&image, stamp_ns, &found, out)) {
      return {};
    }
    // After an interruption many features are wrong: they would become observations of a keyframe.
    if (was_lost) removeInconsistent(motion.T_w_c(), &found, &out->rejected);
    status = VoStatus::kTracking;
    interruption.end();
    out->frame.keyframe = mapping.needsKeyframe(motion.T_w_c(), found);
    if (!out->frame.keyframe) {
      tracking.advanceUnlessStandstill(std::move(image), stamp_ns, found);
      return found;
    }
    tracking.advance(std::move(image), stamp_ns, found);
    {
      ScopedTimer timer(&out->times.detect);
      detectNew();
    }
    mapping.addKeyframe(motion.T_w_c(), tracking.features(), tracking.image(), &out->times,
                        readoutMotion(motion));
    return found;
  }

  /// Finds the pose of an image in which tracking has failed, by descriptors or by a search.
  /// Returns false when there is none; after several images with texture a new map starts.
  bool relocalise(ImagePyramid* image, std::int64_t stamp_ns, std::vector<Feature>* found,
                  Output* out) {
    const Descriptors previous = tracking.describeFeatures();
    Descriptors corners = tracking.describeCorners(*image);
    auto pose = relocalisation.locate(mapping.map(), motion, tracking.features(), previous, corners,
                                      stamp_ns);
    if (pose && trackFrom(*pose, *image, stamp_ns, found, out)) return true;
    status = VoStatus::kLost;
    if (tracking.isTextureless(*image, found->size())) return false;
    pose.reset();
    // While images follow each other, features that disagree with a pose are evidence against it.
    // The search ignores them: behind a car that moves along, it would find a pose without motion.
    if (motion.stepsSince(stamp_ns) - interruption.images() > kMaxMissingImages) {
      pose = pose_search.locate(mapping.map(), motion, tracking.features(), tracking.image().image,
                                image->image, stamp_ns);
    }
    if (pose && trackFrom(*pose, *image, stamp_ns, found, out)) return true;
    const auto rotation =
        pose
            ? std::make_optional(RelativeRotation{
                  pose->T_w_c.linear().transpose() * motion.T_w_c().linear(), pose->rotation_sigma})
            : interruption.rotationBetween(previous, corners);
    interruption.addImage(rotation, std::move(corners));
    if (interruption.images() < kLostImagesBeforeNewMap) return false;
    rotation_to_start = interruption.rotation();
    interruption.end();
    ++map_id;
    continuity = Continuity::kNewMap;
    restart(std::move(*image), stamp_ns);
    return false;
  }

  /// Tracks the features again from the pose found. Most of those that are tracked over a long
  /// interruption are wrong, so the pose is estimated from those that are consistent with it.
  bool trackFrom(const RelocalisedPose& pose, const ImagePyramid& image, std::int64_t stamp_ns,
                 std::vector<Feature>* found, Output* out) {
    *found = findFeatures(image, stamp_ns, pose, out);
    removeInconsistent(pose.T_w_c, found, &out->rejected);
    return estimatePose(stamp_ns, pose.T_w_c, found, out);
  }

  /// Removes the features that are not at the projections of their map points.
  void removeInconsistent(const Eigen::Isometry3d& T_w_c, std::vector<Feature>* found,
                          std::vector<RejectedFeature>* rejected) const {
    const Eigen::Isometry3d T_c_w = T_w_c.inverse();
    std::vector<Feature> kept;
    for (const Feature& feature : *found) {
      const auto point = mapping.map().point(feature.id);
      if (!point || reprojectionError(T_c_w * point->p_w, camera.ray(feature.atStamp()).head<2>()) <
                        kMaxInconsistency * kMaxAdjustedError) {
        kept.push_back(feature);
      } else {
        rejected->push_back({feature.id, feature.u.cast<float>(), RejectReason::kOutlier});
      }
    }
    *found = std::move(kept);
  }

  /// Tracks the features of the previous image (FrameToFrameTracking), and aligns them to the
  /// patches of the keyframes. relocalised: predicts the pose of the image instead of the motion
  /// model, and supplies features that cannot be tracked.
  std::vector<Feature> findFeatures(const ImagePyramid& image, std::int64_t stamp_ns,
                                    const std::optional<RelocalisedPose>& relocalised,
                                    Output* out) {
    const auto predict = [&] {
      return relocalised ? relocalised->T_w_c : motion.predict(stamp_ns);
    };
    out->rejected.clear();  // by an attempt from another predicted pose
    std::vector<Feature> found;
    {
      ScopedTimer timer(&out->times.track);
      const Eigen::Isometry3d T_w_previous = motion.T_w_c();
      const Eigen::Isometry3d predicted = predict();
      found = tracking.track(
          image, stamp_ns,
          predictPixels(camera, mapping.map(), tracking.features(), T_w_previous, predicted),
          predicted.linear().transpose() * T_w_previous.linear(), &out->rejected);
    }
    if (relocalised) addFeatures(relocalised->features, &found, &out->rejected);
    if (const auto correction = mapping.applyAdjustment(&out->times)) {
      motion.correct(*correction);
    }
    ScopedTimer timer(&out->times.align);
    reference_alignment.align(mapping.map(), image, predict(), &found);
    return found;
  }

  /// Estimates the pose and removes the outliers from `found`. Returns false, and changes nothing,
  /// when there is no pose.
  bool estimatePose(std::int64_t stamp_ns, const std::optional<Eigen::Isometry3d>& predicted,
                    std::vector<Feature>* found, Output* out) {
    ScopedTimer timer(&out->times.pose);
    std::vector<std::size_t> index;  // indices of the observed features in `found`
    const auto estimate = [&](const Eigen::Isometry3d& initial) {
      index.clear();
      return pose_estimation.estimate(
          initial, pointObservations(mapping.map(), observationsOf(camera, *found), &index));
    };
    PoseEstimation::Result pose = estimate(predicted.value_or(motion.predict(stamp_ns)));
    if (pose.status != PoseStatus::kOk) return false;
    if (options.readout_time > 0) {  // so far with the shifts of the previous image
      MotionModel moved = motion;
      moved.update(pose.T_w_c, stamp_ns);
      shiftToStamp(moved, found);
      pose = estimate(pose.T_w_c);
      if (pose.status != PoseStatus::kOk) return false;
    }

    const Eigen::Isometry3d T_w_previous = motion.T_w_c();
    motion.update(pose.T_w_c, stamp_ns);
    pose_covariance = pose.covariance;
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
    kept.reserve(found->size());
    LandmarkWalk landmarks(mapping.map().landmarks());
    for (std::size_t i = 0; i < found->size(); ++i) {
      const Feature& feature = (*found)[i];
      Landmark* const landmark = landmarks.find(feature.id);
      bool keep;
      if (landmark && landmark->depth) {
        landmark->outlier_count = inlier[i] ? 0 : landmark->outlier_count + 1;
        keep = landmark->outlier_count <= kMaxOutlierFrames;
      } else {
        keep = epipolarError(T_c_previous, camera.ray(previous[i].atStamp()),
                             camera.ray(feature.atStamp())) < kMaxEpipolarError;
      }
      if (keep) {
        kept.push_back(feature);
      } else {
        rejected->push_back({feature.id, feature.u.cast<float>(), RejectReason::kOutlier});
      }
    }
    *found = std::move(kept);
  }

  /// Adds the features that `found` does not contain.
  static void addFeatures(const std::vector<Feature>& features, std::vector<Feature>* found,
                          std::vector<RejectedFeature>* rejected) {
    const auto by_id = [](const Feature& a, const Feature& b) { return a.id < b.id; };
    std::vector<Feature> all;
    std::set_union(found->begin(), found->end(), features.begin(), features.end(),
                   std::back_inserter(all), by_id);
    *found = std::move(all);
    const auto is_found = [&](const RejectedFeature& feature) {
      return std::any_of(features.begin(), features.end(),
                         [&](const Feature& f) { return f.id == feature.id; });
    };
    rejected->erase(std::remove_if(rejected->begin(), rejected->end(), is_found), rejected->end());
  }

  void fill(const std::vector<Feature>& visible, VoFrame* frame) const {
    frame->status = status;
    frame->map_id = map_id;
    frame->continuity = continuity;
    if (status != VoStatus::kInitialising) frame->map_start = map_start;
    if (status == VoStatus::kTracking) {
      frame->pose_covariance = pose_covariance;
      frame->T_w_c = motion.T_w_c();
      frame->readout_motion = readoutMotion(motion);
    }
    const Eigen::Isometry3d T_c_w = motion.T_w_c().inverse();
    frame->features.reserve(visible.size());
    LandmarkWalk landmarks(std::as_const(mapping.map()).landmarks());
    for (const Feature& feature : visible) {
      TrackedFeature tracked;
      tracked.id = feature.id;
      tracked.age = feature.age;
      tracked.u = feature.atStamp().cast<float>();
      if (const auto point = mapping.map().pointOf(landmarks.find(feature.id))) {
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

VisualOdometry::VisualOdometry(const PinholeCamera& camera, const Options& options,
                               const cv::Mat& mask)
    : impl_(std::make_unique<Impl>(camera, options, mask)) {}

VisualOdometry::~VisualOdometry() = default;

VisualOdometry::Output VisualOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  return impl_->process(image, stamp_ns);
}

}  // namespace ground_scale_vo
