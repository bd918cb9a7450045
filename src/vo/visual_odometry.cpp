#include "ground_scale_vo/vo/visual_odometry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <optional>
#include <unordered_map>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/vo/exposure.hpp"

namespace ground_scale_vo {
namespace {

/// A motion is foretold for so many times the time in which it was seen. A velocity over two stamps
/// that lie closer than their images tells nothing of the next one; and after a longer blind time
/// the car ahead and the horizon, which look as before, would fit a pose somewhere on the way
/// foretold.
constexpr double kMaxPredictedSteps = 12;
constexpr std::size_t kMinTexture = 60;  // corners of an image that is not blind
constexpr std::size_t kMinStartMatches = 100;
constexpr std::size_t kMaxStartFrames = 3000;
constexpr double kSurelyTheSame =
    0.95;  // correlation of patches; below it other surfaces are tried

cv::Point2f toCv(const Eigen::Vector2d& u) {
  return {static_cast<float>(u.x()), static_cast<float>(u.y())};
}

/// Adds the time from construction to destruction to *ms.
class Timer {
 public:
  explicit Timer(double* ms) : ms_(ms) {}
  ~Timer() { *ms_ += watch_.ms(); }
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

 private:
  double* ms_;
  const Stopwatch watch_;
};

/// Median inverse depth of the known points around a pixel: a guess for corners that lack one.
class InverseDepthGuess {
 public:
  InverseDepthGuess(int width, int height) : width_(width), height_(height) {}

  void add(const Eigen::Vector2d& u, double inverse_depth) {
    known_[cell(u)].push_back(inverse_depth);
    all_.push_back(inverse_depth);
  }
  void finish() {
    for (std::size_t i = 0; i < known_.size(); ++i) {
      if (known_[i].size() >= 3) guess_[i] = median(known_[i]);
    }
    if (!all_.empty()) overall_ = median(all_);
  }
  double at(const Eigen::Vector2d& u) const { return guess_[cell(u)].value_or(overall_); }

 private:
  static constexpr int kColumns = 16, kRows = 8;
  std::size_t cell(const Eigen::Vector2d& u) const {
    const int column = std::clamp(static_cast<int>(u.x() * kColumns / width_), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(u.y() * kRows / height_), 0, kRows - 1);
    return static_cast<std::size_t>(row * kColumns + column);
  }
  int width_, height_;
  std::array<std::vector<double>, kColumns * kRows> known_;
  std::array<std::optional<double>, kColumns * kRows> guess_;
  std::vector<double> all_;
  double overall_ = 0;
};

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
  struct Feature {
    std::uint64_t id = 0;
    std::uint32_t age = 0;
    Eigen::Vector2d u = Eigen::Vector2d::Zero();     // in the tracking image
    Eigen::Vector2d flow = Eigen::Vector2d::Zero();  // of the last step, per second
    double sigma = 0;                                // of u, normalised coordinates
    PatchSurface surface = PatchSurface::kFacing;    // what fitted last
  };

  /// A frame between the first of a map to be and the one that starts it.
  struct StartFrame {
    std::uint32_t sequence = 0;
    std::int64_t stamp_ns = 0;
    std::vector<LocalMap::Corner> corners;
    cv::Mat image;  // of the first one only
  };

  Impl(const PinholeCamera& camera_in, const Options& options_in)
      : options((options_in.validate(), options_in)),
        camera((camera_in.validate(), camera_in)),
        tracker(options.tracker),
        two_view(options.two_view),
        alignment(options.alignment),
        pose_estimation(options.pose),
        bundle_adjustment(options.bundle_adjustment),
        map(options.map) {}

  const Options options;
  const PinholeCamera camera;
  const FeatureTracker tracker;
  const TwoView two_view;
  const PatchAlignment alignment;
  const PoseEstimation pose_estimation;
  LocalBundleAdjustment bundle_adjustment;

  VoStatus status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;
  std::uint32_t next_sequence = 0;
  std::uint64_t next_feature_id = 0;

