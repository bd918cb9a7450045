#include "ground_scale_vo/scale/scale_recovery.hpp"

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"

namespace ground_scale_vo {

ScaleRecovery::Options ScaleRecovery::Options::withPaperLiteral() const {
  Options literal = *this;
  literal.min_step_h = 0;
  literal.refine = false;
  literal.mounting.chord_h = 0.01;  // one frame's t
  literal.gpe.lane_points = 0;
  literal.gpe.lane_h = literal.gpe.max_lateral_h = 1000;
  literal.gpe.max_ahead_h = 10000;
  literal.gpe.frame_pitch_test = true;
  literal.gpe.most_inliers = true;
  literal.gpe.motion_tolerance_rad = literal.gpe.pitch_tolerance_rad = 0.0873;  // 5 deg
  literal.gpe.plane_threshold_h = literal.gpa.fit.reject_h = 0.01 / camera_height;
  literal.gpe.plane_threshold_sigma = 0;
  literal.gpa.window_h = 1e6;
  literal.gpa.max_frames = 4;
  literal.gpa.min_frames = 4;
  literal.gpa.feature_once = false;
  literal.gpa.fit.method = PlaneFit::Method::kLiteral;
  literal.filter.moving_average_frames = 20;  // the paper gives no number
  return literal;
}

void ScaleRecovery::Options::validate() const {
  requireInRange("camera_height", camera_height, 0.05, 100);
  visitParameters(*this, RangeCheck(""));
  motion.validate();
  mounting.validate();
  gpe.validate();
  gpa.validate();
  refinement.validate();
  filter.validate();
  trajectory.validate();
}

struct ScaleRecovery::Impl {
  explicit Impl(const Options& o)
      : options(prepared(o)),
        motion(options.motion),
        mounting(options.mounting),
        gpe(options.gpe),
        gpa(options.gpa),
        refinement(options.refinement),
        filter(options.filter),
        trajectory(options.trajectory) {}

  static Options prepared(const Options& o) {
    o.validate();
    Options result = o.paper_literal ? o.withPaperLiteral() : o;
    result.gpe.random_seed = o.random_seed;
    result.validate();
    return result;
  }

  /// Another unit of length: all but the mounting and the way made starts anew.
  void startMap() {
    motion.reset();
    gpa.reset();
    refinement.reset();
    filter.reset();
    rough_height = 0;
    n_c.setZero();
  }
  /// All stages for one tracking frame. Returns why there is no measurement, or kNone.
  ScaleReason measure(const VoFrame& frame, const cv::Mat& image, Output* output);
  /// GPE and GPA; output->points.
  PlaneFit::Result measurePoints(const VoFrame& frame, const NormalPrior& prior,
                                 const std::optional<MotionHistory::Chord>& chord, Output* output);

  const Options options;
  MotionHistory motion;
  Mounting mounting;
  GroundPointExtraction gpe;
  GroundPointAggregation gpa;
  DirectPlaneEstimator refinement;
  ScaleFilter filter;
  MetricTrajectory trajectory;

