#include "ground_scale_vo/scale/scale_recovery.hpp"

#include <algorithm>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/scale/camera_path.hpp"
#include "ground_scale_vo/scale/lane_region.hpp"
#include "ground_scale_vo/scale/paper_preset.hpp"

namespace ground_scale_vo {
namespace {

/// Consecutive implausible poses after which the odometry is taken to have started a new map.
constexpr int kMaxRefusedPoses = 3;

/// [s] minimum interval of a speed: images that arrive in pairs may have nearly equal stamps.
constexpr double kMinSpeedInterval = 0.2;

}  // namespace

ScaleRecovery::Options ScaleRecovery::Options::resolved() const {
  Options result = paper_literal ? paperPreset(*this) : *this;
  result.gpe.random_seed = random_seed;
  return result;
}

void ScaleRecovery::Options::validate() const {
  requireInRange("camera_height", camera_height, kMinCameraHeight, kMaxCameraHeight);
  visitParameters(*this, RangeCheck(""));
  mounting.validate();
  gpe.validate();
  gpa.validate();
  direct.validate();
  filter.validate();
  trajectory.validate();
}

struct ScaleRecovery::Impl {
  explicit Impl(const Options& o)
      : options(resolve(o)),
        mounting(options.mounting),
        gpe(options.gpe),
        gpa(options.gpa),
        direct(options.direct),
        filter(options.filter),
        trajectory(options.trajectory) {}

  struct StampedPosition {
    std::int64_t stamp_ns = 0;
    Eigen::Vector3d position_w = Eigen::Vector3d::Zero();
  };

  static Options resolve(const Options& options);
  void startMap();
  void setCamera(const PinholeCamera& new_camera);
  bool hasPlausibleSpeed(const StampedPosition& from, const StampedPosition& to) const;
  bool acceptPose(const VoFrame& frame);
  ScaleReason measure(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                      Output* output);
  ScaleReason measureFeatureBased(const VoFrame& frame, const NormalPrior& prior,
                                  const std::optional<MotionHistory::Chord>& chord, Output* output,
                                  GroundPlane* plane);
  bool measureDirect(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                     const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
                     Output* output, GroundPlane* plane);
  bool updateFilter(const GroundPlane& feature_based_plane, const GroundPlane& direct_plane,
                    Output* output);
  void fillEstimate(ScaleEstimate* scale) const;

  const Options options;
  MotionHistory motion;
  CameraPath path;
  Mounting mounting;
  GroundPointExtraction gpe;
  GroundPointAggregation gpa;
  DirectPlaneEstimator direct;
  ScaleFilter filter;
  MetricTrajectory trajectory;

