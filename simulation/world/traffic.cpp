#include "simulation/world/traffic.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "simulation/renderer/texture.hpp"
#include "simulation/world/vehicles.hpp"

namespace gsv::simulation {
namespace {

constexpr double kLeftLane = 3.55;      // u of the middle of the left lane [m]
constexpr double kOncomingSpeed = 8;    // [m/s]
constexpr double kOncomingStart = 112;  // s of the first oncoming car at the start [m]
constexpr double kBesideStart = 4.5;    // of the first car beside, ahead of the camera [m]
constexpr double kBesideSpacing = 6.5;  // from each car beside to the next one ahead [m]
constexpr double kBesideLead = 0.3;     // of each in the speed profile over the one behind it [s]
constexpr double kLorryWidth = 4.9, kLorryHeight = 3.6;      // with its load [m]
constexpr double kLorryGap = 2.3;                            // from the camera to its rear [m]
constexpr double kLorryLaneChange = 1.0;                     // duration of its lane change [s]
constexpr double kLorrySway = 0.06, kLorryGapChange = 0.15;  // amplitudes while it leads [m]
// The ego vehicle: its width, and its extent before and behind the camera [m].
constexpr double kEgoWidth = 1.8, kEgoFront = 2, kEgoRear = 2.4;
constexpr double kRoadMargin = 5;  // vehicles keep this distance from the ends of the road [m]

// Width and length [m].
Eigen::Vector2d carSize() { return {kCarWidth, kCarLength}; }
Eigen::Vector2d vanSize() { return {kVanWidth, kVanLength}; }

/// Edges of a convex polygon, see Scene::ego_shadow. hull: its corners in cyclic order.
std::vector<Eigen::Vector3d> edges(const std::vector<cv::Point2f>& hull) {
  std::vector<Eigen::Vector3d> result;
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
    result.emplace_back(normal.x(), normal.y(), -normal.dot(from));
  }
  return result;
}

}  // namespace

Traffic::Traffic(const SyntheticDrive::Options& options, const SpeedProfile& profile,
                 const RoadGeometry& road, const World& world)
    : options_(options), profile_(profile), road_(road), world_(world) {
  if (options.lorry.isEmpty()) return;
  // The lorry is the van with another texture, stretched in width and height.
  lorry_texture_.emplace(
      noiseToGrey(tileableNoise({512, 512}, options.random_seed + 55, {{1.5, 1}, {5, 1}, {20, 1}}),
                  105, 18),
      kVehicleTexel, Texture::Wrap::kRepeat);
  lorry_ = world.van;
  for (Mesh::Triangle& triangle : lorry_.triangles) triangle.texture = &*lorry_texture_;
  for (Vertex& vertex : lorry_.vertices) {
    vertex.p.y() *= kLorryWidth / kVanWidth;
    vertex.p.z() *= kLorryHeight / kVanHeight;
  }
  lorry_.updateBoundingSphere();
}

void Traffic::addTo(Scene& scene, std::size_t i, double t) const {
  if (options_.moving_cars) addCars(scene, t);
  if (!options_.lorry.isEmpty()) addLorry(scene, i, t);
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
  scene.box_shadows.push_back({road_.textureUv(s, u), {size.x() / 2, size.y() / 2}});
}

void Traffic::addCars(Scene& scene, double t) const {
  const double ego_s = profile_.at(t).s;
  const Eigen::Vector2d lead_size = options_.lead_van ? vanSize() : carSize();
  addVehicle(scene, options_.lead_van ? world_.van : world_.car(2), lead_size, ego_s,
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
  if (!options_.lorry.contains(i)) return;
  const LongitudinalState ego = profile_.at(t);
  const double lane_change =
      static_cast<double>(std::min(i - options_.lorry.first, options_.lorry.last - i)) /
      options_.frame_rate_hz / kLorryLaneChange;
  const double aside =
      lane_change < 1 ? (1 + std::cos(M_PI * lane_change)) / 2 * (kLeftLane + kLorryWidth) : 0;
  const double moving = ego.v / options_.speed;
  const double sway = kLorrySway * moving * std::sin(0.9 * t);
  const double gap = kLorryGapChange * std::sin(0.7 * t) * moving;
  addVehicle(scene, lorry_, {kLorryWidth, kVanLength}, ego.s,
             ego.s + kLorryGap + gap + kVanLength / 2, options_.lane_offset + sway + aside, false);
}

std::vector<Eigen::Vector3d> egoShadow(const SyntheticDrive::Options& options,
                                       const RoadGeometry& road, double s) {
  const Eigen::Vector3d sun =
      Eigen::AngleAxisd(-road.heading(s), Eigen::Vector3d::UnitZ()) * options.sun;
  const double roof = options.camera_height, half = kEgoWidth / 2;
  std::vector<cv::Point2f> projected;
  // Projects the outline of the car at height z onto the road, along the rays of the sun.
  const auto project = [&](double rear, double front, double half_width, double z) {
    for (const double x : {rear, front}) {
      for (const double y : {-half_width, half_width}) {
        const Eigen::Vector2d uv = road.textureUv(s + x - sun.x() / sun.z() * z,
                                                  options.lane_offset + y - sun.y() / sun.z() * z);
        projected.emplace_back(static_cast<float>(uv.x()), static_cast<float>(uv.y()));
      }
    }
  };
  project(-kEgoRear, kEgoFront, half, 0.2);                      // sill
  project(-kEgoRear, kEgoFront, half, 0.55 * roof);              // hood
  project(-0.8 * kEgoRear, 0.2 * kEgoFront, 0.75 * half, roof);  // roof
  std::vector<cv::Point2f> hull;
  cv::convexHull(projected, hull);
  return edges(hull);
}

}  // namespace gsv::simulation