  // The tracking image: the last one that was tracked, or an earlier one while nothing moves.
  ImagePyramid from;
  std::int64_t from_stamp_ns = 0;
  std::vector<Feature> features;  // by id

  LocalMap map;
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  // of the last tracked frame
  std::int64_t pose_stamp_ns = 0;
  Vector6d velocity = Vector6d::Zero();  // w, v in c, per second
  double velocity_dt = 0;                // [s] over which it was measured
  int lost_frames = 0;

  std::vector<StartFrame> start_frames;  // the first is the reference

  Eigen::Vector2d normalised(const Eigen::Vector2d& u) const { return camera.ray(u).head<2>(); }

  /// The smallest image of a pyramid; every other one is a gradient.
  static const cv::Mat& top(const ImagePyramid& pyramid) {
    return pyramid.levels[(pyramid.levels.size() - 1) / 2 * 2];
  }

  // --- tracking -------------------------------------------------------------------------------

  Eigen::Isometry3d predictPose(std::int64_t stamp_ns) const {
    const double dt = std::min(static_cast<double>(stamp_ns - pose_stamp_ns) * 1e-9,
                               kMaxPredictedSteps * velocity_dt);
    return boxplus(T_w_c, velocity * dt);
  }

  /// Where each feature should appear: its point under the predicted pose, or for a corner without
  /// a point a guess of its depth from its neighbours'.
  std::vector<cv::Point2f> predictPixels(const Eigen::Isometry3d& predicted_T_w_c) const {
    const Eigen::Isometry3d T_from_w = T_w_c.inverse();
    const Eigen::Isometry3d T_to_w = predicted_T_w_c.inverse();
    const Eigen::Isometry3d T_to_from = T_to_w * T_w_c;
    std::vector<std::optional<Eigen::Vector3d>> points;
    InverseDepthGuess guess(camera.width, camera.height);
    for (const Feature& feature : features) {
      const auto world = map.point(feature.id);
      points.emplace_back();
      if (!world) continue;
      points.back() = world->p_w;
      const double z = (T_from_w * world->p_w).z();
      if (z > 0) guess.add(feature.u, 1 / z);
    }
    guess.finish();
    std::vector<cv::Point2f> predicted;
    for (std::size_t i = 0; i < features.size(); ++i) {
      const Eigen::Vector3d p =
          points[i] ? Eigen::Vector3d(T_to_w * *points[i])
                    : Eigen::Vector3d(T_to_from.linear() * camera.ray(features[i].u) +
                                      guess.at(features[i].u) * T_to_from.translation());
      const Eigen::Vector2d u = p.z() > 1e-3 ? camera.project(p) : features[i].u;
      predicted.push_back(toCv(u));
    }
    return predicted;
  }

  std::vector<cv::Point2f> predictPixelsByFlow(double dt) const {
    std::vector<cv::Point2f> predicted;
    for (const Feature& feature : features)
      predicted.push_back(toCv(feature.u + dt * feature.flow));
    return predicted;
  }

  /// The features that were found, at their new pixels. R_to_from: predicted rotation. What moves
  /// beyond it comes nearer and changes its size, and is found less well. What is not found joins
  /// `rejected`.
  std::vector<Feature> trackFeatures(const ImagePyramid& to, double dt,
                                     const std::vector<cv::Point2f>& predicted,
                                     const Eigen::Matrix3d& R_to_from,
                                     std::vector<RejectedFeature>* rejected) const {
    std::vector<cv::Point2f> points;
    for (const Feature& feature : features) points.push_back(toCv(feature.u));
    const double step = to.exposure / from.exposure;
    const FeatureTracker::Tracks tracks =
        step == 1
            ? tracker.track(from, to, points, predicted)
            : tracker.track(tracker.pyramid(applyGain(from.image, step)), to, points, predicted);
    std::vector<Feature> found;
    for (std::size_t i = 0; i < features.size(); ++i) {
      if (!tracks.ok[i]) {
        rejected->push_back({features[i].id, features[i].u.cast<float>(), RejectReason::kNotFound});
        continue;
      }
      Feature feature = features[i];
      feature.age += 1;
      feature.u = Eigen::Vector2d(tracks.points[i].x, tracks.points[i].y);
      feature.flow =
          dt > 0 ? Eigen::Vector2d((feature.u - features[i].u) / dt) : Eigen::Vector2d::Zero();
      const Eigen::Vector3d turned = R_to_from * camera.ray(features[i].u);
      const double moved = (normalised(feature.u) - turned.head<2>() / turned.z()).norm();
      feature.sigma = options.noise * std::hypot(1.0, moved / options.noise_flow);
      found.push_back(feature);
    }
    return found;
  }

