#include "ground_scale_vo/simulation/synthetic_drive.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "ground_scale_vo/common/error.hpp"
#include "synthetic_car.hpp"
#include "synthetic_paint.hpp"
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
constexpr double kOncomingU = 3.55;  // [m] left of the camera's lane
constexpr double kOncomingSpeed = 8, kOncomingStart = 112;  // [m/s, m]
constexpr double kBesideStart = 4.5, kBesideSpacing = 6.5;  // ahead of the camera [m]
constexpr double kFrontAxle = 1.4, kRearAxle = 1.2;         // before and behind the camera [m]
constexpr double kLampsAhead = 1.9, kLampsHeight = 0.65;    // of the camera, over the road [m]
constexpr double kLorryHeight = 3.6, kLorryCutsIn = 1.0;    // [m, s]
constexpr double kOwnWidth = 1.8, kOwnFront = 2, kOwnRear = 2.4;  // the car around the camera [m]

struct Motion {
  double s, v, a;  // along the road [m, m/s, m/s^2]
};

/// Where the car is and how fast. t [s] may lie before or after the drive.
class Timetable {
 public:
  explicit Timetable(const SyntheticDrive::Options& o)
      : v_(o.speed),
        ramp_s_(rampTime(o)),
        stop_s_(o.stop_s),
        stop_m_(o.stop_at_m),
        speeds_(o.speeds) {
    brake_s_ = (stop_m_ - v_ * ramp_s_ / 2) / v_;
  }
  static double rampTime(const SyntheticDrive::Options& o) {
    return kPi * o.speed / (2 * kBraking);
  }

  Motion at(double t) const { return speeds_.empty() ? cruise(t) : byTable(t); }