  std::optional<PinholeCamera> last_camera;
  std::optional<std::uint32_t> map_id;
  StampedPosition last_pose, last_accepted;
  int refused_poses = 0;          ///< since the last accepted one
  bool refused_continue = false;  ///< one of them has a plausible speed from the one before
  /// Latest estimate of the height [VO units], also before the filter has started; 0: none yet.
  double rough_height = 0;
  /// By which speeds are judged: the last one of the filter, also of a map before with the same
  /// unit of length [VO units]; 0: none yet.
  double known_height = 0;
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< of the latest plane; zero: none yet
};

ScaleRecovery::Options ScaleRecovery::Impl::resolve(const Options& options) {
  options.validate();
  Options result = options.resolved();
  result.validate();
  return result;
}

/// A new map has another unit of length: only the mounting and the metric trajectory are kept.
void ScaleRecovery::Impl::startMap() {
  motion.reset();
  path.clear();
  gpa.reset();
  direct.reset();
  filter.reset();
  rough_height = known_height = 0;
  n_c.setZero();
}

bool ScaleRecovery::Impl::hasPlausibleSpeed(const StampedPosition& from,
                                            const StampedPosition& to) const {
  if (known_height == 0) return true;
  const double dt = std::max(kMinSpeedInterval, secondsBetween(from.stamp_ns, to.stamp_ns));
  const double step = (to.position_w - from.position_w).norm();
  return step / known_height * options.camera_height <= options.max_speed * dt;
}

/// Another lens of the same camera, in the same map: heights differ a little from now on.
void ScaleRecovery::Impl::setCamera(const PinholeCamera& new_camera) {
  if (last_camera && !isSameCamera(*last_camera, new_camera)) filter.changeLens();
  last_camera = new_camera;
}

/// Whether the pose of a tracking frame is used. A pose that jumps is refused; the fourth
/// consecutive one starts a new map. Its unit of length is that of the map before if the refused
/// poses continue from each other: the end of the jump is then refused, too, also before the new
/// map has a scale.
bool ScaleRecovery::Impl::acceptPose(const VoFrame& frame) {
  const StampedPosition pose{frame.stamp_ns, frame.T_w_c.translation()};
  const bool continues = hasPlausibleSpeed(std::exchange(last_pose, pose), pose);
  if (map_id != frame.map_id) {
    map_id = frame.map_id;
    // The motion since the map's first frame counts as travelled.
    if (trajectory.countsFromStart(frame)) motion.add(Eigen::Isometry3d::Identity());
  } else if (!hasPlausibleSpeed(last_accepted, pose)) {
    refused_continue = refused_continue || continues;
    if (++refused_poses <= kMaxRefusedPoses) return false;
    const double height = refused_continue ? known_height : 0;
    startMap();
    known_height = height;
    trajectory.leaveMap();
  }
  refused_poses = 0;
  refused_continue = false;
  last_accepted = pose;
  return true;
}

/// All stages for one tracking frame. Returns kNone when a measurement of this frame was used
/// or came before the filter may start, otherwise the reason why none was used.
ScaleReason ScaleRecovery::Impl::measure(const VoFrame& frame, const cv::Mat& image,
                                         const cv::Mat& mask, Output* output) {
  const double step = motion.distanceFromLast(frame.T_w_c);
  if (!motion.empty() && step < options.standstill_distance_heights * rough_height) {
    return ScaleReason::kStandstill;
  }
  motion.add(frame.T_w_c);
  filter.predict(step, Eigen::AngleAxisd(motion.lastMotion().linear()).angle());
  NormalPrior prior = mounting.prior(motion, rough_height);
  prior.region_offset = visibleRegionOffset(frame.camera, prior);
  const auto chord = motion.chord(options.mounting.chord_length_heights * rough_height);
  path.add(frame.T_w_c, prior, step, options.gpe.max_ahead_heights * rough_height);

  GroundPlane feature_based_plane, direct_plane;
  const ScaleReason feature_based =
      measureFeatureBased(frame, prior, chord, output, &feature_based_plane);
  const bool has_feature_based = feature_based == ScaleReason::kNone;
  const bool has_direct = measureDirect(frame, image, mask, prior, chord, output, &direct_plane);
  const bool has_measurement = has_feature_based || has_direct;

  const Stopwatch watch;
  const bool accepted = updateFilter(feature_based_plane, direct_plane, output);
  if (filter.known()) {
    rough_height = known_height = filter.height();
  } else if (has_measurement) {
    rough_height = output->plane.height;
  }
  if (has_measurement) {
    output->scale.raw_scale = options.camera_height / output->plane.height;
    n_c = output->plane.n_c;
  } else if (rough_height > 0) {
    n_c = prior.n_c;
  }
  // Skip the mounting update when the frame shows no ground.
  if (has_measurement || output->scale.ground_points > 0) {
    mounting.update(chord, accepted ? &output->plane : nullptr, step, rough_height);
  }
  output->times.filter = watch.ms();
  if (!has_measurement) return feature_based;
  // Not accepted before the start means too early, not rejected; the status is kUnknown then.
  return accepted || !filter.known() ? ScaleReason::kNone : ScaleReason::kRejectedByFilter;
}

/// Of two measured planes (height 0: not measured) output->plane is the direct one, unless the
/// filter accepts the feature-based one alone. Returns whether it accepts any.
bool ScaleRecovery::Impl::updateFilter(const GroundPlane& feature_based_plane,
                                       const GroundPlane& direct_plane, Output* output) {
  const auto accepts = [&](const Measurement& measurement, ScaleFilter::Source source) {
    return measurement.height > 0 &&
           filter.update(measurement.height, measurement.sigma, measurement.road_distance, source);
  };
  const bool feature_based_accepted =
      accepts(output->feature_based, ScaleFilter::Source::kFeatureBased);
  const bool direct_accepted = accepts(output->direct, ScaleFilter::Source::kDirect);
  const bool use_direct = direct_plane.height > 0 && (direct_accepted || !feature_based_accepted);
  output->plane = use_direct ? direct_plane : feature_based_plane;
  return feature_based_accepted || direct_accepted;
}

/// GPE and GPA (Alg. 1 and 2). On kNone output->feature_based and *plane are set.
ScaleReason ScaleRecovery::Impl::measureFeatureBased(
    const VoFrame& frame, const NormalPrior& prior,
    const std::optional<MotionHistory::Chord>& chord, Output* output, GroundPlane* plane) {
  Stopwatch watch;
  ScaleEstimate& scale = output->scale;
  const GroundPointExtraction::Result ground =
      gpe.extract(frame, prior, chord, motion.lastMotion());
  scale.triangles = ground.triangles;
  scale.ground_triangles = ground.ground_triangles;
  scale.ground_points = static_cast<int>(ground.points.size());
  for (const GroundPoint& point : ground.points) output->ground_feature_ids.push_back(point.id);
  output->times.delaunay = ground.delaunay_ms;
  output->times.gpe = watch.lapMs() - ground.delaunay_ms;
  // Without new points a fit of the unchanged window would count its information twice.
  if (ground.status != ScaleReason::kNone) return ground.status;

  if (rough_height == 0) rough_height = ground.plane.height;
  gpa.add(frame.T_w_c, motion.travelled(), ground.points);
  // The plane in the camera above the ground points, see CameraPath.
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();
  for (const GroundPoint& point : ground.points) {
    centre_c += point.p_c / static_cast<double>(ground.points.size());
  }
  const CameraPath::Camera& camera = path.nearest(frame.T_w_c * centre_c);
  const GroundPointAggregation::Result window =
      gpa.estimate(camera.T_w_c, motion.travelled(), camera.prior, rough_height);
  const Eigen::Isometry3d T_c_camera = frame.T_w_c.inverse() * camera.T_w_c;
  scale.window_points = static_cast<int>(window.window.size());
  for (const PlanePoint& point : window.window) {
    output->ground_points_c.push_back((T_c_camera * point.p_c).cast<float>());
  }
  if (window.fit.status == ScaleReason::kNone) {
    scale.plane_inliers = static_cast<int>(window.fit.inliers.size());
    output->feature_based = {window.fit.median_height, window.fit.height_sigma,
                             (centre_c - T_c_camera.translation()).norm()};
    *plane = {T_c_camera.linear() * window.fit.plane.n_c, window.fit.median_height};
  }
  output->times.gpa = watch.lapMs();
  return window.fit.status;
}

/// On success sets output->direct, output->correlation and *plane.
bool ScaleRecovery::Impl::measureDirect(const VoFrame& frame, const cv::Mat& image,
                                        const cv::Mat& mask, const NormalPrior& prior,
                                        const std::optional<MotionHistory::Chord>& chord,
                                        Output* output, GroundPlane* plane) {
  if (!options.refine || image.empty()) return false;
  const Stopwatch watch;
  const DirectPlaneEstimator::Result result =
      direct.estimate(frame, image, prior, chord, filter.height(), path, mask);
  output->times.direct = watch.ms();
  if (result.status != ScaleReason::kNone) return false;
  *plane = result.plane;
  output->direct = {result.plane.height, result.height_sigma, result.road_distance};
  output->correlation = result.correlation;
  return true;
}

/// Status and filtered values. scale->reason is set already.
void ScaleRecovery::Impl::fillEstimate(ScaleEstimate* scale) const {
  scale->n_c = n_c;
  if (!filter.known()) return;
  scale->status = scale->reason == ScaleReason::kNone ? ScaleStatus::kOk : ScaleStatus::kHeld;
  scale->height = filter.height();
  scale->scale = options.camera_height / scale->height;
  scale->sigma = scale->scale * filter.sigma() / scale->height;
}

ScaleRecovery::ScaleRecovery(const Options& options) : impl_(std::make_unique<Impl>(options)) {}

ScaleRecovery::~ScaleRecovery() = default;

void ScaleRecovery::reset() { impl_ = std::make_unique<Impl>(impl_->options); }

ScaleRecovery::Output ScaleRecovery::process(const VoFrame& frame, const cv::Mat& image,
                                             const cv::Mat& mask) {
  const Stopwatch watch;
  if (!image.empty()) requireImage(image, frame.camera);
  requireMask(mask, frame.camera);
  // Another map, also before its first pose. A lost frame tells nothing about the map.
  if (impl_->map_id != frame.map_id && frame.status != VoStatus::kLost) impl_->startMap();
  impl_->setCamera(frame.camera);
  Output output;
  ScaleEstimate& scale = output.scale;
  scale.reason = ScaleReason::kVoNotTracking;
  if (frame.status == VoStatus::kTracking && isFinite(frame.T_w_c) &&
      isPlausiblePosition(frame.T_w_c.translation())) {
    scale.reason = impl_->acceptPose(frame) ? impl_->measure(frame, image, mask, &output)
                                            : ScaleReason::kImplausibleMotion;
  }
  impl_->fillEstimate(&scale);
  if (!isFinite(scale.n_c) || !isPlausiblePosition(Eigen::Vector4d(scale.raw_scale, scale.scale,
                                                                   scale.sigma, scale.height))) {
    // The numbers are useless: publish none of them and start again.
    impl_->startMap();
    impl_->trajectory.leaveMap();
    const Times times = output.times;
    output = Output();
    output.times = times;
    scale.reason = ScaleReason::kNoPlane;
  }
  output.pose = impl_->trajectory.append(frame, scale);
  output.mounting_pitch = impl_->mounting.pitch();
  output.mounting_roll = impl_->mounting.roll();
  output.mounting_sigma = impl_->mounting.sigma();
  output.times.total = watch.ms();
  return output;
}

}  // namespace ground_scale_vo
