#include "ground_scale_vo/scale/scale_recovery.hpp"

#include <algorithm>
#include <utility>

#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "scale/camera_path.hpp"
#include "scale/direct_plane_estimator.hpp"
#include "scale/ground_points.hpp"
#include "scale/metric_trajectory.hpp"
#include "scale/mounting.hpp"
#include "scale/scale_filter.hpp"
#include "scale/speed_check.hpp"
#include "scale/speed_track.hpp"

namespace ground_scale_vo {
namespace {

/// Consecutive implausible poses after which the odometry is taken to have started a new map.
constexpr int kMaxRefusedPoses = 3;

/// [s] minimum interval of a speed: images that arrive in pairs may have nearly equal stamps.
constexpr double kMinSpeedInterval = 0.2;
constexpr double kShortestInterval = 0.01;  ///< [s] between two images

/// [m] Apparent motion along the path, and its cosine, from which on a speed of zero is not
/// believed.
constexpr double kMaxApparentMotion = 1, kAlongPath = 0.97;

// Pieces of the path that are compared with speeds.
/// [m] Least length, of the first one and of later ones.
constexpr double kMinFirstSpeedDistance = 1, kMinSpeedDistance = 3;
constexpr double kMaxSpeedTime = 10;  ///< [s]
/// [m] How far the last piece may lie behind. A piece ends where the newest speed ends.
constexpr double kSpeedReach = 10;
/// Relative standard deviation of a piece's length in the odometry.
constexpr double kSpeedNoise = 0.004;
/// Of a speed that repeats exactly.
constexpr double kRepeatedSpeedSigma = 0.03;
/// [m] In a turn the camera and the point whose speed is measured have different paths.
constexpr double kSpeedLever = 0.3;
constexpr double kSpeedTimeSigma = 0.2;  ///< [s] standard deviation of the stamps

}  // namespace

void ScaleRecoveryOptions::validate() const {
  if (use_speed && camera_height == 0) {
    if (paper_literal) throw OptionError("paper_literal needs a camera_height");
  } else {
    requireInRange("camera_height", camera_height, kMinCameraHeight, kMaxCameraHeight);
  }
  requireInRanges(*this);
  requireInRange("gpe/max_ahead_heights", gpe.max_ahead_heights, gpe.min_ahead_heights, 10000);
  requireInRange("gpe/max_half_width_heights", gpe.max_half_width_heights,
                 gpe.lane_half_width_heights, 1000);
  requireInRange("direct/max_ahead_heights", direct.max_ahead_heights, direct.min_ahead_heights,
                 1000);
}

struct ScaleRecovery::Impl {
  explicit Impl(const Options& o)
      : options(resolve(o)),
        mounting(options.mounting),
        gpe(options.gpe),
        gpa(options.gpa),
        direct(options.direct),
        trajectory(options.trajectory),
        speeds(options.speed_sigma),
        map(options) {}

  struct StampedPosition {
    std::int64_t stamp_ns = 0;
    Eigen::Vector3d position_w = Eigen::Vector3d::Zero();
  };

  /// What has the unit of length of one map.
  struct Map {
    explicit Map(const Options& o)
        : filter(o.filter, {o.camera_height, o.camera_height_sigma, o.speed_scale_sigma}) {}

    CameraPath path;
    ScaleFilter filter;
    /// Latest estimate of the height [VO units], also before the filter has started; 0: none yet.
    double rough_height = 0;
    /// By which the motion is judged: the last one of the filter, also of a map before with the
    /// same unit of length [m per VO unit]; 0: none yet.
    double known_scale = 0;
    std::int64_t measured_speed_ns = 0;  ///< end of the last piece of path compared with speeds
    /// At that end [VO units]; less than 0: its speed was not accepted.
    double speed_accepted_at = -1;
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< of the latest plane; zero: none yet
  };

