#include "ground_scale_vo/scale/scale_recovery.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "scale/scale_recovery_impl.hpp"

namespace gsv {
namespace {

/// Consecutive implausible poses after which the odometry is taken to have started a new map.
constexpr int kMaxRefusedPoses = 3;
/// [s] least interval of two poses for their speed: images may arrive in pairs.
constexpr double kMinPoseInterval = 0.2;

constexpr double kMaxSpeed = 100;  ///< [m/s] of a pose: no road vehicle is faster

}  // namespace

void ScaleRecoveryOptions::validate() const {
  if (!use_speed || camera_height != 0) {
    requireInRange("camera_height", camera_height, kMinCameraHeight, kMaxCameraHeight);
    const bool is_usual = camera_height >= kMinUsualHeight && camera_height <= kMaxUsualHeight;
    if (!is_usual && !unusual_height) {
      throw OptionError(
          format("camera_height is %g m, on a road vehicle it is %g to %g m: is it in "
                 "centimetres? If not, set unusual_height true",
                 camera_height, kMinUsualHeight, kMaxUsualHeight));
    }
  }
  requireInRanges(*this);
  requireInRange("gpe/max_half_width_heights", gpe.max_half_width_heights,
                 gpe.lane_half_width_heights, 1000);
}

void ScaleRecoveryOptions::requireSmoothable() const {
  if (filter.moving_average_frames == 0) return;
  throw OptionError("a moving average (filter/moving_average_frames) cannot be smoothed");
}

ScaleRecovery::Impl::Impl(const Options& o)
    : options(o),
      mounting(options.mounting),
      direct(options.direct),
      filter(options.filter,
             {options.camera_height, options.cameraHeightSigma(), options.speed_scale_sigma}),
      trajectory(options.trajectory),
      path_speed(options.speed_sigma) {
  options.validate();
}

ScaleRecovery::Output ScaleRecovery::Impl::process(const VoFrame& frame, const cv::Mat& image,
                                                   const cv::Mat& mask) {
  Output output;
  ScaleEstimate& scale = output.scale;
  Continuity continuity = frame.status == VoStatus::kLost ? Continuity::kSameMap : frame.continuity;
  follow(continuity);
  const bool was_known = filter.known();
  scale.measurement =
      frame.zoom == 1 ? MeasurementStatus::kVoNotTracking : MeasurementStatus::kZoomed;
  if (frame.status == VoStatus::kTracking && frame.zoom == 1 && isFinite(frame.T_w_c) &&
      isPlausiblePosition(frame.T_w_c.translation())) {
    const std::optional<Continuity> of_pose = continuityOfPose(frame);
    continuity = of_pose.value_or(continuity);
    scale.measurement =
        of_pose ? measure(frame, image, mask, &output) : MeasurementStatus::kImplausibleMotion;
  }
  fillEstimate(&scale);
  if (!isFinite(scale.n_c) || !isPlausiblePosition(Eigen::Vector4d(scale.raw_scale, scale.scale,
                                                                   scale.sigma, scale.height))) {
    // The numbers are useless: publish none of them and start again.
    follow(continuity = Continuity::kNewMap);
    const Times times = output.times;
    output = Output();
    output.times = times;
    scale.measurement = MeasurementStatus::kNoPlane;
  } else if (was_known && !filter.known()) {
    continuity = std::max(continuity, Continuity::kNewMap);  // its unit was another one
  }
  if (options.record) smoother.addFrame(frame, continuity, scale, path_speed.speeds());
  output.pose = trajectory.append(frame, continuity, scale, path_speed.speeds());
  return output;
}

/// Forgets what ends with this value. The camera height and the factor of the speeds stay.
void ScaleRecovery::Impl::follow(Continuity continuity) {
  if (continuity == Continuity::kOtherLens) filter.changeLens();
  if (continuity < Continuity::kNewMapSameUnit) return;
  const double known_scale = continuity == Continuity::kNewMapSameUnit ? map.known_scale : 0;
  map = Map();
  map.known_scale = known_scale;
  filter.startMap();
  path_speed.startMap();
  smoother.startMap();
}

/// A speed that no vehicle has.
bool ScaleRecovery::Impl::impliesJump(const StampedPose& from, const StampedPose& to) const {
  const double dt = std::max(kMinPoseInterval, secondsBetween(from.stamp_ns, to.stamp_ns));
  const double step = (to.T_w_c.translation() - from.T_w_c.translation()).norm();
  return map.known_scale > 0 && step * map.known_scale > kMaxSpeed * dt;
}

/// How a tracking frame continues the accepted poses. A pose that jumps is refused (empty); the
/// fourth consecutive one starts a new map. It keeps the unit of length of the map before if the
/// refused poses continue from each other: the end of the jump is then refused, too, also before
/// the new map has a scale.
std::optional<Continuity> ScaleRecovery::Impl::continuityOfPose(const VoFrame& frame) {
  const StampedPose pose{frame.stamp_ns, frame.T_w_c};
  const bool continues = !impliesJump(std::exchange(last_pose, pose), pose);
  Continuity continuity = frame.continuity;
  if (!map.path.empty() && impliesJump(last_accepted, pose)) {
    refused_continue = refused_continue || continues;
    if (++refused_poses <= kMaxRefusedPoses) return std::nullopt;
    continuity = refused_continue ? Continuity::kNewMapSameUnit : Continuity::kNewMap;
    follow(continuity);
  } else if (map.path.empty() && trajectory.countsFromStart(frame)) {
    // The motion since the map's first frame counts as travelled.
    CameraPath::Pose& start =
        map.path.add({frame.map_start.stamp_ns, Eigen::Isometry3d::Identity()});
    start.prior = mounting.prior(map.path, 0);
  }
  refused_poses = 0;
  refused_continue = false;
  last_accepted = pose;
  return continuity;
}

/// All stages for one tracking frame. Returns kMeasured when a measurement of this frame was used
/// or came before the filter may start, otherwise the reason why none was used.
MeasurementStatus ScaleRecovery::Impl::measure(const VoFrame& frame, const cv::Mat& image,
                                               const cv::Mat& mask, Output* output) {
  const double step = map.path.distanceTo(frame.T_w_c);
  if (!map.path.empty() && step < options.standstill_distance_heights * map.rough_height) {
    return MeasurementStatus::kStandstill;
  }
  if (path_speed.standsStill(map.path, frame, map.known_scale)) {
    return MeasurementStatus::kStandstill;
  }
  CameraPath::Pose& current = map.path.add({frame.stamp_ns, frame.T_w_c});
  filter.predict(step, Eigen::AngleAxisd(map.path.lastMotion().linear()).angle(),
                 frame.camera.k1Sigma());
  RoadPrior& prior = current.prior;
  prior = mounting.prior(map.path, map.rough_height);
  prior.region_offset = visibleRegionOffset(frame.camera, prior);

  const MeasurementStatus feature_based = measureFeatureBased(frame, &current, output);
  measureDirect(frame, image, mask, output);
  const Stopwatch watch;
  const bool accepted = updateFilter(output);
  if (!path_speed.speeds().empty()) measureSpeed(output);
  if (options.record) smoother.addStep(filter);
  const bool has_measurement = output->plane.height > 0;
  if (filter.known()) map.known_scale = filter.scale();
  if (filter.heightKnown()) {
    map.rough_height = filter.height();
  } else if (has_measurement) {
    map.rough_height = output->plane.height;
  }
  if (has_measurement) {
    if (filter.hasCameraHeight()) {
      output->scale.raw_scale = filter.cameraHeight() / output->plane.height;
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
  const bool has_speed = path_speed.isCurrent(map.path, filter.scale());
  output->scale.source = accepted ? (has_speed ? ScaleSource::kBoth : ScaleSource::kRoad)
                                  : (has_speed ? ScaleSource::kSpeed : ScaleSource::kNone);
  if (has_speed) return MeasurementStatus::kMeasured;
  if (!has_measurement) return feature_based;
  // Before the filter has started, a measurement that it does not accept is too early.
  return accepted || !filter.known() ? MeasurementStatus::kMeasured
                                     : MeasurementStatus::kRejectedByFilter;
}

/// output->plane is the last measurement that the filter accepts, or the last one if it accepts
/// none. Returns whether it accepts any.
bool ScaleRecovery::Impl::updateFilter(Output* output) {
  bool any_accepted = false;
  for (const auto& [source, m] :
       {std::pair(ScaleFilter::Source::kFeatureBased, output->feature_based),
        std::pair(ScaleFilter::Source::kDirect, output->direct)}) {
    if (!(m.plane.height > 0)) continue;
    const bool accepted =
        filter.update(m.plane.height, m.sigma, m.road_distance, source, m.is_beside_lane);
    if (accepted || !any_accepted) output->plane = m.plane;
    any_accepted = any_accepted || accepted;
  }
  return any_accepted;
}

/// Updates the filter with the latest piece of the path that the speeds cover.
void ScaleRecovery::Impl::measureSpeed(Output* output) {
  const std::optional<PathSpeed::Piece> piece = path_speed.measure(map.path, filter.scale());
  if (!piece) return;
  // With a camera height, nothing depends on a sensor that may be stuck.
  if (filter.hasCameraHeight() && !path_speed.speeds().hasVaried()) return;
  const bool accepted =
      !piece->has_failed && filter.updateSpeed(piece->metres_per_unit, piece->relative_sigma);
  path_speed.add(*piece, accepted, map.path);
  if (output->scale.raw_scale == 0) output->scale.raw_scale = piece->metres_per_unit;
}

/// GPE and GPA (Alg. 1 and 2). On kMeasured output->feature_based is set.
MeasurementStatus ScaleRecovery::Impl::measureFeatureBased(const VoFrame& frame,
                                                           CameraPath::Pose* current,
                                                           Output* output) {
  Stopwatch watch;
  ScaleEstimate& scale = output->scale;
  GroundPoints ground = extractGroundPoints(frame, current->prior, map.path.lastMotion(),
                                            options.gpe, options.random_seed);
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
  current->ground_points = std::move(ground.points);
  // The plane in the camera above the ground points.
  const CameraPath::Pose& above =
      map.path.nearest(current->T_w_c * centre_c, options.gpe.max_ahead_heights * map.rough_height);
  const std::vector<GroundPoint> window =
      aggregateGroundPoints(map.path, above.T_w_c, map.rough_height, options.gpa);
  PlaneMeasurement fit = fitPlane(window, above.prior, map.rough_height, options.gpa.fit);
  const Eigen::Isometry3d T_c_above = current->T_w_c.inverse() * above.T_w_c;
  scale.window_points = static_cast<int>(window.size());
  for (const GroundPoint& point : window) {
    output->ground_points_c.push_back((T_c_above * point.p_c).cast<float>());
  }
  if (fit.status == MeasurementStatus::kMeasured) {
    scale.plane_inliers = fit.support;
    fit.plane.n_c = T_c_above.linear() * fit.plane.n_c;
    fit.road_distance = (centre_c - T_c_above.translation()).norm();
    fit.is_beside_lane = ground.are_beside_lane;
    output->feature_based = fit;
  }
  output->times.gpa = watch.lapMs();
  return fit.status;
}

/// On success sets output->direct.
void ScaleRecovery::Impl::measureDirect(const VoFrame& frame, const cv::Mat& image,
                                        const cv::Mat& mask, Output* output) {
  if (!options.refine || image.empty()) return;
  const Stopwatch watch;
  RoadImage road;
  const PlaneMeasurement measured =
      direct.estimate(frame, image, filter.height(), map.path, mask, &road);
  map.path.keepRoad(road);
  output->times.direct = watch.ms();
  if (measured.status == MeasurementStatus::kMeasured) output->direct = measured;
}

/// Status and filtered values. scale->measurement is set already.
void ScaleRecovery::Impl::fillEstimate(ScaleEstimate* scale) const {
  scale->n_c = map.n_c;
  if (filter.hasCameraHeight()) {
    scale->camera_height = filter.cameraHeight();
    scale->camera_height_sigma = filter.cameraHeightSigma();
  }
  const bool is_of_other_unit =
      !heightError(options.camera_height, std::numeric_limits<double>::infinity(),
                   scale->camera_height)
           .empty();
  if (!filter.known() || is_of_other_unit) {
    scale->source = ScaleSource::kNone;
    return;
  }
  scale->status =
      scale->measurement == MeasurementStatus::kMeasured ? ScaleStatus::kOk : ScaleStatus::kHeld;
  scale->height = filter.height();
  scale->scale = filter.scale();
  scale->sigma = filter.scaleSigma();
}

ScaleRecovery::ScaleRecovery(const Options& options) : impl_(std::make_unique<Impl>(options)) {}

ScaleRecovery::~ScaleRecovery() = default;

void ScaleRecovery::addSpeed(const SpeedSample& speed) {
  if (!impl_->options.use_speed) throw OptionError("a speed needs the option use_speed=true");
  impl_->path_speed.add(speed);
  if (impl_->options.record) impl_->smoother.addSpeed(speed);
}

std::vector<ScaleRecovery::Smoothed> ScaleRecovery::smoothed() const {
  if (!impl_->options.record) return {};
  impl_->options.requireSmoothable();
  return impl_->smoother.smoothed(impl_->options);
}

ScaleRecovery::Output ScaleRecovery::process(const VoFrame& frame, const cv::Mat& image,
                                             const cv::Mat& mask) {
  const Stopwatch watch;
  if (!image.empty()) requireImage(image, frame.camera);
  requireMask(mask, frame.camera);
  // The speeds before the first frame are kept.
  if (frame.continuity == Continuity::kNewTrajectory && impl_->has_started) {
    impl_ = std::make_unique<Impl>(impl_->options);
  }
  impl_->has_started = true;
  Output output = impl_->process(frame, image, mask);
  const Options& options = impl_->options;
  if (options.use_speed) {
    output.speed_error = impl_->path_speed.error();
    if (output.speed_error.empty()) {
      output.speed_error =
          heightError(options.camera_height, options.cameraHeightSigma(),
                      output.scale.camera_height > 0 ? impl_->filter.heightBySpeeds() : 0);
    }
    if (output.speed_error.empty()) {
      output.speed_warning = impl_->path_speed.warning(frame.stamp_ns);
    }
    if (output.speed_error.empty() && output.speed_warning.empty()) {
      output.speed_warning =
          heightWarning(options.camera_height, options.cameraHeightSigma(), output.scale);
    }
  }
  output.mounting_pitch = impl_->mounting.pitch();
  output.mounting_roll = impl_->mounting.roll();
  output.mounting_sigma = impl_->mounting.sigma();
  output.times.total = watch.ms();
  return output;
}

}  // namespace gsv
