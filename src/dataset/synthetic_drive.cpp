#include "ground_scale_vo/dataset/synthetic_drive.hpp"

#include <algorithm>
#include <cmath>

#include "ground_scale_vo/error.hpp"
#include "synthetic_car.hpp"
#include "synthetic_renderer.hpp"
#include "synthetic_street.hpp"
#include "synthetic_world.hpp"

namespace ground_scale_vo {
namespace {

using synthetic::kPi;
using synthetic::Scene;
using synthetic::Street;
using synthetic::World;

constexpr double kBraking = 3;       // largest acceleration, braking and starting [m/s^2]
constexpr double kBehind = 25;       // the street begins before the first frame, and goes on
constexpr double kAhead = 190;       // after the last [m]
constexpr double kLongest = 3000;    // drive [m]
constexpr double kLeadGap = 9;       // the car ahead: as the camera was, kLeadTime later, so far on
constexpr double kLeadTime = 1.2;    // [s]
constexpr double kOncomingU = 3.55;  // [m] left of the camera's lane
constexpr double kOncomingSpeed = 8, kOncomingStart = 112, kOncomingSpacing = 150;  // [m/s, m, m]

struct Motion {
  double s, v, a;  // along the road [m, m/s, m/s^2]
};

/// Cruise, one stop between cosine ramps, cruise. t [s] may lie before or after the drive.
class Timetable {
 public:
  explicit Timetable(const SyntheticDrive::Options& o)
      : v_(o.speed), ramp_s_(rampTime(o)), stop_s_(o.stop_s), stop_m_(o.stop_at_m) {
    brake_s_ = (stop_m_ - v_ * ramp_s_ / 2) / v_;
  }
  static double rampTime(const SyntheticDrive::Options& o) {
    return kPi * o.speed / (2 * kBraking);
  }

  Motion at(double t) const {
    if (stop_s_ <= 0 || t <= brake_s_) return {v_ * t, v_, 0};
    const double stands = brake_s_ + ramp_s_, starts = stands + stop_s_;
    if (t >= stands && t <= starts) return {stop_m_, 0, 0};
    // The ramp's own clock: time to or from the standstill.
    const double since = t < stands ? stands - t : t - starts, sign = t < stands ? -1 : 1;
    if (since >= ramp_s_) return {stop_m_ + v_ * (since - ramp_s_ / 2), v_, 0};
    const double phase = kPi * since / ramp_s_;
    return {stop_m_ + sign * v_ / 2 * (since - ramp_s_ / kPi * std::sin(phase)),
            v_ / 2 * (1 - std::cos(phase)), sign * v_ / 2 * kPi / ramp_s_ * std::sin(phase)};
  }

 private:
  double v_, ramp_s_, stop_s_, stop_m_, brake_s_;
};

/// World from camera: on the lane, moved by the suspension. The height is that over the plane.
struct Rig {
  Eigen::Isometry3d T_w_c;
  Eigen::Vector3d n_w;  // of the road
  double height;
};

Rig rigAt(const Street& street, const Motion& m, const SyntheticDrive::Options& o) {
  const double moving = o.suspension * m.v / o.speed;  // the road shakes only a moving car
  const double lean = o.suspension * 0.0035 * m.v * m.v * street.curvature(m.s);
  const double down = o.pitch_rad - o.suspension * 0.004 * m.a +
                      moving * (0.003 * std::sin(0.9 * m.s) + 0.0018 * std::sin(2.1 * m.s + 1));
  const double roll = lean + moving * 0.003 * std::sin(0.7 * m.s + 2);
  const double bounce = moving * (0.012 * std::sin(1.1 * m.s + 0.5) + 0.006 * std::sin(2.3 * m.s));

  const Eigen::Isometry3d T_w_s = street.frame(m.s, 0);  // x forward, y left, z up
  Rig rig;
  rig.n_w = T_w_s.linear().col(2);
  rig.height = o.camera_height + bounce;
  Eigen::Matrix3d R_s_c;
  R_s_c << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  rig.T_w_c = T_w_s;
  rig.T_w_c.translate(rig.height * Eigen::Vector3d::UnitZ());
  rig.T_w_c.rotate(R_s_c);
  rig.T_w_c.rotate(Eigen::AngleAxisd(-down, Eigen::Vector3d::UnitX()));
  rig.T_w_c.rotate(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
  return rig;
}

}  // namespace

SyntheticDrive::Options::Options() {
  camera.width = 800;
  camera.height = 248;
  camera.fx = camera.fy = 464;
  camera.cx = 394;
  camera.cy = 121;
}

void SyntheticDrive::Options::validate() const {
  camera.validate();
  requireInRange("camera.width", camera.width, 16, 8192);
  requireInRange("camera.height", camera.height, 16, 8192);
  requireInRange("camera_height", camera_height, 0.3, 4);
  requireInRange("frame_rate_hz", frame_rate_hz, 0.1, 1000);
  requireInRange("frames", frames, 1, 100000);
  requireInRange("speed", speed, 0.1, 40);
  requireInRange("pitch_rad", pitch_rad, -0.5, 0.5);
  requireInRange("curvature", curvature, 0, 0.035);
  requireInRange("slope", slope, -0.15, 0.15);
  requireInRange("stop_s", stop_s, 0, 3600);
  if (stop_s > 0) {
    const double braking_m = speed * Timetable::rampTime(*this) / 2;
    requireInRange("stop_at_m (at least the braking distance)", stop_at_m, braking_m, kLongest);
  }
  requireInRange("suspension", suspension, 0, 5);
  requireInRange("road_texture", road_texture, 0, 3);
  requireInRange("noise_sigma", noise_sigma, 0, 50);
  requireInRange("black_first", black_first, 0, 100000);
  requireInRange("black_frames", black_frames, 0, 100000);
  requireInRange("length of the drive [m]", speed * frames / frame_rate_hz, 0, kLongest);
}

struct SyntheticDrive::Impl {
  static double lastStation(const Options& o, const Timetable& timetable) {
    return timetable.at((o.frames - 1) / o.frame_rate_hz).s;
  }