  static Options resolve(const Options& options);
  void startMap();
  void setCamera(const PinholeCamera& new_camera);
  bool hasPlausibleSpeed(const StampedPosition& from, const StampedPosition& to) const;
  bool acceptPose(const VoFrame& frame);
  MeasurementStatus measure(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                            Output* output);
  MeasurementStatus measureFeatureBased(const VoFrame& frame, Output* output);
  void measureDirect(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                     Output* output);
  bool updateFilter(Output* output);
  bool standsStill(const VoFrame& frame);
  void measureSpeed(Output* output);
  bool hasCurrentSpeed() const;
  void fillEstimate(ScaleEstimate* scale) const;

  const Options options;
  Mounting mounting;
  GroundPointExtraction gpe;
  GroundPointAggregation gpa;
  DirectPlaneEstimator direct;
  MetricTrajectory trajectory;
  SpeedTrack speeds;
  SpeedCheck speed_check;

  Map map;
  std::optional<std::uint32_t> map_id;
  std::optional<PinholeCamera> last_camera;
  StampedPosition last_pose, last_accepted;
  int refused_poses = 0;          ///< since the last accepted one
  bool refused_continue = false;  ///< one of them has a plausible speed from the one before
};

ScaleRecovery::Options ScaleRecovery::Impl::resolve(const Options& options) {
  options.validate();
  Options result = options.resolved();
  result.validate();
  return result;
}

/// The camera height and the factor of the speeds are the same in all maps.
void ScaleRecovery::Impl::startMap() {
  Map next(options);
  next.filter = map.filter;
  next.filter.startMap();
  map = std::move(next);
  speed_check.startMap();
}

bool ScaleRecovery::Impl::hasPlausibleSpeed(const StampedPosition& from,
                                            const StampedPosition& to) const {
  if (map.known_scale == 0) return true;
  const double dt = std::max(kMinSpeedInterval, secondsBetween(from.stamp_ns, to.stamp_ns));
  const double step = (to.position_w - from.position_w).norm();
  return step * map.known_scale <= options.max_speed * dt;
}

/// Another lens of the same camera, in the same map: heights differ a little from now on.
void ScaleRecovery::Impl::setCamera(const PinholeCamera& new_camera) {
  if (last_camera && !isSameCamera(*last_camera, new_camera)) map.filter.changeLens();
  last_camera = new_camera;
}

/// Whether the pose of a tracking frame is used. A pose that jumps is refused; the fourth
/// consecutive one starts a new map. It keeps the unit of length of the map before if the refused
/// poses continue from each other: the end of the jump is then refused, too, also before the new
/// map has a scale.
bool ScaleRecovery::Impl::acceptPose(const VoFrame& frame) {
  const StampedPosition pose{frame.stamp_ns, frame.T_w_c.translation()};
  const bool continues = hasPlausibleSpeed(std::exchange(last_pose, pose), pose);
  if (map_id != frame.map_id) {
    map_id = frame.map_id;
    // The motion since the map's first frame counts as travelled.
    if (trajectory.countsFromStart(frame)) {
      map.path.add(Eigen::Isometry3d::Identity(), frame.map_start.stamp_ns);
      map.path.newest().prior = mounting.prior(map.path, 0);
    }
  } else if (!hasPlausibleSpeed(last_accepted, pose)) {
    refused_continue = refused_continue || continues;
    if (++refused_poses <= kMaxRefusedPoses) return false;
    const double scale = refused_continue ? map.known_scale : 0;
    startMap();
    map.known_scale = scale;
    trajectory.leaveMap();
  }
  refused_poses = 0;
  refused_continue = false;
  last_accepted = pose;
  return true;
}

/// All stages for one tracking frame. Returns kMeasured when a measurement of this frame was used
/// or came before the filter may start, otherwise the reason why none was used.
MeasurementStatus ScaleRecovery::Impl::measure(const VoFrame& frame, const cv::Mat& image,
                                               const cv::Mat& mask, Output* output) {
  const double step = map.path.distanceTo(frame.T_w_c);
  if (!map.path.empty() && step < options.standstill_distance_heights * map.rough_height) {
    return MeasurementStatus::kStandstill;
  }
  if (standsStill(frame)) return MeasurementStatus::kStandstill;
  map.path.add(frame.T_w_c, frame.stamp_ns);
  map.filter.setLensIsEstimated(frame.camera.lens_is_estimated);
  map.filter.predict(step, Eigen::AngleAxisd(map.path.lastMotion().linear()).angle());
  RoadPrior& prior = map.path.newest().prior;
  prior = mounting.prior(map.path, map.rough_height);
  prior.region_offset = visibleRegionOffset(frame.camera, prior);

  const MeasurementStatus feature_based = measureFeatureBased(frame, output);
  measureDirect(frame, image, mask, output);
  const Stopwatch watch;
  const bool accepted = updateFilter(output);
  if (!speeds.empty()) measureSpeed(output);
  const bool has_measurement = output->plane.height > 0;
  if (map.filter.known()) map.known_scale = map.filter.scale();
  if (map.filter.heightKnown()) {
    map.rough_height = map.filter.height();
  } else if (has_measurement) {
    map.rough_height = output->plane.height;
  }
  if (has_measurement) {
    if (map.filter.hasCameraHeight()) {
      output->scale.raw_scale = map.filter.cameraHeight() / output->plane.height;
    }
    map.n_c = output->plane.n_c;
  } else if (map.rough_height > 0) {
    map.n_c = prior.n_c;
  }
  // Skip the mounting update when the frame shows no ground.
  if (has_measurement || output->scale.ground_points > 0) {
    mounting.update(prior, accepted ? &output->plane : nullptr, step, map.rough_height);
  }
  output->times.filter = watch.ms();
  const bool has_speed = hasCurrentSpeed();
  output->scale.source = accepted ? (has_speed ? ScaleSource::kBoth : ScaleSource::kRoad)
                                  : (has_speed ? ScaleSource::kSpeed : ScaleSource::kNone);
  if (has_speed) return MeasurementStatus::kMeasured;
  if (!has_measurement) return feature_based;
  // Before the filter has started, a measurement that it does not accept is too early.
  return accepted || !map.filter.known() ? MeasurementStatus::kMeasured
                                         : MeasurementStatus::kRejectedByFilter;
}

/// output->plane is the last measurement that the filter accepts, or the last one if it accepts
/// none. Returns whether it accepts any.
bool ScaleRecovery::Impl::updateFilter(Output* output) {
  bool any_accepted = false;
  for (const auto& [source, m] :
       {std::pair(ScaleFilter::Source::kFeatureBased, output->feature_based),
        std::pair(ScaleFilter::Source::kDirect, output->direct)}) {
    if (!(m.height > 0)) continue;
    const bool accepted =
        map.filter.update(m.height, m.sigma, m.road_distance, source, m.is_beside_lane);
    if (accepted || !any_accepted) output->plane = {m.n_c, m.height};
    any_accepted = any_accepted || accepted;
  }
  return any_accepted;
}

/// Whether the speeds say that the vehicle stands. What then moves in the images is traffic, unless
/// the motion is straight along the path.
bool ScaleRecovery::Impl::standsStill(const VoFrame& frame) {
  if (map.path.empty()) return false;
  const CameraPath::Camera& stop = map.path.newest();
  if (!speeds.standsStill(stop.stamp_ns, frame.stamp_ns)) return false;
  const Eigen::Vector3d motion_c = (stop.T_w_c.inverse() * frame.T_w_c).translation();
  if (motion_c.norm() * map.known_scale < kMaxApparentMotion ||
      motion_c.normalized().dot(stop.prior.forward_c) < kAlongPath) {
    return true;
  }
  speeds.distrustZero();
  return false;
}

/// Compares the latest piece of the path that the speeds cover with them. Nothing waits for a
/// speed: what arrives late measures an earlier piece.
void ScaleRecovery::Impl::measureSpeed(Output* output) {
  const auto& cameras = map.path.cameras();
  const auto covered = [&](std::int64_t stamp_ns) {
    return std::find_if(cameras.rbegin(), cameras.rend(),
                        [&](const CameraPath::Camera& c) { return c.stamp_ns <= stamp_ns; });
  };
  const auto to = covered(speeds.samples().back().stamp_ns);
  if (to == cameras.rend()) return;
  /// [VO units/s] over the step to a camera, or from the first one.
  const auto speedAt = [&](auto camera) {
    if (std::next(camera) == cameras.rend()) --camera;
    const auto previous = std::next(camera);
    return (camera->travelled - previous->travelled) /
           std::max(kShortestInterval, secondsBetween(previous->stamp_ns, camera->stamp_ns));
  };
  auto from = covered(map.measured_speed_ns);
  if (from == cameras.rend()) --from;
  if (from->stamp_ns >= to->stamp_ns) return;
  const auto distance = speeds.distance(from->stamp_ns, to->stamp_ns);
  if (!distance || secondsBetween(from->stamp_ns, to->stamp_ns) > kMaxSpeedTime) {
    map.measured_speed_ns = to->stamp_ns;  // a gap, or hardly any motion
    return;
  }
  const double metres = std::abs(distance->metres), units = to->travelled - from->travelled;
  const double min_metres = map.speed_accepted_at < 0 ? kMinFirstSpeedDistance : kMinSpeedDistance;
  const bool has_failed =
      map.filter.known() && units * map.filter.scale() > 5 * std::max(metres, min_metres);
  if ((metres < min_metres && !has_failed) || !(units > 0)) return;
  const Eigen::Isometry3d motion = from->T_w_c.inverse() * to->T_w_c;
  // By the change of the speed within the piece, the stamps matter. The odometry sees it in time.
  const double change =
      std::max(std::abs(speeds.speedAt(to->stamp_ns) - speeds.speedAt(from->stamp_ns)),
               std::abs(speedAt(to) - speedAt(from)) * metres / units);
  const double sigma =
      std::hypot(distance->sigma, kSpeedLever * Eigen::AngleAxisd(motion.linear()).angle(),
                 std::hypot(kSpeedTimeSigma, speed_check.delay()) * change) /
      metres;
  const double relative_sigma =
      std::hypot(sigma, kSpeedNoise, speeds.repeats() ? kRepeatedSpeedSigma : 0);
  SpeedCheck::Piece piece;
  piece.log_ratio = std::log((metres + 0.01) / units);
  piece.relative_acceleration =
      (speeds.speedAt(to->stamp_ns) - speeds.speedAt(from->stamp_ns)) / distance->metres;
  piece.along_axis = std::copysign(1, distance->metres) * motion.translation().normalized().z();
  piece.error = map.filter.known() ? piece.log_ratio - std::log(map.filter.scale()) : 0;
  piece.accepted = !has_failed && map.filter.updateSpeed(metres / units, relative_sigma);
  speed_check.add(piece);
  speeds.setAgrees(piece.accepted);
  map.measured_speed_ns = to->stamp_ns;
  map.speed_accepted_at = piece.accepted ? map.path.newest().travelled : -1;
  if (output->scale.raw_scale == 0) output->scale.raw_scale = metres / units;
}

/// The last piece was accepted, and is not far behind.
bool ScaleRecovery::Impl::hasCurrentSpeed() const {
  return map.speed_accepted_at >= 0 && map.filter.known() &&
         (map.path.newest().travelled - map.speed_accepted_at) * map.filter.scale() < kSpeedReach;
}

/// GPE and GPA (Alg. 1 and 2). On kMeasured output->feature_based is set.
MeasurementStatus ScaleRecovery::Impl::measureFeatureBased(const VoFrame& frame, Output* output) {
  Stopwatch watch;
  ScaleEstimate& scale = output->scale;
  CameraPath::Camera& current = map.path.newest();
  GroundPointExtraction::Result ground = gpe.extract(frame, current.prior, map.path.lastMotion());
  scale.triangles = ground.triangles;
  scale.ground_triangles = ground.ground_triangles;
  scale.ground_points = static_cast<int>(ground.points.size());
  output->times.delaunay = ground.delaunay_ms;
  output->times.gpe = watch.lapMs() - ground.delaunay_ms;
  // Without new points a fit of the unchanged window would count its information twice.
  if (ground.status != MeasurementStatus::kMeasured) return ground.status;

  if (map.rough_height == 0) map.rough_height = ground.plane.height;
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();
  for (const GroundPoint& point : ground.points) {
    output->ground_feature_ids.push_back(point.id);
    centre_c += point.p_c / static_cast<double>(ground.points.size());
  }
  current.ground_points = std::move(ground.points);
  // The plane in the camera above the ground points.
  const CameraPath::Camera& above =
      map.path.nearest(current.T_w_c * centre_c, options.gpe.max_ahead_heights * map.rough_height);
  const GroundPointAggregation::Result window = gpa.estimate(map.path, above, map.rough_height);
  const Eigen::Isometry3d T_c_above = current.T_w_c.inverse() * above.T_w_c;
  scale.window_points = static_cast<int>(window.window.size());
  for (const PlanePoint& point : window.window) {
    output->ground_points_c.push_back((T_c_above * point.p_c).cast<float>());
  }
  if (window.fit.status == MeasurementStatus::kMeasured) {
    scale.plane_inliers = static_cast<int>(window.fit.inliers.size());
    output->feature_based = {window.fit.median_height, window.fit.height_sigma,
                             (centre_c - T_c_above.translation()).norm(),
                             T_c_above.linear() * window.fit.plane.n_c, ground.are_beside_lane};
  }
  output->times.gpa = watch.lapMs();
  return window.fit.status;
}

/// On success sets output->direct and output->correlation.
void ScaleRecovery::Impl::measureDirect(const VoFrame& frame, const cv::Mat& image,
                                        const cv::Mat& mask, Output* output) {
  if (!options.refine || image.empty()) return;
  const Stopwatch watch;
  const DirectPlaneEstimator::Result result =
      direct.estimate(frame, image, map.filter.height(), &map.path, mask);
  output->times.direct = watch.ms();
  if (result.status != MeasurementStatus::kMeasured) return;
  output->direct = {result.plane.height, result.height_sigma, result.road_distance,
                    result.plane.n_c};
  output->correlation = result.correlation;
}

/// Status and filtered values. scale->measurement is set already.
void ScaleRecovery::Impl::fillEstimate(ScaleEstimate* scale) const {
  scale->n_c = map.n_c;
  if (map.filter.hasCameraHeight()) {
    scale->camera_height = map.filter.cameraHeight();
    scale->camera_height_sigma = map.filter.cameraHeightSigma();
  }
  if (!map.filter.known()) {
    scale->source = ScaleSource::kNone;
    return;
  }
  scale->status =
      scale->measurement == MeasurementStatus::kMeasured ? ScaleStatus::kOk : ScaleStatus::kHeld;
  scale->height = map.filter.height();
  scale->scale = map.filter.scale();
  scale->sigma = map.filter.scaleSigma();
}

ScaleRecovery::ScaleRecovery(const Options& options) : impl_(std::make_unique<Impl>(options)) {}

ScaleRecovery::~ScaleRecovery() = default;

void ScaleRecovery::addSpeed(const SpeedSample& speed) { impl_->speeds.add(speed); }

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
  scale.measurement = MeasurementStatus::kVoNotTracking;
  if (frame.status == VoStatus::kTracking && isFinite(frame.T_w_c) &&
      isPlausiblePosition(frame.T_w_c.translation())) {
    scale.measurement = impl_->acceptPose(frame) ? impl_->measure(frame, image, mask, &output)
                                                 : MeasurementStatus::kImplausibleMotion;
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
    scale.measurement = MeasurementStatus::kNoPlane;
  }
  output.pose = impl_->trajectory.append(frame, scale, impl_->speeds);
  if (impl_->options.use_speed) {
    output.speed_warning = impl_->speed_check.warning(impl_->speeds, frame.stamp_ns);
    if (output.speed_warning.empty()) {
      output.speed_warning =
          heightWarning(impl_->options.camera_height, impl_->options.camera_height_sigma, scale);
    }
  }
  output.mounting_pitch = impl_->mounting.pitch();
  output.mounting_roll = impl_->mounting.roll();
  output.mounting_sigma = impl_->mounting.sigma();
  output.times.total = watch.ms();
  return output;
}

}  // namespace ground_scale_vo