 private:
  /// Cruise, one stop between cosine ramps, cruise.
  Motion cruise(double t) const {
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

  /// Cosine ramps between the speeds of the table; s = 0 at its first time.
  Motion byTable(double t) const {
    Motion m{0, speeds_.front().speed, 0};
    double since = t - speeds_.front().time_s;
    for (std::size_t k = 1; k < speeds_.size() && since > 0; ++k) {
      const double whole = speeds_[k].time_s - speeds_[k - 1].time_s;
      const double change = speeds_[k].speed - speeds_[k - 1].speed;
      const double part = std::min(since, whole), phase = kPi * part / whole;
      m.s += (m.v + change / 2) * part - change / 2 * whole / kPi * std::sin(phase);
      m.a = since < whole ? change / 2 * kPi / whole * std::sin(phase) : 0;
      m.v += change / 2 * (1 - std::cos(phase));
      since -= part;
    }
    m.s += m.v * since;
    return m;
  }

  double v_, ramp_s_, stop_s_, stop_m_, brake_s_;
  const std::vector<SyntheticDrive::SpeedAt> speeds_;
};

/// World from camera: on the lane, moved by the suspension. The height is that over the plane.
struct Rig {
  Eigen::Isometry3d T_w_c;
  Eigen::Isometry3d T_w_v;  // the car's body: at the camera, its axes without the mounting
  Eigen::Vector3d n_w;      // of the road
  double height;
};

/// The road's frame below the camera. Over edges it is the plane on which the axles stand.
Eigen::Isometry3d standsOn(const Street& street, double s, const SyntheticDrive::Options& o) {
  Eigen::Isometry3d T_w_s = street.frame(s, o.lane_offset);
  if (o.ramp_slope == 0 && o.bump_height == 0) return T_w_s;
  const double front = street.point(s + kFrontAxle, 0).z();
  const double rear = street.point(s - kRearAxle, 0).z();
  const double rise = (front - rear) / (kFrontAxle + kRearAxle);
  const Eigen::Vector3d y = T_w_s.linear().col(1);
  const Eigen::Vector3d x = Eigen::Vector3d(y.y(), -y.x(), rise).normalized();
  T_w_s.linear() << x, y, x.cross(y);
  T_w_s.translation().z() = rear + rise * kRearAxle;
  return T_w_s;
}

Rig rigAt(const Street& street, const Motion& m, const SyntheticDrive::Options& o) {
  const double moving = o.suspension * m.v / o.speed;  // the road shakes only a moving car
  const double lean = o.suspension * 0.0035 * m.v * m.v * street.curvature(m.s);
  const double shake = moving * (0.003 * std::sin(0.9 * m.s) + 0.0018 * std::sin(2.1 * m.s + 1));
  const double nod = o.suspension * 0.004 * m.a;
  const double roll = lean + moving * 0.003 * std::sin(0.7 * m.s + 2);
  const double bounce = moving * (0.012 * std::sin(1.1 * m.s + 0.5) + 0.006 * std::sin(2.3 * m.s));

  const Eigen::Isometry3d T_w_s = standsOn(street, m.s, o);  // x forward, y left, z up
  Rig rig;
  rig.n_w = T_w_s.linear().col(2);
  rig.height = o.camera_height + bounce;
  Eigen::Matrix3d R_s_c;
  R_s_c << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  rig.T_w_c = T_w_s;
  rig.T_w_c.translate(rig.height * Eigen::Vector3d::UnitZ());
  rig.T_w_c.rotate(R_s_c);
  const auto turned = [](Eigen::Isometry3d T, double down, double dip) {
    T.rotate(Eigen::AngleAxisd(-down, Eigen::Vector3d::UnitX()));
    T.rotate(Eigen::AngleAxisd(dip, Eigen::Vector3d::UnitZ()));
    return T;
  };
  rig.T_w_v = turned(rig.T_w_c, shake - nod, roll);
  rig.T_w_c = turned(rig.T_w_c, o.pitch_rad - nod + shake, o.roll_rad + roll);
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
  requireInRange("roll_rad", roll_rad, -0.5, 0.5);
  requireInRange("lane_offset", lane_offset, -3.4, 4.6);
  requireInRange("curvature", curvature, 0, 0.08);
  requireInRange("slope", slope, -0.15, 0.15);
  requireInRange("stop_s", stop_s, 0, 3600);
  if (stop_s > 0 && speeds.empty()) {
    const double braking_m = speed * Timetable::rampTime(*this) / 2;
    requireInRange("stop_at_m (at least the braking distance)", stop_at_m, braking_m, kLongest);
  }
  double time = -1e9, drive_m = speeds.empty() ? speed * frames / frame_rate_hz : 0;
  for (const SpeedAt& at : speeds) {
    requireInRange("speeds.speed", at.speed, -40, 40);
    requireInRange("speeds.time_s (in order)", at.time_s, std::nextafter(time, 1e9), 1e6);
    time = at.time_s;
    drive_m = std::max(drive_m, std::abs(at.speed) * frames / frame_rate_hz);
  }
  requireInRange("suspension", suspension, 0, 5);
  requireInRange("ramp_slope", ramp_slope, -0.2, 0.2);
  if (ramp_slope != 0) {
    requireInRange("ramp_from_m", ramp_from_m, 0, kLongest);
    requireInRange("ramp_to_m (at least 12 m on)", ramp_to_m, ramp_from_m + 12, kLongest);
  }
  requireInRange("bump_height", bump_height, 0, 0.15);
  requireInRange("lead_gap", lead_gap, 3, 150);
  requireInRange("lead_time", lead_time, 0, 10);
  requireInRange("cars_beside", cars_beside, 0, 10);
  requireInRange("oncoming_spacing", oncoming_spacing, 6, 1000);
  requireInRange("lorry_first", lorry_first, 0, 100000);
  requireInRange("lorry_frames", lorry_frames, 0, 100000);
  requireInRange("lorry_gap", lorry_gap, 2, 50);
  requireInRange("lorry_width", lorry_width, 2, 6);
  requireInRange("wall_at_m", wall_at_m, 0, kLongest);
  requireInRange("bridge_from_m", bridge_from_m, -kBehind, kLongest);
  requireInRange("bridge_to_m", bridge_to_m, -kBehind, kLongest);
  requireInRange("underpass_from_m", underpass_from_m, -kBehind, kLongest);
  requireInRange("underpass_to_m", underpass_to_m, -kBehind, kLongest);
  requireInRange("arrow_spacing", arrow_spacing, 0, 1000);
  if (arrow_spacing > 0) requireInRange("arrow_spacing (0: none)", arrow_spacing, 6, 1000);
  requireInRange("road_texture", road_texture, 0, 3);
  requireInRange("grain", grain, 0, 0.5);
  requireInRange("bare_from_m", bare_from_m, -kBehind, kLongest);
  requireInRange("bare_to_m", bare_to_m, -kBehind, kLongest);
  requireInRange("puddles", puddles, 0, 1);
  if (puddles > 0) {  // one mirror
    requireInRange("slope (with puddles)", slope, 0, 0);
    requireInRange("ramp_slope (with puddles)", ramp_slope, 0, 0);
    requireInRange("bump_height (with puddles)", bump_height, 0, 0);
  }
  requireInRange("sun.norm()", sun.norm(), 1e-3, 1e3);
  requireInRange("elevation of the sun [rad]", std::asin(sun.z() / sun.norm()), 0.1, kPi / 2);
  requireInRange("daylight", daylight, 0, 1);
  requireInRange("hood", hood, 0, 0.5);
  requireInRange("noise_sigma", noise_sigma, 0, 50);
  requireInRange("jpeg_quality", jpeg_quality, 0, 100);
  requireInRange("black_first", black_first, 0, 100000);
  requireInRange("black_frames", black_frames, 0, 100000);
  requireInRange("length of the drive [m]", drive_m, 0, kLongest);
}

namespace {

synthetic::RoadShape roadShape(const SyntheticDrive::Options& o) {
  return {o.curvature, o.slope, o.ramp_slope, o.ramp_from_m, o.ramp_to_m, o.bump_height};
}

synthetic::WorldOptions worldOptions(const SyntheticDrive::Options& o) {
  synthetic::WorldOptions world;
  world.seed = o.random_seed;
  world.road_texture = o.road_texture;
  world.lane_markings = o.lane_markings;
  world.shadows = o.shadows;
  world.solid_lines = o.solid_lines;
  world.arrow_spacing = o.arrow_spacing;
  world.grain = o.grain;
  world.cobbles = o.cobbles;
  world.bare_from = o.bare_from_m;
  world.bare_to = o.bare_to_m;
  world.puddles = o.puddles;
  world.bumps = o.bump_height > 0;
  world.parked_cars = o.parked_cars;
  world.wall_at = o.wall_at_m;
  world.off_road = o.off_road;
  world.bridge_from = o.bridge_from_m;
  world.bridge_to = o.bridge_to_m;
  world.underpass_from = o.underpass_from_m;
  world.underpass_to = o.underpass_to_m;
  world.largest_curvature = o.curvature;
  world.sun = o.sun.normalized();
  return world;
}

/// Between the first and the last place of the drive, and what is seen from there.
Street streetFor(const SyntheticDrive::Options& o, const Timetable& timetable) {
  double from = 0, to = 0;
  for (int i = 0; i < o.frames; ++i) {
    const double s = timetable.at(i / o.frame_rate_hz).s;
    from = std::min(from, s);
    to = std::max(to, s);
  }
  return {roadShape(o), from - kBehind, to + kAhead};
}

}  // namespace

struct SyntheticDrive::Impl {
  explicit Impl(const Options& o)
      : options(o), timetable(o), street(streetFor(o, timetable)), world(street, worldOptions(o)) {
    if (o.hood > 0) {
      hood_skin.emplace(synthetic::hoodImage(o.random_seed), synthetic::kCarTexel,
                        synthetic::Texture::Wrap::kClamp);
      hood = synthetic::hoodMesh(*hood_skin, o.camera, o.hood);
    }
    if (o.lorry_frames > 0) {
      lorry_skin.emplace(synthetic::grey(synthetic::noiseTile({512, 512}, o.random_seed + 55,
                                                              {{1.5, 1}, {5, 1}, {20, 1}}),
                                         105, 18),
                         synthetic::kCarTexel, synthetic::Texture::Wrap::kRepeat);
      lorry = world.van();
      for (synthetic::Mesh::Triangle& triangle : lorry.triangles) triangle.texture = &*lorry_skin;
      for (synthetic::Vertex& vertex : lorry.vertices) {
        vertex.p.y() *= o.lorry_width / synthetic::kVanWidth;
        vertex.p.z() *= kLorryHeight / synthetic::kVanHeight;
      }
      lorry.bound();
    }
    for (int i = 0; i < o.frames; ++i) {
      const double t = i / o.frame_rate_hz;
      const Motion motion = timetable.at(t);
      const Rig rig = rigAt(street, motion, o);
      T_w_c.push_back(rig.T_w_c);
      T_w_v.push_back(rig.T_w_v);
      stations.push_back(motion.s);
      Frame frame;
      frame.stamp_ns = std::llround(t * 1e9);
      if (i > 0) frame.T_c0_c = T_w_c.front().inverse() * rig.T_w_c;
      frame.n_c = rig.T_w_c.linear().transpose() * rig.n_w;
      frame.height = rig.height;
      frame.speed = motion.v;
      frames.push_back(frame);
    }
  }