  /// Where a landmark was seen first at about the size that it should have now.
  struct Reference {
    const Keyframe* keyframe;
    Eigen::Vector2d u;    // [px]
    Eigen::Vector3d p_r;  // in the keyframe's camera
  };
  std::optional<Reference> reference(const Landmark& landmark, const Eigen::Vector3d& p_w,
                                     double z) const {
    for (const Observation& o : landmark.observations) {
      const Keyframe& keyframe = map.keyframe(o.keyframe);
      const Eigen::Vector3d p_r = keyframe.T_w_c.inverse() * p_w;
      const double scale = p_r.z() / z, limit = alignment.options().max_scale;
      if (keyframe.image.empty() || scale > limit || scale < 1 / limit) continue;
      return Reference{&keyframe, camera.project(o.x.homogeneous()), p_r};
    }
    return std::nullopt;
  }

  /// A keyframe's image, as bright as the one that is aligned to it.
  struct ReferenceImage {
    cv::Mat original;
    double factor;
    cv::Mat image;
  };
  std::vector<ReferenceImage> references;  // of the map's keyframes, in their order

  /// Only what has changed since the last call is made anew.
  void updateReferences(double exposure) {
    std::vector<ReferenceImage> now;
    for (const Keyframe& keyframe : map.keyframes()) {
      const double factor = exposure / keyframe.exposure;
      const auto known = std::find_if(references.begin(), references.end(), [&](const auto& r) {
        return r.original.data == keyframe.image.data && r.factor == factor;
      });
      now.push_back(known != references.end() ? *known
                                              : ReferenceImage{keyframe.image, factor,
                                                               applyGain(keyframe.image, factor)});
    }
    references = std::move(now);
  }

  /// Moves features with a point from where tracking has drifted to, to where their first patch
  /// is. The others stay, with their larger sigma.
  void align(const ImagePyramid& to, const Eigen::Isometry3d& predicted_T_w_c,
             std::vector<Feature>* found) {
    const Eigen::Isometry3d T_c_w = predicted_T_w_c.inverse();
    updateReferences(to.exposure);
    for (Feature& feature : *found) {
      const auto it = map.landmarks().find(feature.id);
      if (it == map.landmarks().end()) continue;
      const auto world = map.point(it->second);
      if (!world) continue;
      const double z = (T_c_w * world->p_w).z();
      const auto ref = z > 0 ? reference(it->second, world->p_w, z) : std::nullopt;
      if (!ref) continue;

      const Eigen::Isometry3d T_c_r = T_c_w * ref->keyframe->T_w_c;
      const cv::Mat& reference = references[ref->keyframe->id - map.keyframes().front().id].image;
      std::optional<PatchAlignment::Match> best;
      PatchSurface best_surface = feature.surface;
      const auto attempt = [&](PatchSurface surface) {
        const auto warp = patchWarp(camera, ref->p_r, T_c_r, surface);
        if (!warp) return;
        const auto match = alignment.align(reference, ref->u, *warp, to.image, feature.u);
        if (!match || (best && best->correlation >= match->correlation)) return;
        best = match;
        best_surface = surface;
      };
      attempt(feature.surface);
      if (!best || best->correlation < kSurelyTheSame) {
        for (const auto surface :
             {PatchSurface::kFacing, PatchSurface::kFloor, PatchSurface::kWall}) {
          if (surface != feature.surface) attempt(surface);
        }
      }
      if (!best) continue;
      feature.u = best->u;
      feature.sigma = options.noise_aligned;
      feature.surface = best_surface;
    }
  }

