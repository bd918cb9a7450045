#include "simulation/synthetic_drive.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <utility>

#include "simulation/image_faults.hpp"
#include "simulation/renderer/random.hpp"
#include "simulation/renderer/scene.hpp"
#include "simulation/world/motion.hpp"
#include "simulation/world/recorded_path.hpp"
#include "simulation/world/road_geometry.hpp"
#include "simulation/world/traffic.hpp"
#include "simulation/world/vehicles.hpp"
#include "simulation/world/world.hpp"

namespace gsv {
namespace {

using simulation::RecordedPath;
using simulation::RoadGeometry;
using simulation::Scene;
using simulation::SpeedProfile;

/// With a rolling shutter so many rows have one pose. At 20 m/s and a readout of 30 ms the nearest
/// road of the default camera moves by 0.05 px a row, so that rows are displaced by less than 0.1
/// px.
constexpr int kStripRows = 4;

constexpr double kLampsAhead = 1.9, kLampsHeight = 0.65;  // [m] ahead of the camera, above the road

/// nullptr for a generated road.
std::shared_ptr<const RecordedPath> recordedPath(const SyntheticDrive::Options& o) {
  if (o.path.empty()) return nullptr;
  return std::make_shared<RecordedPath>(o.path, o.frame_rate_hz);
}

/// With a unit vector towards the sun, and with the top speed of a recorded path, if it is higher
/// than the given speed, which scales the vibrations.
SyntheticDrive::Options completed(SyntheticDrive::Options o,
                                  const std::shared_ptr<const RecordedPath>& path) {
  o.sun.normalize();
  if (path) o.speed = std::max(o.speed, path->topSpeed());
  return o;
}

/// The road from kRoadBehind behind the first camera position to kRoadAhead ahead of the last one;
/// as far behind as ahead when the camera looks sideways or back.
RoadGeometry roadFor(const SyntheticDrive::Options& o, const SpeedProfile& profile,
                     std::shared_ptr<const RecordedPath> path) {
  double from = 0, to = 0;
  for (int i = 0; i < o.frames; ++i) {
    const double s = profile.at(i / o.frame_rate_hz).s;
    from = std::min(from, s);
    to = std::max(to, s);
  }
  const bool looks_ahead = std::abs(o.yaw_rad) < M_PI / 3;
  return {o, std::move(path),
          from - (looks_ahead ? simulation::kRoadBehind : simulation::kRoadAhead),
          to + simulation::kRoadAhead};
}

/// Sensor: noise, quantisation and compression. index: of the image, seeds the noise.
cv::Mat sensorImage(cv::Mat grey, std::size_t index, const SyntheticDrive::Options& o) {
  if (o.noise_sigma > 0) {
    const std::uint64_t seed =
        o.random_seed + 0x10001 * (index + 1) + 0x9E3779B97F4A7C15u * (o.noise_seed - 1);
    cv::RNG rng(simulation::Random(seed).bits());
    cv::Mat noise(grey.size(), CV_32F);
    rng.fill(noise, cv::RNG::NORMAL, 0, o.noise_sigma);
    grey += noise;
  }
  cv::Mat image;
  grey.convertTo(image, CV_8U);
  if (o.jpeg_quality > 0) {
    std::vector<uchar> file;
    cv::imencode(".jpg", image, file, {cv::IMWRITE_JPEG_QUALITY, o.jpeg_quality});
    image = cv::imdecode(file, cv::IMREAD_GRAYSCALE);
  }
  return image;
}

}  // namespace

struct SyntheticDrive::Impl {
  /// What only images need. It takes as long to build as ten images take to render.
  struct Content {
    explicit Content(const Impl& drive)
        : world(drive.road, drive.options),
          traffic(drive.options, drive.profile, drive.road, world) {}
    const simulation::World world;
    const simulation::Traffic traffic;
  };

  explicit Impl(const Options& o) : Impl(o, recordedPath(o)) {}
  Impl(const Options& o, const std::shared_ptr<const RecordedPath>& path)
      : options(completed(o, path)), profile(o, path), road(roadFor(options, profile, path)) {
    if (o.hood > 0) {
      hood_texture.emplace(simulation::hoodTextureImage(o.random_seed), simulation::kVehicleTexel,
                           simulation::Texture::Wrap::kClamp);
      hood = simulation::hoodMesh(*hood_texture, o.camera, o.hood);
    }
    for (int i = 0; i < o.frames; ++i) addFrame(static_cast<std::size_t>(i));
  }