  void addVehicle(Scene& scene, const synthetic::Mesh& mesh, const Eigen::Vector2d& size, double s,
                  double u, bool oncoming) const {
    if (s < street.from() + 5 || s > street.to() - 5) return;
    Eigen::Isometry3d T_w_m = street.frame(s, u);
    if (oncoming) T_w_m.rotate(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ()));
    scene.instances.push_back({&mesh, T_w_m});
    if (!options.shadows) return;
    scene.shadows.push_back({world.roadTexture(s, u), {size.x() / 2, size.y() / 2}});
  }

  void addTraffic(Scene& scene, double t) const {
    const Eigen::Vector2d car(synthetic::kCarWidth, synthetic::kCarLength);
    const Eigen::Vector2d van(synthetic::kVanWidth, synthetic::kVanLength);
    const Eigen::Vector2d& lead = options.lead_van ? van : car;
    addVehicle(scene, options.lead_van ? world.van() : world.car(2), lead,
               timetable.at(t + options.lead_time).s + (options.lead_gap + lead.y() / 2), 0, false);
    for (int k = 0; k < options.cars_beside; ++k) {
      const double s = timetable.at(t + 0.3 * k).s + kBesideStart + k * kBesideSpacing;
      addVehicle(scene, world.car(static_cast<std::size_t>(k) + 3), car, s, kOncomingU, false);
    }
    if (options.cars_beside > 0) return;
    for (int k = 0; k * options.oncoming_spacing < 2 * kLongest; ++k) {
      const double s = kOncomingStart + k * options.oncoming_spacing - kOncomingSpeed * t;
      addVehicle(scene, world.car(static_cast<std::size_t>(k) + 3), car, s, kOncomingU, true);
    }
  }