  /// Median length of what `found` moved since the tracking image [px].
  double medianFlow(const std::vector<Feature>& found) const {
    std::vector<double> flow;
    auto old = features.begin();
    for (const Feature& feature : found) {
      while (old->id != feature.id) ++old;
      flow.push_back((feature.u - old->u).norm());
    }
    return flow.empty() ? 0 : median(flow);
  }

  /// `found` becomes what the next image is tracked from, unless nothing has moved: an image that
  /// is kept through a standstill lets no drift in.
  void advance(ImagePyramid to, std::int64_t stamp_ns, std::vector<Feature> found) {
    if (medianFlow(found) < options.standstill_flow * camera.width &&
        found.size() > features.size() * 9 / 10) {
      return;
    }
    from = std::move(to);
    from_stamp_ns = stamp_ns;
    features = std::move(found);
  }

  /// Fills the tracking image up with new corners.
  void detect() {
    std::vector<cv::Point2f> occupied;
    for (const Feature& feature : features) occupied.push_back(toCv(feature.u));
    for (const cv::Point2f& corner : tracker.detect(from.image, occupied)) {
      Feature feature;
      feature.id = next_feature_id++;
      feature.sigma = options.noise;
      feature.u = Eigen::Vector2d(corner.x, corner.y);
      features.push_back(feature);
    }
  }

  std::vector<LocalMap::Corner> corners(const std::vector<Feature>& of) const {
    std::vector<LocalMap::Corner> result;
    result.reserve(of.size());
    for (const Feature& feature : of)
      result.push_back({feature.id, normalised(feature.u), feature.sigma});
    return result;
  }

  // --- starting a map -------------------------------------------------------------------------

  void restart(ImagePyramid image, std::int64_t stamp_ns, std::uint32_t sequence) {
    status = VoStatus::kInitialising;
    map.clear();
    start_frames.clear();
    features.clear();
    from = std::move(image);
    from.exposure = 1;
    from_stamp_ns = stamp_ns;
    detect();
    start_frames.push_back({sequence, stamp_ns, corners(features), from.image});
    velocity.setZero();
  }

  std::vector<Feature> initialise(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    const double dt = static_cast<double>(stamp_ns - from_stamp_ns) * 1e-9;
    std::vector<Feature> found;
    {
      Timer timer(&out->times.track);
      if (!features.empty())
        found = trackFeatures(image, dt, predictPixelsByFlow(dt), Eigen::Matrix3d::Identity(),
                              &out->rejected);
    }
    const std::size_t first = start_frames.empty() ? 0 : start_frames.front().corners.size();
    if (found.size() < kMinStartMatches ||
        static_cast<double>(found.size()) < options.start_min_share * static_cast<double>(first) ||
        start_frames.size() > kMaxStartFrames) {
      Timer timer(&out->times.detect);
      restart(std::move(image), stamp_ns, out->frame.sequence);
      return features;
    }
    start_frames.push_back({out->frame.sequence, stamp_ns, corners(found), {}});

    Timer timer(&out->times.pose);
    std::vector<Eigen::Vector2d> u1, u2;
    auto reference = start_frames.front().corners.begin();
    for (const Feature& feature : found) {
      while (reference->id != feature.id) ++reference;
      u1.push_back(camera.project(reference->x.homogeneous()));
      u2.push_back(feature.u);
    }
    const TwoView::Result motion = two_view.estimate(camera, u1, u2);
    if (motion.status == TwoViewStatus::kOk && startMap(found, motion, image, out)) {
      status = VoStatus::kTracking;
      pose_stamp_ns = stamp_ns;
      lost_frames = 0;
      from = std::move(image);
      from_stamp_ns = stamp_ns;
      features = found;
      detect();
    } else {
      advance(std::move(image), stamp_ns, found);
    }
    return found;
  }