  /// The ego vehicle at one instant.
  struct Ego {
    simulation::LongitudinalState state;  ///< s: along the lane
    simulation::VehiclePose pose;
  };
  /// delay: since the stamp of frame i [s].
  Ego egoAt(std::size_t i, double delay) const {
    const simulation::LongitudinalState state =
        profile.at(static_cast<double>(i) / options.frame_rate_hz + delay);
    return {state, simulation::vehiclePose(road, state, options)};
  }

  void addFrame(std::size_t i) {
    const auto [state, pose] = egoAt(i, 0);
    if (i == 0) T_c0_w = pose.T_w_c.inverse();
    Frame frame;
    frame.stamp_ns = std::llround(static_cast<double>(i) / options.frame_rate_hz * 1e9);
    if (i > 0) frame.T_c0_c = T_c0_w * pose.T_w_c;
    frame.n_c = pose.T_w_c.linear().transpose() * pose.n_w;
    frame.height = pose.height;
    frame.speed = state.v;
    frames.push_back(frame);
  }

  const Content& content() const {
    std::call_once(content_once_, [this] { content_.emplace(*this); });
    return *content_;
  }

  /// The scene of frame i at a delay after its stamp [s].
  Scene sceneAt(std::size_t i, double delay, const Ego& ego) const {
    const simulation::World& world = content().world;
    Scene scene = world.scene;
    if (road.isRecorded()) {
      const auto is_far = [&](const simulation::Instance& instance) {
        return !std::isnan(instance.s) && !road.isInSection(instance.s, ego.state.s);
      };
      scene.instances.erase(std::remove_if(scene.instances.begin(), scene.instances.end(), is_far),
                            scene.instances.end());
    }
    content().traffic.addTo(scene, i, static_cast<double>(frames[i].stamp_ns) * 1e-9 + delay);
    if (options.own_shadow) {
      scene.ego_shadow = simulation::egoShadow(options, road, ego.state.s);
    }
    constexpr bool kReflected = false;
    if (options.hood > 0) scene.instances.push_back({&hood, ego.pose.T_w_c, kReflected});
    scene.hood = hood_texture ? &*hood_texture : nullptr;
    scene.hood_share = options.hood;
    scene.daylight = options.daylight;
    scene.T_w_lamps = ego.pose.T_w_body;
    scene.T_w_lamps.translate(
        Eigen::Vector3d(0, options.camera_height - kLampsHeight, kLampsAhead));
    return scene;
  }

  /// Rows of frame i at a delay after its stamp [s].
  cv::Mat renderRows(std::size_t i, const cv::Range& rows, double delay) const {
    PinholeCamera camera = options.camera;
    camera.height = rows.size();
    camera.cy -= rows.start;
    const Ego ego = egoAt(i, delay);
    return simulation::render(sceneAt(i, delay, ego), camera, ego.pose.T_w_c);
  }

  cv::Mat render(std::size_t i) const {
    const int height = options.camera.height;
    if (options.readout_time == 0) return renderRows(i, {0, height}, 0);
    cv::Mat grey;
    for (int first = 0; first < height; first += kStripRows) {
      const cv::Range rows(first, std::min(first + kStripRows, height));
      const double middle = (rows.start + rows.end) / 2.0 / height;  // 0: top, 1: bottom
      grey.push_back(renderRows(i, rows, options.readout_time * (middle - 0.5)));
    }
    return grey;
  }

  const Options options;
  const SpeedProfile profile;
  const RoadGeometry road;
  std::optional<simulation::Texture> hood_texture;
  simulation::Mesh hood;
  Eigen::Isometry3d T_c0_w;
  std::vector<Frame> frames;

 private:
  mutable std::once_flag content_once_;
  mutable std::optional<Content> content_;
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
  const Options& o = impl_->options;
  const auto fault = std::find_if(o.faults.begin(), o.faults.end(),
                                  [&](const ImageFault& f) { return f.frames.contains(i); });
  if (fault == o.faults.end()) return sensorImage(impl_->render(i), i, o);
  cv::Mat image;
  if (fault->kind == FaultKind::kBlack || fault->kind == FaultKind::kWhite) {
    image.create(o.camera.height, o.camera.width, CV_8U);
  } else if (fault->kind == FaultKind::kFrozen) {
    image = this->image(fault->frames.first - 1);
  } else {
    image = sensorImage(impl_->render(i), i, o);
  }
  return withFault(fault->kind, image, i - fault->frames.first, o.random_seed);
}

std::vector<Eigen::Isometry3d> groundTruth(const SyntheticDrive& drive) {
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < drive.size(); ++i) poses.push_back(drive.frame(i).T_c0_c);
  return poses;
}

std::vector<double> groundTruthHeights(const SyntheticDrive& drive) {
  std::vector<double> heights;
  for (std::size_t i = 0; i < drive.size(); ++i) heights.push_back(drive.frame(i).height);
  return heights;
}

}  // namespace gsv