  /// It keeps pace, but for what drivers do not manage: some decimetres to the side and in the gap.
  void addLorry(Scene& scene, std::size_t i) const {
    const double first = options.lorry_first, last = first + options.lorry_frames - 1;
    const auto at = static_cast<double>(i);
    if (at < first || at > last) return;
    const double t = at / options.frame_rate_hz;
    const double inside = std::min(at - first, last - at) / options.frame_rate_hz / kLorryCutsIn;
    const double aside =
        inside < 1 ? (1 + std::cos(kPi * inside)) / 2 * (kOncomingU + options.lorry_width) : 0;
    const double moving = frames[i].speed / options.speed;
    const double sway = 0.06 * moving * std::sin(0.9 * t), gap = 0.15 * std::sin(0.7 * t) * moving;
    addVehicle(scene, lorry, {options.lorry_width, synthetic::kVanLength},
               stations[i] + options.lorry_gap + gap + synthetic::kVanLength / 2,
               options.lane_offset + sway + aside, false);
  }

  /// Sill, bonnet and roof of the car around the camera, thrown along the sun's rays: the hull.
  synthetic::OutlineShadow ownShadow(double s) const {
    const double heading = street.heading(s);
    const Eigen::Vector3d sun =
        Eigen::AngleAxisd(-heading, Eigen::Vector3d::UnitZ()) * options.sun.normalized();
    const double roof = options.camera_height, half = kOwnWidth / 2;
    std::vector<cv::Point2f> fallen;
    const auto box = [&](double rear, double front, double width, double z) {
      for (const double x : {rear, front}) {
        for (const double y : {-width, width}) {
          const Eigen::Vector2d at = world.roadTexture(
              s + x - sun.x() / sun.z() * z, options.lane_offset + y - sun.y() / sun.z() * z);
          fallen.emplace_back(static_cast<float>(at.x()), static_cast<float>(at.y()));
        }
      }
    };
    box(-kOwnRear, kOwnFront, half, 0.2);
    box(-kOwnRear, kOwnFront, half, 0.55 * roof);
    box(-0.8 * kOwnRear, 0.2 * kOwnFront, 0.75 * half, roof);
    std::vector<cv::Point2f> hull;
    cv::convexHull(fallen, hull);
    synthetic::OutlineShadow shadow;
    Eigen::Vector2d middle(0, 0);
    for (const cv::Point2f& p : hull) middle += Eigen::Vector2d(p.x, p.y);
    middle /= static_cast<double>(hull.size());
    for (std::size_t k = 0; k < hull.size(); ++k) {
      const cv::Point2f &a = hull[k], &b = hull[(k + 1) % hull.size()];
      const Eigen::Vector2d from(a.x, a.y), to(b.x, b.y);
      Eigen::Vector2d normal(from.y() - to.y(), to.x() - from.x());
      if (normal.norm() < 1e-3) continue;
      normal.normalize();
      if (normal.dot(middle - from) < 0) normal = -normal;
      shadow.edges.emplace_back(normal.x(), normal.y(), -normal.dot(from));
    }
    return shadow;
  }