  /// False, with an empty map, when the points do not hold after all.
  bool startMap(const std::vector<Feature>& found, const TwoView::Result& motion,
                const ImagePyramid& image, Output* out) {
    std::vector<double> depths;
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (motion.inlier[i]) depths.push_back(1 / motion.inverse_depth_1[i]);
    }
    if (depths.size() < kMinStartMatches / 2) return false;
    // The unit of length: the median depth in the first frame.
    const double unit = median(depths);
    Eigen::Isometry3d T_1_2 = motion.T_2_1.inverse();
    T_1_2.translation() /= unit;

    map.clear();
    const auto& first = start_frames.front().corners;
    std::vector<LocalMap::Corner> first_corners;  // of those that are still tracked
    auto reference = first.begin();
    for (const Feature& feature : found) {
      while (reference->id != feature.id) ++reference;
      first_corners.push_back(*reference);
    }
    map.addKeyframe(Eigen::Isometry3d::Identity(), first_corners, start_frames.front().image);
    map.addKeyframe(T_1_2, corners(found), image.image);
    map.keyframes().back().exposure = image.exposure;
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (!motion.inlier[i]) continue;
      const double inverse_depth = motion.inverse_depth_1[i] * unit;
      map.find(found[i].id)->depth = InverseDepth{inverse_depth, inverse_depth};
    }
    bundle_adjustment.load(map);
    const auto adjusted = bundle_adjustment.solve();
    storeAdjusted();
    T_w_c = map.keyframes().back().T_w_c;

