#include "simulation/world/world.hpp"

#include <cmath>
#include <optional>

#include "simulation/world/buildings.hpp"
#include "simulation/world/cross_section.hpp"
#include "simulation/world/vehicles.hpp"

namespace ground_scale_vo::simulation {
namespace {

void addVehicleMeshes(WorldBuilder& builder) {
  constexpr double kVanGrey = 205;
  for (const double body : {185., 45., 120., 225., 75.}) {
    const Texture& texture = builder.addTexture(carTextureImage(body, builder.random.bits()),
                                                kVehicleTexel, Texture::Wrap::kClamp);
    builder.assets.cars.push_back(carMesh(texture, builder.options.sun));
    builder.assets.cars.back().updateBoundingSphere();
  }
  // seed + 77: independent of the shared random sequence.
  const Texture& texture =
      builder.addTexture(vanTextureImage(kVanGrey, builder.options.random_seed + 77), kVehicleTexel,
                         Texture::Wrap::kClamp);
  builder.assets.van = vanMesh(texture, builder.options.sun);
  builder.assets.van.updateBoundingSphere();
}

/// On a recorded road: neither in a tight curve nor beside a crossing.
bool isFreeForParking(const RoadGeometry& road, double s, double u) {
  constexpr double kTightCurvature = 0.04, kClearance = 9;  // [1/m, m]
  return !road.isRecorded() || (std::abs(road.curvature(s)) < kTightCurvature &&
                                road.distanceToOtherLanes(s, road.surfacePoint(s, u)) > kClearance);
}

/// Parks a random car model at (s, u). height: of the parking surface above the carriageway [m].
void parkCar(WorldBuilder& builder, double s, double u, double height) {
  if (!isFreeForParking(builder.road, s, u)) return;
  Eigen::Isometry3d T_w_m = builder.road.surfaceFrame(s, u);
  T_w_m.translate(Eigen::Vector3d(0, 0, height));
  T_w_m.rotate(Eigen::AngleAxisd((u > 0 ? M_PI : 0) + builder.uniform(-0.03, 0.03),
                                 Eigen::Vector3d::UnitZ()));
  builder.place(builder.assets.car(builder.random.bits()), T_w_m, s);
  // A soft contact shadow, and the shadow of the body.
  builder.shadows.castPrism(s, u, {{2.1, 0.85}, {2.1, -0.85}, {-2.1, -0.85}, {-2.1, 0.85}}, 0.05,
                            0.2);
  builder.shadows.castPrism(s, u, {{1.9, 0.75}, {1.9, -0.75}, {-1.9, -0.75}, {-1.9, 0.75}}, 0.9,
                            0.5);
}

/// In the bays beside the right lane, and some on the left pavement.
void addParkedCars(WorldBuilder& builder) {
  const RoadGeometry& road = builder.road;
  const double pavement = builder.options.kerb_height;
  for (double s = road.sBegin() + 4; s < road.sEnd() - 4; s += builder.uniform(5.2, 6.5)) {
    if (builder.random.chance(0.45)) parkCar(builder, s, builder.uniform(-3.35, -3.1), 0);
    if (builder.random.chance(0.15)) parkCar(builder, s, builder.uniform(6.7, 6.9), pavement);
  }
}

}  // namespace

World::World(const RoadGeometry& road, const WorldOptions& options) : s_begin_(road.sBegin()) {
  // All generators draw from one random sequence, so their order must not change. The road texture
  // comes last because it needs the complete shadow map.
  WorldBuilder builder(road, options, &assets_);
  addSky(builder);
  addVehicleMeshes(builder);
  addTreesAndLampPosts(builder);
  std::optional<BuildingGenerator> buildings;
  if (options.built_up && !options.off_road) buildings.emplace(builder).addHouses();
  if (options.parked_cars) addParkedCars(builder);
  if (options.wall_at_m > 0 && buildings) buildings->addWallAcrossRoad();
  if (options.hasBridge()) addBridge(builder);
  if (options.hasUnderpass()) addUnderpass(builder);
  addRoadTexture(builder);
  addRoadMesh(builder);
}

Eigen::Vector2d World::roadUv(double s, double u) const { return roadTextureUv(s_begin_, s, u); }

}  // namespace ground_scale_vo::simulation