  Scene sceneAt(std::size_t i) const {
    Scene scene = world.scene();
    if (options.moving_cars) addTraffic(scene, static_cast<double>(frames[i].stamp_ns) * 1e-9);
    if (options.lorry_frames > 0) addLorry(scene, i);
    if (options.own_shadow) scene.own_shadow = ownShadow(stations[i]);
    if (options.hood > 0) scene.instances.push_back({&hood, T_w_c[i], false});
    scene.hood = hood_skin ? &*hood_skin : nullptr;
    scene.hood_share = options.hood;
    scene.daylight = options.daylight;
    if (options.headlamps) {
      scene.T_w_lamps = T_w_v[i];
      scene.T_w_lamps->translate(
          Eigen::Vector3d(0, options.camera_height - kLampsHeight, kLampsAhead));
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
  std::vector<Eigen::Isometry3d> T_w_c, T_w_v;
  std::vector<double> stations;  // along the road
  std::vector<Frame> frames;
  std::optional<synthetic::Texture> hood_skin, lorry_skin;
  synthetic::Mesh hood, lorry;
};

SyntheticDrive::SyntheticDrive(const Options& options) {
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}

SyntheticDrive::~SyntheticDrive() = default;

const PinholeCamera& SyntheticDrive::camera() const { return impl_->options.camera; }
double SyntheticDrive::cameraHeight() const { return impl_->options.camera_height; }
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
  if (impl_->options.jpeg_quality > 0) {
    std::vector<uchar> file;
    cv::imencode(".jpg", image, file, {cv::IMWRITE_JPEG_QUALITY, impl_->options.jpeg_quality});
    image = cv::imdecode(file, cv::IMREAD_GRAYSCALE);
  }
  return image;
}

}  // namespace ground_scale_vo
