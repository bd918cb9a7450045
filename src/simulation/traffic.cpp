#include "simulation/traffic.hpp"

#include <algorithm>
#include <cmath>

#include "simulation/drive_extent.hpp"
#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/vehicles.hpp"

namespace ground_scale_vo::simulation {
namespace {

constexpr double kLeftLane = 3.55;        // u of the middle of the left lane [m]
constexpr double kOncomingSpeed = 8;      // [m/s]
constexpr double kOncomingStart = 112;    // s of the first oncoming car at the start [m]
constexpr double kBesideStart = 4.5;      // of the first car beside, ahead of the camera [m]
constexpr double kBesideSpacing = 6.5;    // from each car beside to the next one ahead [m]
constexpr double kBesideLead = 0.3;       // of each in the speed profile over the one behind it [s]
constexpr double kLorryHeight = 3.6;      // [m]
constexpr double kLorryLaneChange = 1.0;  // duration of its lane change [s]
constexpr double kLorrySway = 0.06, kLorryGapChange = 0.15;  // amplitudes while it leads [m]
constexpr double kRoadMargin = 5;  // vehicles keep this distance from the ends of the road [m]

// Width and length [m].
Eigen::Vector2d carSize() { return {kCarWidth, kCarLength}; }
Eigen::Vector2d vanSize() { return {kVanWidth, kVanLength}; }

}  // namespace

Traffic::Traffic(const SyntheticDrive::Options& options, const SpeedProfile& profile,
                 const RoadGeometry& road, const World& world)
    : options_(options), profile_(profile), road_(road), world_(world) {
  if (options.lorry_frames == 0) return;
  // The lorry is the van with another texture, stretched in width and height.
  lorry_texture_.emplace(
      noiseToGrey(tileableNoise({512, 512}, options.random_seed + 55, {{1.5, 1}, {5, 1}, {20, 1}}),
                  105, 18),
      kVehicleTexel, Texture::Wrap::kRepeat);
  lorry_ = world.van();
  for (Mesh::Triangle& triangle : lorry_.triangles) triangle.texture = &*lorry_texture_;
  for (Vertex& vertex : lorry_.vertices) {
    vertex.p.y() *= options.lorry_width / kVanWidth;
    vertex.p.z() *= kLorryHeight / kVanHeight;
  }
  lorry_.updateBoundingSphere();
}

void Traffic::addTo(Scene& scene, std::size_t i, double t) const {
  if (options_.moving_cars) addCars(scene, t);
  if (options_.lorry_frames > 0) addLorry(scene, i, t);
}

/// Adds a vehicle at (s, u) and its shadow, if it is on the road. ego_s: of the camera. size: width
/// and length [m].
void Traffic::addVehicle(Scene& scene, const Mesh& mesh, const Eigen::Vector2d& size, double ego_s,
                         double s, double u, bool oncoming) const {
  if (s < road_.sBegin() + kRoadMargin || s > road_.sEnd() - kRoadMargin) return;
  if (!road_.isInSection(s, ego_s)) return;
  Eigen::Isometry3d T_w_m = road_.surfaceFrame(s, u);
  if (oncoming) T_w_m.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()));
  scene.instances.push_back({&mesh, T_w_m});
  if (!options_.shadows) return;
  scene.box_shadows.push_back({world_.roadUv(s, u), {size.x() / 2, size.y() / 2}});
}

void Traffic::addCars(Scene& scene, double t) const {
  const double ego_s = profile_.at(t).s;
  const Eigen::Vector2d lead_size = options_.lead_van ? vanSize() : carSize();
  addVehicle(scene, options_.lead_van ? world_.van() : world_.car(2), lead_size, ego_s,
             profile_.at(t + options_.lead_time).s + (options_.lead_gap + lead_size.y() / 2), 0,
             false);
  for (int k = 0; k < options_.cars_beside; ++k) {
    const double s = profile_.at(t + kBesideLead * k).s + kBesideStart + k * kBesideSpacing;
    addVehicle(scene, world_.car(static_cast<std::size_t>(k) + 3), carSize(), ego_s, s, kLeftLane,
               false);
  }
  if (options_.cars_beside > 0) return;
  const double last = std::max(2 * kMaxDriveLength, road_.sEnd() + kOncomingSpeed * t);
  for (int k = 0; k * options_.oncoming_spacing < last; ++k) {
    const double s = kOncomingStart + k * options_.oncoming_spacing - kOncomingSpeed * t;
    addVehicle(scene, world_.car(static_cast<std::size_t>(k) + 3), carSize(), ego_s, s, kLeftLane,
               true);
  }
}

/// It follows the speed of the ego vehicle, with a small oscillation sideways and in the gap.
void Traffic::addLorry(Scene& scene, std::size_t i, double t) const {
  const double first = options_.lorry_first, last = first + options_.lorry_frames - 1;
  const auto at = static_cast<double>(i);
  if (at < first || at > last) return;
  const LongitudinalState ego = profile_.at(t);
  const double lane_change =
      std::min(at - first, last - at) / options_.frame_rate_hz / kLorryLaneChange;
  const double aside =
      lane_change < 1 ? (1 + std::cos(M_PI * lane_change)) / 2 * (kLeftLane + options_.lorry_width)
                      : 0;
  const double moving = ego.v / options_.speed;
  const double sway = kLorrySway * moving * std::sin(0.9 * t);
  const double gap = kLorryGapChange * std::sin(0.7 * t) * moving;
  addVehicle(scene, lorry_, {options_.lorry_width, kVanLength}, ego.s,
             ego.s + options_.lorry_gap + gap + kVanLength / 2, options_.lane_offset + sway + aside,
             false);
}

}  // namespace ground_scale_vo::simulation
