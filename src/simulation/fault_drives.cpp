#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "simulation/rendering/random.hpp"

namespace ground_scale_vo {
namespace {

using Options = SyntheticDrive::Options;
using simulation::Random;

constexpr const char *kLorry = "lorry", *kWall = "wall";
constexpr double kStartTime = 4.5;     // before the first fault [s]
constexpr double kSegmentTime = 3;     // of a fault-free segment, after settling [s]
constexpr double kLorryTime = 10;      // for which the lorry drives ahead in the lane [s]
constexpr double kLaneChangeTime = 1;  // of the lorry, at both ends [s]
constexpr double kWallFillsImage =
    7;  // distance to the wall below which hardly any road is visible [m]
constexpr double kStopToWall = 1.8;  // distance to the wall at the stop [m]

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

/// Draws camera, speed and street.
Options randomDrive(Random* random) {
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

/// Appends faults to a drive and extends it accordingly.
class FaultDriveBuilder {
 public:
  FaultDriveBuilder(std::string name, const Options& options, Random* random)
      : drive_{std::move(name), options, {}}, random_(random), end_s_(kStartTime) {}

  void add(ImageFault fault) {
    const bool hides = hidesGround(fault);
    const double duration = hides ? random_->uniform(3.3, 4.5) : random_->uniform(1, 3);
    place({toString(fault), fault, 0, 0, hides, random_->bits()}, duration);
  }
  void addLorry() {
    Options& o = drive_.options;
    o.lorry_width = random_->uniform(4.6, 5.2);
    o.lorry_gap = random_->uniform(2.2, 2.5);
    o.lorry_frames = frames(kLorryTime + 2 * kLaneChangeTime);
    o.lorry_first = frames(end_s_);
    end_s_ += kLaneChangeTime;
    place({kLorry, {}, 0, 0, true, 0}, kLorryTime);
    // Hides the ground until it starts to leave the lane.
    drive_.faults.back().first -= static_cast<std::size_t>(frames(kLaneChangeTime));
    end_s_ += kLaneChangeTime;
  }
  /// Drives up to a wall, stops and reverses. It must be the last fault.
  void addWall() {
    constexpr double kBraking = 2.5, kStanding = 2, kStarting = 1;  // durations [s]
    constexpr double kReverse = 3;                                  // speed [m/s]
    Options& o = drive_.options;
    o.curvature = o.slope = 0;
    o.moving_cars = false;
    const double v = std::min(o.speed, 8.0), brake = end_s_, stand = brake + kBraking;
    o.speeds = {{0, v},
                {brake, v},
                {stand, 0},
                {stand + kStanding, 0},
                {stand + kStanding + kStarting, -kReverse}};
    o.wall_at_m = v * brake + v * kBraking / 2 + kStopToWall;
    // The fault begins where the wall fills the image.
    double from = stand, to = stand + kStanding;
    // Distance left to the stop [m]; the speed falls along a cosine.
    const auto toStop = [&](double t) {
      const double x = (stand - t) / kBraking;
      return v * kBraking / 2 * (x - std::sin(M_PI * x) / M_PI);
    };
    while (from > brake && toStop(from) < kWallFillsImage - kStopToWall) from -= 0.05;
    // It ends where the wall is at 0.9 of the distance at which the lower edge of the image would
    // show road again.
    const double down = (o.camera.height - 1 - o.camera.cy) / o.camera.fy + o.pitch_rad;
    to += kStarting / 2 + (0.9 * o.camera_height / down - kStopToWall) / kReverse;
    PlacedFault fault{kWall, {}, 0, 0, true, 0};
    fault.first = static_cast<std::size_t>(frames(from));
    fault.last = static_cast<std::size_t>(frames(to));
    drive_.faults.push_back(fault);
    end_s_ = to + kSettlingDistance / kReverse + kSegmentTime + 2;
  }
  FaultDrive finish() {
    drive_.options.frames = frames(end_s_);
    return std::move(drive_);
  }

 private:
  int frames(double seconds) const {
    return static_cast<int>(std::lround(seconds * drive_.options.frame_rate_hz));
  }
  void place(PlacedFault fault, double duration) {
    fault.first = static_cast<std::size_t>(frames(end_s_));
    fault.last = static_cast<std::size_t>(frames(end_s_ + duration)) - 1;
    drive_.faults.push_back(fault);
    end_s_ +=
        duration + std::max(kSettlingTime, kSettlingDistance / drive_.options.speed) + kSegmentTime;
  }

  FaultDrive drive_;
  Random* random_;
  double end_s_;  // of the drive so far [s]
};

}  // namespace

std::vector<std::string> faultNames() {
  std::vector<std::string> names{kLorry, kWall};
  for (const ImageFault fault : imageFaults()) names.emplace_back(toString(fault));
  return names;
}

FaultDrive faultDrive(std::size_t i, std::uint64_t seed) {
  requireInRange("index of the fault drive", static_cast<double>(i), 0, kFaultDriveCount - 1);
  // All drives of a seed share these shuffled lists: drive i gets entry i of each.
  Random shuffling(seed);
  std::vector<std::string> hiding{kLorry, kWall}, visible;
  for (const ImageFault fault : imageFaults()) {
    (hidesGround(fault) ? hiding : visible).emplace_back(toString(fault));
  }
  // Repeats entries from repeat_from on until there is one for each drive.
  const auto fill = [&](std::vector<std::string>* names, std::size_t repeat_from) {
    for (std::size_t k = repeat_from; names->size() < kFaultDriveCount; ++k) {
      names->push_back((*names)[k]);
    }
    shuffle(names, &shuffling);
  };
  fill(&visible, 0);
  fill(&hiding, 2);  // lorry and wall are long drives: only once

  Random random(seed + 1000 * (i + 1));
  const Options options = randomDrive(&random);
  FaultDriveBuilder builder("drive " + std::to_string(i), options, &random);
  const auto add = [&](const std::string& name) {
    if (name == kLorry) return builder.addLorry();
    if (name == kWall) return builder.addWall();
    for (const ImageFault fault : imageFaults()) {
      if (name == toString(fault)) return builder.add(fault);
    }
  };
  const bool hidden_last = hiding[i] == kWall || random.chance(0.5);
  add(hidden_last ? visible[i] : hiding[i]);
  add(hidden_last ? hiding[i] : visible[i]);
  return builder.finish();
}

FaultDrive faultDrive(const std::string& name, std::uint64_t seed) {
  Random random(seed);
  Options options = randomDrive(&random);
  FaultDriveBuilder builder(name, options, &random);
  if (name == kLorry) {
    builder.addLorry();
    return builder.finish();
  }
  if (name == kWall) {
    builder.addWall();
    return builder.finish();
  }
  std::string names = std::string(kLorry) + ", " + kWall;
  for (const ImageFault fault : imageFaults()) {
    if (name == toString(fault)) {
      builder.add(fault);
      return builder.finish();
    }
    names += std::string(", ") + toString(fault);
  }
  throw OptionError("unknown fault '" + name + "', available: " + names);
}

}  // namespace ground_scale_vo