  std::optional<std::uint32_t> map_id;
  double rough_height = 0;  ///< latest idea of the height [VO units]; 0: none in this map yet
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< of the latest plane, zero: none yet
};

PlaneFit::Result ScaleRecovery::Impl::measurePoints(
    const VoFrame& frame, const NormalPrior& prior,
    const std::optional<MotionHistory::Chord>& chord, Output* output) {
  Stopwatch watch;
  ScaleEstimate& scale = output->scale;
  GroundPointExtraction::Result ground = gpe.extract(frame, prior, chord, motion.lastMotion());
  scale.triangles = ground.triangles;
  scale.ground_triangles = ground.ground_triangles;
  scale.ground_points = static_cast<int>(ground.points.size());
  for (const GroundPoint& point : ground.points) output->ground_feature_ids.push_back(point.id);
  output->times.delaunay = ground.delaunay_ms;
  output->times.gpe = watch.lapMs() - ground.delaunay_ms;
  if (ground.status != ScaleReason::kNone) {
    // The window alone says nothing that it has not said before.
    PlaneFit::Result none;
    none.status = ground.status;
    return none;
  }
  if (rough_height == 0) rough_height = ground.plane.height;
  gpa.add(frame.T_w_c, motion.travelled(), ground.points, options.min_step_h * rough_height);
  GroundPointAggregation::Result plane =
      gpa.estimate(frame.T_w_c, motion.travelled(), prior, rough_height);
  scale.window_points = static_cast<int>(plane.window.size());
  for (const PlanePoint& point : plane.window) {
    output->ground_points_c.push_back(point.p_c.cast<float>());
  }
  if (plane.fit.status == ScaleReason::kNone) {
    scale.plane_inliers = static_cast<int>(plane.fit.inliers.size());
    output->points = {plane.fit.median_height, plane.fit.height_sigma};
  }
  output->times.gpa = watch.lapMs();
  return plane.fit;
}

ScaleReason ScaleRecovery::Impl::measure(const VoFrame& frame, const cv::Mat& image,
                                         Output* output) {
  const double step = motion.distanceFromLast(frame.T_w_c);
  if (!motion.empty() && step < options.min_step_h * rough_height) return ScaleReason::kStandstill;
  motion.add(frame.T_w_c);
  filter.move(step, Eigen::AngleAxisd(motion.lastMotion().linear()).angle());
  const NormalPrior prior = mounting.prior(motion, rough_height);
  const auto chord = motion.chord(options.mounting.chord_h * rough_height);

  const PlaneFit::Result points = measurePoints(frame, prior, chord, output);
  const bool has_points = points.status == ScaleReason::kNone;
  if (has_points) output->plane = {points.plane.n_c, output->points.height};

  Stopwatch watch;
  bool has_pixels = false;
  if (options.refine && !image.empty()) {
    const DirectPlaneEstimator::Result pixels =
        refinement.align(frame, image, prior, chord, filter.height());
    has_pixels = pixels.status == ScaleReason::kNone;
    if (has_pixels) {
      output->plane = pixels.plane;
      output->pixels = {pixels.plane.height, pixels.height_sigma};
      output->correlation = pixels.correlation;
    }
  }
  output->times.refine = watch.lapMs();

  const bool found = has_points || has_pixels;
  bool used = false;
  if (has_points) {
    used = filter.update(output->points.height, output->points.sigma, ScaleFilter::Source::kPoints);
  }
  if (has_pixels) {
    used |=
        filter.update(output->pixels.height, output->pixels.sigma, ScaleFilter::Source::kPixels);
  }
  // Until the filter knows, the latest plane is the best idea of the unit of length.
  if (filter.known()) {
    rough_height = filter.height();
  } else if (found) {
    rough_height = output->plane.height;
  }
  if (found) {
    output->scale.raw_scale = options.camera_height / output->plane.height;
    n_c = output->plane.n_c;
  } else if (rough_height > 0) {
    n_c = prior.n_c;
  }
  // A frame without a single ground point teaches nothing.
  if (found || output->scale.ground_points > 0) {
    mounting.update(chord, used ? &output->plane : nullptr, step / rough_height);
  }
  output->times.filter = watch.lapMs();
  if (!found) return points.status;
  // While the filter collects its first ones, a measurement is not rejected: the status says
  // unknown.
  return used || !filter.known() ? ScaleReason::kNone : ScaleReason::kRejectedByFilter;
}

ScaleRecovery::ScaleRecovery(const Options& options) : impl_(std::make_unique<Impl>(options)) {}

ScaleRecovery::~ScaleRecovery() = default;

void ScaleRecovery::reset() { impl_ = std::make_unique<Impl>(impl_->options); }

ScaleRecovery::Output ScaleRecovery::process(const VoFrame& frame, const cv::Mat& image) {
  Stopwatch watch;
  if (!image.empty()) requireImage(image, frame.camera);
  Output output;
  ScaleEstimate& scale = output.scale;
  scale.reason = ScaleReason::kVoNotTracking;
  const bool has_pose = frame.status == VoStatus::kTracking && isFinite(frame.T_w_c) &&
                        isPlace(frame.T_w_c.translation());
  if (has_pose) {
    if (impl_->map_id != frame.map_id) {
      impl_->startMap();
      impl_->map_id = frame.map_id;
    }
    scale.reason = impl_->measure(frame, image, &output);
  }
  scale.n_c = impl_->n_c;
  if (impl_->filter.known()) {
    scale.status = scale.reason == ScaleReason::kNone ? ScaleStatus::kOk : ScaleStatus::kHeld;
    scale.height = impl_->filter.height();
    scale.scale = impl_->options.camera_height / scale.height;
    scale.sigma = scale.scale * impl_->filter.sigma() / scale.height;
  }
  if (!isFinite(scale.n_c) ||
      !isPlace(Eigen::Vector4d(scale.raw_scale, scale.scale, scale.sigma, scale.height))) {
    // No road was measured here: nothing of it leaves, and nothing of it stays.
    impl_->startMap();
    scale = ScaleEstimate();
    scale.reason = ScaleReason::kNoPlane;
    output.points = output.pixels = {};
    output.plane = {};
  }
  if (has_pose) output.pose = impl_->trajectory.append(frame, scale);
  output.mounting_pitch = impl_->mounting.pitch();
  output.mounting_roll = impl_->mounting.roll();
  output.times.total = watch.lapMs();
  return output;
}

}  // namespace ground_scale_vo
