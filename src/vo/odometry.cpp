#include "vo/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "common/time.hpp"
#include "vo/pose.hpp"
#include "vo/zoom.hpp"

namespace gsv {
namespace {

/// After an interruption, features with a reprojection error above this multiple of
/// kMaxAdjustedError are wrong. It exceeds 1 because that limit applies after bundle adjustment,
/// which has fitted poses and points to the observations.
constexpr double kMaxInconsistency = 2;

/// [normalised image coordinates] Largest epipolar distance of a feature without depth.
constexpr double kMaxEpipolarError = 0.0028;

/// Consecutive frames in which a feature may be an outlier: compression or a shadow may displace
/// it.
constexpr int kMaxOutlierFrames = 2;
/// Consecutive images with texture but without a pose after which a new map starts.
constexpr int kLostImagesBeforeNewMap = 3;

/// [image intervals] The pose search begins when more images than this have no texture or are
/// missing. Irregular stamps of images that follow each other look like fewer.
constexpr double kMaxMissingImages = 4;

/// Standard deviation of the rotation between the images before and after a zoom, as predicted
/// [rad].
constexpr double kZoomRotationSigma = 0.01;
/// [image intervals] After a longer one the predicted motion may be wrong: towards a wall it looks
/// like a zoom.
constexpr double kMaxStepsToZoom = 1.5;
/// A smaller factor of the focal length since the start is none: the lens has returned.
constexpr double kMinTotalZoom = 1.02;

/// [matches] minimum number from which the positions of the other features are predicted.
constexpr std::size_t kMinPredictingMatches = 25;

/// Standard deviation of the rotation rate at a stamp against the mean over the interval before it,
/// as a share of the change between two intervals: at a constant angular acceleration it is half.
constexpr double kRotationRateSigma = 0.5;

MotionModel motionBetween(const StampedPose& from, const StampedPose& to) {
  MotionModel motion(from);
  motion.update(to);
  return motion;
}

bool hasLowerId(const Feature& a, const Feature& b) { return a.id < b.id; }

/// Moves the features for which reject(feature) is true from `found` to `outliers`.
template <typename Reject>
void rejectFeatures(const Reject& reject, std::vector<Feature>* found,
                    std::vector<Feature>* outliers) {
  std::vector<Feature> kept;
  kept.reserve(found->size());
  for (const Feature& feature : *found) {
    (reject(feature) ? *outliers : kept).push_back(feature);
  }
  *found = std::move(kept);
}

/// previous: the features of the image before.
std::vector<RejectedFeature> rejectedOf(const std::vector<Feature>& previous,
                                        const std::vector<Feature>& found,
                                        const std::vector<Feature>& outliers) {
  std::vector<Feature> seen = found, lost;
  seen.insert(seen.end(), outliers.begin(), outliers.end());
  std::sort(seen.begin(), seen.end(), hasLowerId);
  std::set_difference(previous.begin(), previous.end(), seen.begin(), seen.end(),
                      std::back_inserter(lost), hasLowerId);
  std::vector<RejectedFeature> rejected;
  rejected.reserve(lost.size() + outliers.size());
  for (const Feature& feature : lost) rejected.push_back({feature.id, feature.u.cast<float>()});
  for (const Feature& feature : outliers) {
    rejected.push_back({feature.id, feature.u.cast<float>(), true});
  }
  return rejected;
}

}  // namespace

VisualOdometry::Impl::Impl(const PinholeCamera& camera, const Options& options, const cv::Mat& mask)
    : options_((options.validate(), options)),
      camera_((camera.validate(), requireMask(mask, camera), camera)),
      mask_(mask),
      tracking_(camera, options, mask),
      initialisation_(camera, options),
      reference_alignment_(camera, options.min_correlation),
      mapping_(camera, options),
      interruption_(camera) {}

VisualOdometry::Output VisualOdometry::Impl::process(const cv::Mat& image, std::int64_t stamp_ns) {
  requireImage(image, camera_);
  const Stopwatch total;
  Frame frame;
  frame.stamp_ns = stamp_ns;
  frame.image = tracking_.preprocess(image);
  frame.times.pyramid = total.ms();
  const std::vector<Feature> previous = tracking_.features();
  const std::vector<Feature> visible =
      status_ == VoStatus::kInitialising ? initialise(&frame) : track(&frame);
  Output output;
  output.frame = toVoFrame(frame, visible);
  output.start = std::move(frame.start);
  output.rejected = rejectedOf(previous, frame.found, frame.outliers);
  output.times = frame.times;
  output.times.total = total.ms();
  ++sequence_;
  continuity_ = Continuity::kSameMap;
  return output;
}

// --- Without a map -----------------------------------------------------------------------------

/// Returns the features tracked in the frame.
std::vector<Feature> VisualOdometry::Impl::initialise(Frame* frame) {
  const std::int64_t stamp_ns = frame->stamp_ns;
  const std::vector<Feature>& found = frame->found;
  if (!tracking_.features().empty()) {
    trackByFlow(frame);
    if (tracking_.isTextureless(frame->image, found.size())) return {};
  }
  if (!initialisation_.canContinueWith(found.size())) trackByMatching(frame);
  if (!initialisation_.canContinueWith(found.size())) {
    if (sequence_ > 0) {
      rotation_to_start_ = rotation_to_start_.then(initialisation_.rotationSinceFirst(found));
    }
    restart(frame);
    return tracking_.features();
  }
  if (options_.readout_time > 0) {
    shiftFeaturesByFlow(camera_, options_.readout_time, tracking_.secondsUntil(stamp_ns),
                        &frame->found);
  }
  initialisation_.addFrame(stamp_ns, found);
  ScopedTimer timer(&frame->times.pose);
  if (auto poses = initialisation_.tryStartMap(found, frame->image, &mapping_)) {
    startMap(std::move(*poses), frame);
  } else if (!tracking_.advanceUnlessStandstill(std::move(frame->image), stamp_ns, found)) {
    initialisation_.newestStandsStill();
  }
  return found;
}

void VisualOdometry::Impl::trackByFlow(Frame* frame) const {
  ScopedTimer timer(&frame->times.track);
  const std::int64_t stamp_ns = frame->stamp_ns;
  const bool has_flow = tracking_.features().front().age > 0;
  const auto predicted =
      has_flow ? predictPixelsByFlow(tracking_.features(), tracking_.secondsUntil(stamp_ns))
               : std::vector<cv::Point2f>();
  frame->found = tracking_.track(frame->image, stamp_ns, predicted, Eigen::Matrix3d::Identity());
}

/// Tracks the features again from positions predicted by descriptor matches. Changes nothing when
/// that finds fewer.
void VisualOdometry::Impl::trackByMatching(Frame* frame) const {
  const Descriptors previous = tracking_.describeFeatures();
  const Descriptors next = tracking_.describeCorners(frame->image);
  const auto matches = matchDescriptors(previous, next);
  if (matches.size() < kMinPredictingMatches) return;
  std::vector<Feature> again =
      tracking_.track(frame->image, frame->stamp_ns,
                      predictPixelsByMatches(previous.points(), next.points(), matches),
                      Eigen::Matrix3d::Identity());
  if (again.size() > frame->found.size()) frame->found = std::move(again);
}

/// poses: of the frames of the initialisation, in the new map.
void VisualOdometry::Impl::startMap(std::vector<StampedPose> poses, Frame* frame) {
  status_ = VoStatus::kTracking;
  motion_ = motionBetween(poses.end()[-2], poses.back());
  LocalMap& map = mapping_.map();
  map.keyframes().front().readout_motion = readoutMotion(motionBetween(poses[0], poses[1]));
  map.keyframes().back().readout_motion = readoutMotion(motion_);
  map_start_ = {poses.front().stamp_ns, rotation_to_start_.R_2_1.transpose(),
                rotation_to_start_.sigma};
  pose_covariance_ =
      estimatePose(motion_.T_w_c(), pointObservations(map, observationsOf(camera_, frame->found)))
          .covariance;
  frame->start = std::move(poses);
  frame->keyframe = true;
  tracking_.advance(std::move(frame->image), frame->stamp_ns, frame->found);
  tracking_.detectNew();
  shiftToStamp(motion_, &tracking_.features());
}

/// Restarts the initialisation with this frame as the first one.
void VisualOdometry::Impl::restart(Frame* frame) {
  ScopedTimer timer(&frame->times.detect);
  const std::int64_t stamp_ns = frame->stamp_ns;
  status_ = VoStatus::kInitialising;
  mapping_.map().clear();
  frame->image.exposure = 1;
  tracking_.advance(std::move(frame->image), stamp_ns, {});
  tracking_.detectNew();
  initialisation_.restart(stamp_ns, tracking_.features(), tracking_.image().image);
}

// --- With a map --------------------------------------------------------------------------------

/// Returns the features tracked in the frame; empty when lost.
std::vector<Feature> VisualOdometry::Impl::track(Frame* frame) {
  const bool was_lost = status_ == VoStatus::kLost;
  findFeatures(nullptr, frame);
  if (!localise(motion_.predict(frame->stamp_ns), frame)) {
    const bool follows = !was_lost && motion_.stepsSince(frame->stamp_ns) < kMaxStepsToZoom;
    if (const auto zoom = follows ? zoomOf(*frame) : std::nullopt) {
      startZoomedMap(*zoom, frame);
      return tracking_.features();
    }
    if (!relocalise(frame)) return {};
  }
  // After an interruption many features are wrong: they would become observations of a keyframe.
  if (was_lost) rejectInconsistent(motion_.T_w_c(), frame);
  status_ = VoStatus::kTracking;
  interruption_.end();
  if (mapping_.needsKeyframe(motion_.T_w_c(), frame->found)) {
    addKeyframe(frame);
  } else {
    tracking_.advanceUnlessStandstill(std::move(frame->image), frame->stamp_ns, frame->found);
  }
  return frame->found;
}

/// Tracks the features of the previous image, and aligns them to the patches of the keyframes.
/// relocalised: predicts the pose of the image instead of the motion model, and supplies features
/// that cannot be tracked; may be null.
void VisualOdometry::Impl::findFeatures(const RelocalisedPose* relocalised, Frame* frame) {
  const std::int64_t stamp_ns = frame->stamp_ns;
  StageTimes& times = frame->times;
  const auto predict = [&] { return relocalised ? relocalised->T_w_c : motion_.predict(stamp_ns); };
  frame->outliers.clear();  // of an attempt from another predicted pose
  {
    ScopedTimer timer(&times.track);
    const Eigen::Isometry3d T_w_previous = motion_.T_w_c();
    const Eigen::Isometry3d predicted = predict();
    frame->found = tracking_.track(
        frame->image, stamp_ns,
        predictPixels(camera_, mapping_.map(), tracking_.features(), T_w_previous, predicted),
        predicted.linear().transpose() * T_w_previous.linear());
  }
  if (relocalised) {
    const std::vector<Feature> tracked = std::move(frame->found);
    frame->found.clear();
    std::set_union(tracked.begin(), tracked.end(), relocalised->features.begin(),
                   relocalised->features.end(), std::back_inserter(frame->found), hasLowerId);
  }
  {
    ScopedTimer timer(&times.adjustment_wait);
    const auto correction = mapping_.applyAdjustment(&times.bundle_adjustment);
    if (correction) motion_.correct(*correction);
  }
  ScopedTimer timer(&times.align);
  reference_alignment_.align(mapping_.map(), frame->image, predict(), &frame->found);
}

/// Estimates the pose and removes the outliers. Returns false, without a new pose, when there is
/// none.
bool VisualOdometry::Impl::localise(const Eigen::Isometry3d& predicted_T_w_c, Frame* frame) {
  ScopedTimer timer(&frame->times.pose);
  const std::int64_t stamp_ns = frame->stamp_ns;
  std::vector<std::size_t> index;  // indices of the observed features in `found`
  const auto estimate = [&](const Eigen::Isometry3d& initial) {
    index.clear();
    return estimatePose(
        initial, pointObservations(mapping_.map(), observationsOf(camera_, frame->found), &index));
  };
  PoseEstimate pose = estimate(predicted_T_w_c);
  if (!pose.ok) return false;
  if (options_.readout_time > 0) {  // so far with the shifts of the previous image
    MotionModel moved = motion_;
    moved.update({stamp_ns, pose.T_w_c});
    shiftToStamp(moved, &frame->found);
    pose = estimate(pose.T_w_c);
    if (!pose.ok) return false;
  }

  const Eigen::Isometry3d T_w_previous = motion_.T_w_c();
  motion_.update({stamp_ns, pose.T_w_c});
  pose_covariance_ = pose.covariance;
  std::vector<bool> inlier(frame->found.size(), true);
  for (std::size_t k = 0; k < index.size(); ++k) inlier[index[k]] = pose.inlier[k];
  rejectOutliers(motion_.T_w_c().inverse() * T_w_previous, inlier, frame);
  return true;
}

/// Removes features that were outliers of the pose in too many consecutive frames, and features
/// without a map point that are off their epipolar line.
void VisualOdometry::Impl::rejectOutliers(const Eigen::Isometry3d& T_c_previous,
                                          const std::vector<bool>& inlier, Frame* frame) {
  const std::vector<Feature> previous = entriesOf(frame->found, tracking_.features());
  std::size_t next = 0;
  const auto isOutlier = [&](const Feature& feature) {
    const std::size_t i = next++;
    Landmark* const landmark = mapping_.map().find(feature.id);
    if (!landmark || !landmark->depth) {
      return !(epipolarError(T_c_previous, camera_.ray(previous[i].atStamp()),
                             camera_.ray(feature.atStamp())) < kMaxEpipolarError);
    }
    landmark->outlier_count = inlier[i] ? 0 : landmark->outlier_count + 1;
    return landmark->outlier_count > kMaxOutlierFrames;
  };
  rejectFeatures(isOutlier, &frame->found, &frame->outliers);
}

/// The factor of the focal length since the previous image, which no motion explains: from there no
/// pose was found. By tracking without a prediction, or for a large factor by descriptors.
std::optional<double> VisualOdometry::Impl::zoomOf(const Frame& frame) const {
  const std::vector<Feature>& features = tracking_.features();
  const Eigen::Isometry3d T_c_w = motion_.predict(frame.stamp_ns).inverse();
  std::vector<PredictedPoint> points;
  const auto add = [&](const Feature& feature, const Eigen::Vector2d& seen) {
    const auto point = mapping_.map().point(feature.id);
    const Eigen::Vector3d p_c =
        point ? Eigen::Vector3d(T_c_w * point->p_w) : Eigen::Vector3d(0, 0, 0);
    if (p_c.z() > 0) points.push_back({camera_.project(p_c), seen, p_c.z()});
  };
  for (const Feature& feature :
       tracking_.track(frame.image, frame.stamp_ns, {}, Eigen::Matrix3d::Identity())) {
    add(feature, feature.u);
  }
  if (const auto zoom = zoomBetween(camera_, points)) return zoom;
  points.clear();
  const Descriptors corners = tracking_.describeCorners(frame.image);
  for (const DescriptorMatch& match : matchDescriptors(tracking_.describeFeatures(), corners)) {
    const cv::Point2f& u = corners.points()[match.to];
    add(features[match.from], Eigen::Vector2d(u.x, u.y));
  }
  return zoomBetween(camera_, points);
}

/// The map ends: its points and this image have different focal lengths.
void VisualOdometry::Impl::startZoomedMap(double zoom, Frame* frame) {
  zoom_ *= zoom;
  if (std::max(zoom_, 1 / zoom_) < kMinTotalZoom) zoom_ = 1;
  const Eigen::Isometry3d predicted = motion_.predict(frame->stamp_ns);
  rotation_to_start_ = {predicted.linear().transpose() * motion_.T_w_c().linear(),
                        kZoomRotationSigma};
  startNextMap(frame);
}

/// Finds the pose of an image in which tracking has failed, by descriptors or by a search. Returns
/// false when there is none; after several images with texture a new map starts.
bool VisualOdometry::Impl::relocalise(Frame* frame) {
  const std::int64_t stamp_ns = frame->stamp_ns;
  const Descriptors previous = tracking_.describeFeatures();
  Descriptors corners = tracking_.describeCorners(frame->image);
  auto pose = locateByDescriptors(camera_, mapping_.map(), motion_, tracking_.features(), previous,
                                  corners, stamp_ns);
  if (pose && trackFrom(*pose, frame)) return true;
  status_ = VoStatus::kLost;
  if (tracking_.isTextureless(frame->image, frame->found.size())) return false;
  pose.reset();
  // While images follow each other, features that disagree with a pose are evidence against it.
  // The search ignores them: behind a car that moves along, it would find a pose without motion.
  if (motion_.stepsSince(stamp_ns) - interruption_.images() > kMaxMissingImages) {
    pose = locateBySearch(camera_, mask_, mapping_.map(), motion_, tracking_.features(),
                          tracking_.image().image, frame->image.image, stamp_ns);
  }
  if (pose && trackFrom(*pose, frame)) return true;
  const RelativeRotation rotation =
      pose ? RelativeRotation{pose->T_w_c.linear().transpose() * motion_.T_w_c().linear(),
                              pose->rotation_sigma}
           : interruption_.rotationBetween(previous, corners);
  interruption_.addImage(rotation, std::move(corners));
  if (interruption_.images() < kLostImagesBeforeNewMap) return false;
  rotation_to_start_ = interruption_.rotation();
  interruption_.end();
  startNextMap(frame);
  return false;
}

/// From rotation_to_start_ on.
void VisualOdometry::Impl::startNextMap(Frame* frame) {
  ++map_id_;
  continuity_ = Continuity::kNewMap;
  restart(frame);
}

/// Tracks the features again from the pose found. Most of those that are tracked over a long
/// interruption are wrong, so the pose is estimated from those that are consistent with it.
bool VisualOdometry::Impl::trackFrom(const RelocalisedPose& pose, Frame* frame) {
  findFeatures(&pose, frame);
  rejectInconsistent(pose.T_w_c, frame);
  return localise(pose.T_w_c, frame);
}

/// Removes the features that are not at the projections of their map points.
void VisualOdometry::Impl::rejectInconsistent(const Eigen::Isometry3d& T_w_c, Frame* frame) const {
  const Eigen::Isometry3d T_c_w = T_w_c.inverse();
  const auto isInconsistent = [&](const Feature& feature) {
    const auto point = mapping_.map().point(feature.id);
    return point &&
           !(reprojectionError(T_c_w * point->p_w, camera_.ray(feature.atStamp()).head<2>()) <
             kMaxInconsistency * kMaxAdjustedError);
  };
  rejectFeatures(isInconsistent, &frame->found, &frame->outliers);
}

void VisualOdometry::Impl::addKeyframe(Frame* frame) {
  frame->keyframe = true;
  tracking_.advance(std::move(frame->image), frame->stamp_ns, frame->found);
  {
    ScopedTimer timer(&frame->times.detect);
    tracking_.detectNew();
    shiftToStamp(motion_, &tracking_.features());
  }
  ScopedTimer timer(&frame->times.triangulate);
  mapping_.addKeyframe(motion_.T_w_c(), tracking_.features(), tracking_.image(),
                       readoutMotion(motion_));
}

// --- Both --------------------------------------------------------------------------------------

/// Sets Feature::to_stamp. moved: the pose and the velocity of their image.
void VisualOdometry::Impl::shiftToStamp(const MotionModel& moved,
                                        std::vector<Feature>* features) const {
  if (options_.readout_time == 0) return;
  shiftFeatures(camera_, mapping_.map(), moved.T_w_c(), readoutMotion(moved),
                kRotationRateSigma * options_.readout_time * moved.rotationRateChange(), features);
}

VoFrame VisualOdometry::Impl::toVoFrame(const Frame& frame,
                                        const std::vector<Feature>& visible) const {
  VoFrame result;
  result.stamp_ns = frame.stamp_ns;
  result.sequence = sequence_;
  result.status = status_;
  result.map_id = map_id_;
  result.continuity = continuity_;
  result.keyframe = frame.keyframe;
  result.camera = camera_;
  result.zoom = zoom_;
  if (status_ != VoStatus::kInitialising) result.map_start = map_start_;
  if (status_ == VoStatus::kTracking) {
    result.pose_covariance = pose_covariance_;
    result.T_w_c = motion_.T_w_c();
    result.readout_motion = readoutMotion(motion_);
  }
  const Eigen::Isometry3d T_c_w = motion_.T_w_c().inverse();
  result.features.reserve(visible.size());
  for (const Feature& feature : visible) {
    TrackedFeature tracked;
    tracked.id = feature.id;
    tracked.age = feature.age;
    tracked.u = feature.atStamp().cast<float>();
    if (const auto point = mapping_.map().point(feature.id)) {
      TrackedFeature with_point = tracked;
      with_point.has_point = true;
      with_point.p_c = (T_c_w * point->p_w).cast<float>();
      with_point.depth_sigma = static_cast<float>(std::abs((T_c_w.linear() * point->sigma_w).z()));
      if (hasUsablePoint(with_point)) tracked = with_point;
    }
    result.features.push_back(tracked);
  }
  return result;
}

VisualOdometry::VisualOdometry(const PinholeCamera& camera, const Options& options,
                               const cv::Mat& mask)
    : impl_(std::make_unique<Impl>(camera, options, mask)) {}

VisualOdometry::~VisualOdometry() = default;

VisualOdometry::Output VisualOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  return impl_->process(image, stamp_ns);
}

}  // namespace gsv