  explicit Impl(const Options& o)
      : options(o),
        timetable(o),
        street(o.curvature, o.slope, -kBehind, lastStation(o, timetable) + kAhead),
        world(street, {o.random_seed, o.road_texture, o.lane_markings, o.shadows}) {
    for (int i = 0; i < o.frames; ++i) {
      const double t = i / o.frame_rate_hz;
      const Motion motion = timetable.at(t);
      const Rig rig = rigAt(street, motion, o);
      T_w_c.push_back(rig.T_w_c);
      Frame frame;
      frame.stamp_ns = std::llround(t * 1e9);
      if (i > 0) frame.T_c0_c = T_w_c.front().inverse() * rig.T_w_c;
      frame.n_c = rig.T_w_c.linear().transpose() * rig.n_w;
      frame.height = rig.height;
      frame.speed = motion.v;
      frames.push_back(frame);
    }
  }

  void addCar(Scene& scene, double s, double u, bool oncoming, std::size_t kind) const {
    if (s < street.from() + 5 || s > street.to() - 5) return;
    Eigen::Isometry3d T_w_m = street.frame(s, u);
    if (oncoming) T_w_m.rotate(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ()));
    scene.instances.push_back({&world.car(kind), T_w_m});
    if (!options.shadows) return;
    scene.shadows.push_back(
        {world.roadTexture(s, u), {synthetic::kCarWidth / 2, synthetic::kCarLength / 2}});
  }

  Scene sceneAt(std::size_t i) const {
    Scene scene = world.scene();
    if (!options.moving_cars) return scene;
    const double t = static_cast<double>(frames[i].stamp_ns) * 1e-9;
    addCar(scene, timetable.at(t + kLeadTime).s + kLeadGap, 0, false, 2);
    for (int k = 0; k * kOncomingSpacing < 2 * kLongest; ++k) {
      const double s = kOncomingStart + k * kOncomingSpacing - kOncomingSpeed * t;
      addCar(scene, s, kOncomingU, true, static_cast<std::size_t>(k) + 3);
    }
    return scene;
  }

  bool black(std::size_t i) const {
    const auto k = static_cast<long>(i);
    return k >= options.black_first &&
           k < static_cast<long>(options.black_first) + options.black_frames;
  }

  const Options options;
  const Timetable timetable;
  const Street street;
  const World world;
  std::vector<Eigen::Isometry3d> T_w_c;
  std::vector<Frame> frames;
};

SyntheticDrive::SyntheticDrive(const Options& options) {
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}

SyntheticDrive::~SyntheticDrive() = default;

const PinholeCamera& SyntheticDrive::camera() const { return impl_->options.camera; }
std::size_t SyntheticDrive::size() const { return impl_->frames.size(); }
const SyntheticDrive::Frame& SyntheticDrive::frame(std::size_t i) const {
  return impl_->frames.at(i);
}

cv::Mat SyntheticDrive::image(std::size_t i) const {
  const PinholeCamera& camera = impl_->options.camera;
  const Eigen::Isometry3d& T_w_c = impl_->T_w_c.at(i);
  if (impl_->black(i)) return cv::Mat::zeros(camera.height, camera.width, CV_8U);
  cv::Mat grey = synthetic::render(impl_->sceneAt(i), camera, T_w_c);
  if (impl_->options.noise_sigma > 0) {
    cv::RNG rng(synthetic::Random(impl_->options.random_seed + 0x10001 * (i + 1)).bits());
    cv::Mat noise(grey.size(), CV_32F);
    rng.fill(noise, cv::RNG::NORMAL, 0, impl_->options.noise_sigma);
    grey += noise;
  }
  cv::Mat image;
  grey.convertTo(image, CV_8U);
  return image;
}

}  // namespace ground_scale_vo
