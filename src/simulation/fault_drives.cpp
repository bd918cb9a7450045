#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "simulation/rendering/random.hpp"

namespace ground_scale_vo {
namespace {

using Options = SyntheticDrive::Options;
using simulation::Random;

constexpr const char *kLorry = "lorry", *kWall = "wall";
constexpr double kLorryS = 10, kLorryEdgeS = 1;  // it takes so long to cut in, and to leave [s]
constexpr double kStartS = 4.5, kStretchS = 3;   // clean: at the start, and beyond settling [s]
constexpr double kWallFillsM = 7, kStopsBefore = 1.8;  // the picture; hardly any road is seen [m]
constexpr double kSlack = 0.05, kSlackM = 1;  // of way that is not invented but badly measured
constexpr double kSigmas = 3;

const std::vector<ImageFault>& imageFaults() {
  static const std::vector<ImageFault> all{ImageFault::kBlack,        ImageFault::kWhite,
                                           ImageFault::kFrozen,       ImageFault::kCovered,
                                           ImageFault::kCoveredBelow, ImageFault::kCoveredLeft,
                                           ImageFault::kRain,         ImageFault::kDarker,
                                           ImageFault::kBrighter,     ImageFault::kFlicker};
  return all;
}

template <typename T>
void shuffle(std::vector<T>* values, Random* random) {
  for (std::size_t i = values->size(); i > 1; --i) {
    std::swap((*values)[i - 1], (*values)[random->bits() % i]);
  }
}

/// Camera, speed and street.
Options someDrive(Random* random) {
  struct Camera {
    int width, height;
    double focal;
  };
  static const Camera kCameras[] = {{480, 150, 278}, {440, 180, 220}, {520, 160, 320}};
  const Camera& c = kCameras[random->bits() % std::size(kCameras)];
  Options o;
  o.random_seed = random->bits() % 100000;
  o.camera = {};
  o.camera.width = c.width;
  o.camera.height = c.height;
  o.camera.fx = o.camera.fy = c.focal;
  o.camera.cx = (c.width - 1) / 2.0;
  o.camera.cy = (c.height - 1) / 2.0;
  o.camera_height = random->uniform(1.3, 2.1);
  o.frame_rate_hz = random->chance(0.5) ? 10 : 12;
  o.speed = random->uniform(6.5, 12);
  o.pitch_rad = random->uniform(0, 0.05);
  o.curvature = random->uniform(0, 1.0 / 40);
  o.slope = random->uniform(0, 0.03);
  o.stop_s = 0;
  o.moving_cars = random->chance(0.6);
  return o;
}

/// Puts faults one after the other into the drive, which becomes as long as they need.
class Plan {
 public:
  Plan(std::string name, const Options& options, Random* random)
      : drive_{std::move(name), options, {}}, random_(random), s_(kStartS) {}

  void add(ImageFault fault) {
    const bool hides = hidesTheGround(fault);
    const double duration = hides ? random_->uniform(3.3, 4.5) : random_->uniform(1, 3);
    place({toString(fault), fault, 0, 0, hides, random_->bits()}, duration);
  }
  void addLorry() {
    Options& o = drive_.options;
    o.lorry_width = random_->uniform(4.6, 5.2);
    o.lorry_gap = random_->uniform(2.2, 2.5);
    o.lorry_frames = frames(kLorryS + 2 * kLorryEdgeS);
    o.lorry_first = frames(s_);
    s_ += kLorryEdgeS;
    place({kLorry, {}, 0, 0, true, 0}, kLorryS);
    drive_.faults.back().first -= static_cast<std::size_t>(frames(kLorryEdgeS));
    drive_.faults.back().last += static_cast<std::size_t>(frames(kLorryEdgeS));
    s_ += kLorryEdgeS;
  }
  /// Up to a wall, a stop, and back; always the last.
  void addWall() {
    constexpr double kBrakeS = 2.5, kStandS = 2, kGoS = 1, kBack = -3;
    Options& o = drive_.options;
    o.curvature = o.slope = 0;
    o.moving_cars = false;
    const double v = std::min(o.speed, 8.0), brake = s_, stand = brake + kBrakeS;
    o.speeds = {
        {0, v}, {brake, v}, {stand, 0}, {stand + kStandS, 0}, {stand + kStandS + kGoS, kBack}};
    o.wall_at_m = v * brake + v * kBrakeS / 2 + kStopsBefore;
    // Cosine ramps: the last metres before and the first after the stop.
    double from = stand, to = stand + kStandS;
    const auto left = [&](double t) {  // metres before the stop
      const double x = (stand - t) / kBrakeS;
      return v * kBrakeS / 2 * (x - std::sin(M_PI * x) / M_PI);
    };
    while (from > brake && left(from) < kWallFillsM - kStopsBefore) from -= 0.05;
    // Back to where the lower edge of the picture shows road again.
    const double down = (o.camera.height - 1 - o.camera.cy) / o.camera.fy + o.pitch_rad;
    to += kGoS / 2 + (0.9 * o.camera_height / down - kStopsBefore) / -kBack;
    PlacedFault fault{kWall, {}, 0, 0, true, 0};
    fault.first = static_cast<std::size_t>(frames(from));
    fault.last = static_cast<std::size_t>(frames(to));
    drive_.faults.push_back(fault);
    s_ = to + kSettleM / -kBack + kStretchS + 2;
  }
  FaultDrive finish() {
    drive_.options.frames = frames(s_);
    return std::move(drive_);
  }