    // The frames on the way, by their points.
    std::vector<StartPose> poses;
    Eigen::Isometry3d guess = Eigen::Isometry3d::Identity();
    for (const StartFrame& frame : start_frames) {
      const auto estimate = pose_estimation.estimate(guess, observations(frame.corners));
      if (estimate.status != PoseStatus::kOk) {
        map.clear();
        return false;
      }
      guess = estimate.T_w_c;
      poses.push_back({frame.sequence, guess});
    }
    if (!adjusted.usable) {
      map.clear();
      return false;
    }
    poses.front().T_w_c = Eigen::Isometry3d::Identity();
    poses.back().T_w_c = T_w_c;
    const std::size_t n = poses.size();
    setVelocity(
        poses[n - 2].T_w_c.inverse() * T_w_c,
        static_cast<double>(start_frames[n - 1].stamp_ns - start_frames[n - 2].stamp_ns) * 1e-9);
    out->start = std::move(poses);
    out->frame.keyframe = true;
    start_frames.clear();
    return true;
  }

  std::vector<PointObservation> observations(const std::vector<LocalMap::Corner>& of) const {
    std::vector<PointObservation> result;
    for (const LocalMap::Corner& corner : of) {
      if (const auto world = map.point(corner.id)) {
        result.push_back({world->p_w, world->sigma_w, corner.x, corner.sigma});
      }
    }
    return result;
  }

  // --- following the map ----------------------------------------------------------------------

  std::vector<Feature> follow(ImagePyramid image, std::int64_t stamp_ns, Output* out) {
    const double dt = static_cast<double>(stamp_ns - from_stamp_ns) * 1e-9;
    std::vector<Feature> found;
    {
      Timer timer(&out->times.track);
      const Eigen::Isometry3d predicted = predictPose(stamp_ns);
      found = trackFeatures(image, dt, predictPixels(predicted),
                            predicted.linear().transpose() * T_w_c.linear(), &out->rejected);
    }
    takeAdjustedMap(&out->times);
    {
      Timer timer(&out->times.align);
      align(image, predictPose(stamp_ns), &found);
    }
    PoseEstimation::Result pose;
    {
      Timer timer(&out->times.pose);
      const Eigen::Isometry3d T_w_from = T_w_c;
      const std::vector<LocalMap::Corner> seen = corners(found);
      std::vector<PointObservation> observed;
      std::vector<std::size_t> index;  // of the feature
      for (std::size_t i = 0; i < seen.size(); ++i) {
        if (const auto world = map.point(seen[i].id)) {
          observed.push_back({world->p_w, world->sigma_w, seen[i].x, seen[i].sigma});
          index.push_back(i);
        }
      }
      pose = pose_estimation.estimate(predictPose(stamp_ns), observed);
      if (pose.status == PoseStatus::kOk) {
        setPose(pose.T_w_c, stamp_ns);
        std::vector<bool> agrees(found.size(), true);
        for (std::size_t k = 0; k < index.size(); ++k) agrees[index[k]] = pose.inlier[k];
        dropDisagreeing(T_w_from, agrees, &found, &out->rejected);
      }
    }
    if (pose.status != PoseStatus::kOk) {
      lose(std::move(image), stamp_ns, found.size(), out);
      return {};
    }
    status = VoStatus::kTracking;
    lost_frames = 0;

    std::vector<Feature> visible = found;
    if (isKeyframe(found)) {
      out->frame.keyframe = true;
      addKeyframe(std::move(image), stamp_ns, std::move(found), out);
    } else {
      advance(std::move(image), stamp_ns, std::move(found));
    }
    return visible;
  }

  void setPose(const Eigen::Isometry3d& now_T_w_c, std::int64_t stamp_ns) {
    const double dt = static_cast<double>(stamp_ns - pose_stamp_ns) * 1e-9;
    const Eigen::Isometry3d step = T_w_c.inverse() * now_T_w_c;
    setVelocity(step, dt);
    T_w_c = now_T_w_c;
    pose_stamp_ns = stamp_ns;
  }

  void setVelocity(const Eigen::Isometry3d& step, double dt) {
    if (dt <= 0) return;
    velocity_dt = dt;
    const Eigen::AngleAxisd rotation(step.linear());
    velocity << rotation.angle() / dt * rotation.axis(), step.translation() / dt;
  }

  /// Features without a point must at least lie on their epipolar line.
  void dropDisagreeing(const Eigen::Isometry3d& T_w_from, const std::vector<bool>& agrees,
                       std::vector<Feature>* found, std::vector<RejectedFeature>* rejected) {
    const Eigen::Isometry3d T_to_from = T_w_c.inverse() * T_w_from;
    std::vector<Feature> kept;
    auto old = features.begin();
    for (std::size_t i = 0; i < found->size(); ++i) {
      const Feature& feature = (*found)[i];
      while (old->id != feature.id) ++old;
      Landmark* landmark = map.find(feature.id);
      bool keep;
      if (landmark && landmark->depth) {
        landmark->outlier_count = agrees[i] ? 0 : landmark->outlier_count + 1;
        keep = landmark->outlier_count <= options.max_outlier_frames;
      } else {
        keep = epipolarError(T_to_from, camera.ray(old->u), camera.ray(feature.u)) <
               options.epipolar_error;
      }
      if (keep) {
        kept.push_back(feature);
      } else {
        rejected->push_back({feature.id, feature.u.cast<float>(), RejectReason::kOutlier});
      }
    }
    *found = std::move(kept);
  }

  static double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                              const Eigen::Vector3d& ray_2) {
    const Eigen::Vector3d line = T_2_1.translation().cross(T_2_1.linear() * ray_1);
    const double norm = line.head<2>().norm();
    return norm > 1e-12 ? std::abs(line.dot(ray_2)) / norm : 0;
  }

  bool isKeyframe(const std::vector<Feature>& found) const {
    const Keyframe& last = map.keyframes().back();
    const Eigen::Matrix3d R_c_k = T_w_c.linear().transpose() * last.T_w_c.linear();
    std::vector<double> parallax;
    for (const Feature& feature : found) {
      const auto it = map.landmarks().find(feature.id);
      if (it == map.landmarks().end() || it->second.observations.back().keyframe != last.id)
        continue;
      const Eigen::Vector3d turned = R_c_k * it->second.observations.back().x.homogeneous();
      const Eigen::Vector3d seen = camera.ray(feature.u);
      parallax.push_back(std::atan2(turned.cross(seen).norm(), turned.dot(seen)));
    }
    if (parallax.empty()) return true;
    if (median(parallax) > options.keyframe_parallax) return true;
    return static_cast<double>(parallax.size()) <
           options.keyframe_min_tracked * static_cast<double>(keyframe_features);
  }
  std::size_t keyframe_features = 0;  // tracked when the last keyframe was made, new ones included

  void addKeyframe(ImagePyramid image, std::int64_t stamp_ns, std::vector<Feature> found,
                   Output* out) {
    from = std::move(image);
    from_stamp_ns = stamp_ns;
    features = std::move(found);
    {
      Timer timer(&out->times.detect);
      detect();
    }
    keyframe_features = features.size();
    map.addKeyframe(T_w_c, corners(features), from.image);
    map.keyframes().back().exposure = from.exposure;
    {
      Timer timer(&out->times.triangulate);
      map.triangulateNew();
    }
    // The odometry goes on with the map as it is and takes the adjusted one at a fixed point of the
    // next frame, however long it took: the result does not depend on the machine's speed.
    bundle_adjustment.load(map);
    adjusting = std::async(std::launch::async, [this] {
      double ms = 0;
      {
        Timer timer(&ms);
        bundle_adjustment.solve();
      }
      return ms;
    });
  }

  void storeAdjusted() {
    bundle_adjustment.store(&map);
    map.removeOutliers(options.outlier_error);
    map.updateSigmas();
  }

  /// Waits for the bundle adjustment under way, if any, and goes on with the adjusted map.
  void takeAdjustedMap(Times* times) {
    if (!adjusting.valid()) return;
    Timer timer(&times->adjustment_wait);
    times->bundle_adjustment = adjusting.get();
    const Eigen::Isometry3d before = map.keyframes().back().T_w_c;
    storeAdjusted();
    T_w_c = map.keyframes().back().T_w_c * before.inverse() * T_w_c;
  }
  std::future<double> adjusting;  // [ms] that it took

  void lose(ImagePyramid image, std::int64_t stamp_ns, std::size_t found, Output* out) {
    status = VoStatus::kLost;
    const bool blind = found < kMinTexture && tracker.detect(image.image, {}).size() < kMinTexture;
    if (!blind) ++lost_frames;
    if (lost_frames < options.lost_frames_before_new_map) return;
    lost_frames = 0;
    ++map_id;
    restart(std::move(image), stamp_ns, out->frame.sequence);
    status = VoStatus::kInitialising;
  }

  // --------------------------------------------------------------------------------------------

  Output process(const cv::Mat& image, std::int64_t stamp_ns) {
    requireImage(image, camera);
    Output out;
    {
      Timer total(&out.times.total);
      out.frame.stamp_ns = stamp_ns;
      out.frame.sequence = next_sequence++;
      out.frame.camera = camera;
      ImagePyramid pyramid;
      {
        Timer timer(&out.times.pyramid);
        pyramid = tracker.pyramid(image);
        if (!from.levels.empty()) {
          pyramid.exposure = from.exposure * exposureStep(top(from), top(pyramid));
        }
      }
      const std::vector<Feature> visible = status == VoStatus::kInitialising
                                               ? initialise(std::move(pyramid), stamp_ns, &out)
                                               : follow(std::move(pyramid), stamp_ns, &out);
      fill(visible, &out.frame);
    }
    return out;
  }

  void fill(const std::vector<Feature>& visible, VoFrame* frame) const {
    frame->status = status;
    frame->map_id = map_id;
    if (status == VoStatus::kTracking) frame->T_w_c = T_w_c;
    const Eigen::Isometry3d T_c_w = T_w_c.inverse();
    for (const Feature& feature : visible) {
      TrackedFeature tracked;
      tracked.id = feature.id;
      tracked.age = feature.age;
      tracked.u = feature.u.cast<float>();
      if (const auto world = map.point(feature.id)) {
        TrackedFeature with_point = tracked;
        with_point.has_point = true;
        with_point.p_c = (T_c_w * world->p_w).cast<float>();
        with_point.depth_sigma =
            static_cast<float>(std::abs((T_c_w.linear() * world->sigma_w).z()));
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