 private:
  int frames(double seconds) const {
    return static_cast<int>(std::lround(seconds * drive_.options.frame_rate_hz));
  }
  void place(PlacedFault fault, double duration) {
    fault.first = static_cast<std::size_t>(frames(s_));
    fault.last = static_cast<std::size_t>(frames(s_ + duration)) - 1;
    drive_.faults.push_back(fault);
    s_ += duration + std::max(kSettleS, kSettleM / drive_.options.speed) + kStretchS;
  }

  FaultDrive drive_;
  Random* random_;
  double s_;
};

template <typename Derived>
bool finite(const Eigen::DenseBase<Derived>& values) {
  return values.derived().array().isFinite().all();
}
bool finite(const Eigen::Isometry3d& T) { return finite(T.matrix()); }
bool finite(double value) { return std::isfinite(value); }

/// Metres travelled up to each frame.
std::vector<double> ways(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> result(poses.size(), 0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    result[i] = result[i - 1] + (poses[i].translation() - poses[i - 1].translation()).norm();
  }
  return result;
}

/// Between the true and the estimated place at b, seen from a [m].
double relativeError(const std::vector<Eigen::Isometry3d>& truth,
                     const std::vector<Eigen::Isometry3d>& estimate, std::size_t a, std::size_t b) {
  const Eigen::Isometry3d T = truth[a].inverse() * truth[b];
  const Eigen::Isometry3d E = estimate[a].inverse() * estimate[b];
  return (T.translation() - E.translation()).norm();
}

}  // namespace

std::vector<std::string> faultNames() {
  std::vector<std::string> names{kLorry, kWall};
  for (const ImageFault fault : imageFaults()) names.emplace_back(toString(fault));
  return names;
}

FaultDrive faultDrive(std::size_t i, std::uint64_t seed) {
  requireInRange("the number of the drive", static_cast<double>(i), 0, kFaultDrives - 1);
  // The deck is the same for all drives: what hides the ground, and what does not.
  Random deck(seed);
  std::vector<std::string> hiding{kLorry, kWall}, light;
  for (const ImageFault fault : imageFaults()) {
    (hidesTheGround(fault) ? hiding : light).emplace_back(toString(fault));
  }
  const auto fill = [&](std::vector<std::string>* names, std::size_t again_from) {
    for (std::size_t k = again_from; names->size() < kFaultDrives; ++k) {
      names->push_back((*names)[k]);
    }
    shuffle(names, &deck);
  };
  fill(&light, 0);
  fill(&hiding, 2);  // lorry and wall take long: once is enough

  Random random(seed + 1000 * (i + 1));
  const Options options = someDrive(&random);
  Plan plan("drive " + std::to_string(i), options, &random);
  const auto add = [&](const std::string& name) {
    if (name == kLorry) return plan.addLorry();
    if (name == kWall) return plan.addWall();
    for (const ImageFault fault : imageFaults()) {
      if (name == toString(fault)) return plan.add(fault);
    }
  };
  const bool hidden_last = hiding[i] == kWall || random.chance(0.5);
  add(hidden_last ? light[i] : hiding[i]);
  add(hidden_last ? hiding[i] : light[i]);
  return plan.finish();
}

FaultDrive faultDrive(const std::string& what, std::uint64_t seed) {
  Random random(seed);
  Options options = someDrive(&random);
  Plan plan(what, options, &random);
  if (what == kLorry) {
    plan.addLorry();
    return plan.finish();
  }
  if (what == kWall) {
    plan.addWall();
    return plan.finish();
  }
  std::string names = std::string(kLorry) + ", " + kWall;
  for (const ImageFault fault : imageFaults()) {
    if (what == toString(fault)) {
      plan.add(fault);
      return plan.finish();
    }
    names += std::string(", ") + toString(fault);
  }
  throw OptionError("'" + what + "' is no fault, these are: " + names);
}

bool isFinite(const VisualOdometry::Output& vo) {
  bool all = finite(vo.frame.T_w_c);
  for (const TrackedFeature& feature : vo.frame.features) {
    all = all && finite(feature.u);
    if (feature.has_point) all = all && finite(feature.p_c) && std::isfinite(feature.depth_sigma);
  }
  for (const auto& start : vo.start) all = all && finite(start.T_w_c);
  for (const auto& rejected : vo.rejected) all = all && finite(rejected.u);
  return all;
}

bool isFinite(const ScaleRecovery::Output& output) {
  const ScaleEstimate& s = output.scale;
  bool all = finite(s.raw_scale) && finite(s.scale) && finite(s.sigma) && finite(s.height) &&
             finite(s.n_c) && finite(output.plane.n_c) && finite(output.plane.height) &&
             finite(output.correlation) && finite(output.mounting_pitch) &&
             finite(output.mounting_roll);
  for (const auto& m : {output.points, output.pixels}) {
    all = all && finite(m.height) && finite(m.sigma);
  }
  for (const Eigen::Vector3f& point : output.ground_points_c) all = all && finite(point);
  if (!output.pose) return all;
  const MetricPose& pose = *output.pose;
  return all && finite(pose.T_o_c) && finite(pose.covariance) && finite(pose.twist_c) &&
         finite(pose.twist_covariance) && finite(pose.distance) &&
         pose.covariance.diagonal().minCoeff() >= 0;
}

FaultRunFigures runFaultDrive(
    const FaultDrive& placed,
    const std::function<void(std::size_t, const cv::Mat&, const OfflineRun&)>& each) {
  const SyntheticDrive drive(placed.options);
  OfflineRun::Options options;
  options.scale.camera_height = drive.cameraHeight();
  OfflineRun run(drive.camera(), options);

  FaultRunFigures figures;
  figures.frames = drive.size();
  std::vector<Eigen::Isometry3d> truth;
  std::vector<double> variance;  // of the position, as last said [m^2]
  cv::Mat last_good;
  auto fault = placed.faults.begin();
  for (std::size_t i = 0; i < drive.size(); ++i) {
    while (fault != placed.faults.end() && i > fault->last) ++fault;
    const bool spoiled = fault != placed.faults.end() && fault->image && i >= fault->first;
    cv::Mat image = spoiled && !needsTheScene(*fault->image) ? cv::Mat() : drive.image(i);
    if (spoiled) {
      image = withFault(*fault->image, image, last_good, i - fault->first, fault->seed);
    } else {
      last_good = image;
    }
    run.process(image, drive.frame(i).stamp_ns);
    const ScaleRecovery::Output& scale = run.last().scale;
    figures.non_finite_frames += !isFinite(run.last().vo) || !isFinite(scale);
    truth.push_back(drive.frame(i).T_c0_c);
    const double before = variance.empty() ? 0 : variance.back();
    variance.push_back(scale.pose ? scale.pose->covariance.topLeftCorner<3, 3>().trace() : before);
    if (each) each(i, image, run);
  }

  const std::vector<RunFrame>& frames = run.record().frames();
  figures.tracked_frames = run.record().trackedFrames();
  const std::vector<Eigen::Isometry3d> estimate = run.record().metricPoses();
  const std::vector<double> true_way = ways(truth), way = ways(estimate);
  const double rate = placed.options.frame_rate_hz;
  const auto settled = [&](std::size_t from) {
    std::size_t i = from;
    while (i + 1 < frames.size() && (static_cast<double>(i - from) < kSettleS * rate ||
                                     true_way[i] - true_way[from] < kSettleM)) {
      ++i;
    }
    return i;
  };
  const auto isOk = [&](std::size_t i) { return frames[i].scale.status == ScaleStatus::kOk; };

  std::size_t clean_from = settled(0);
  const auto addStretch = [&](std::size_t last) {
    const double length = true_way[last] - true_way[clean_from];
    if (last <= clean_from || length < kShortestStretch) return;
    const double error = relativeError(truth, estimate, clean_from, last);
    figures.stretches.push_back({clean_from, last, length, 100 * error / length});
  };
  for (const PlacedFault& at : placed.faults) {
    addStretch(at.first - 1);
    FaultFigures f;
    f.what = at.what;
    f.hides = at.hides;
    f.duration_s = static_cast<double>(at.last - at.first + 1) / rate;
    f.said_after_s = std::numeric_limits<double>::quiet_NaN();
    for (std::size_t i = at.first; i <= at.last; ++i) {
      const double since = static_cast<double>(i - at.first) / rate;
      const bool said =
          frames[i].vo_status == VoStatus::kLost || frames[i].scale.status == ScaleStatus::kHeld;
      if (said && std::isnan(f.said_after_s)) f.said_after_s = since;
      f.ok_frames += since >= kLatestWord && isOk(i);
    }
    f.tracking_after = f.metric_after = -1;
    for (std::size_t i = frames.size() - 1; i > at.last; --i) {
      const auto after = static_cast<int>(i - at.last - 1);
      if (frames[i].vo_status == VoStatus::kTracking) f.tracking_after = after;
      if (isOk(i) && frames[i].has_metric_pose) f.metric_after = after;
    }
    const std::size_t begin = at.first - 1;
    clean_from = settled(at.last + 1);
    const double true_m = true_way[clean_from] - true_way[begin];
    f.invented_m = std::max(0.0, way[clean_from] - way[begin] - true_m);
    f.missed_m = relativeError(truth, estimate, begin, clean_from);
    f.sigma_m = std::sqrt(std::max(0.0, variance[clean_from] - variance[begin]));
    figures.faults.push_back(f);
  }
  addStretch(frames.size() - 1);
  return figures;
}

std::string violatedThreshold(const FaultRunFigures& figures) {
  char text[200];
  const auto say = [&](auto... values) {
    std::snprintf(text, sizeof text, values...);
    return std::string(text);
  };
  if (figures.non_finite_frames > 0) {
    return say("%zu frames hold a number that is not finite", figures.non_finite_frames);
  }
  if (figures.stretches.empty()) return "no stretch without a fault is long enough";
  for (const StretchFigures& s : figures.stretches) {
    if (s.error_percent <= kStretchBarPercent) continue;  // nor when it is no number
    return say("frames %zu to %zu are wrong by %.1f %%", s.first, s.last, s.error_percent);
  }
  for (const FaultFigures& f : figures.faults) {
    const char* what = f.what.c_str();
    if (f.hides && !(f.said_after_s <= kLatestWord)) {
      return say("%s: neither HELD nor LOST within %.0f s", what, kLatestWord);
    }
    if (f.hides && f.ok_frames > 0) {
      return say("%s: measured in %zu frames in which nothing can be", what, f.ok_frames);
    }
    if (f.metric_after < 0) return say("%s: no metric pose after it", what);
    if (f.invented_m > kSlackM + kSlack * f.missed_m) {
      return say("%s: %.1f m of way are invented", what, f.invented_m);
    }
    if (f.missed_m > kSlackM + kSigmas * f.sigma_m) {
      return say("%s: %.1f m are missed, sigma is %.1f m", what, f.missed_m, f.sigma_m);
    }
  }
  return "";
}

}  // namespace ground_scale_vo
