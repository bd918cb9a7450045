#include "simulation/world/world.hpp"

#include <algorithm>
#include <cmath>

#include "simulation/world/vehicles.hpp"
#include "simulation/world/world_builder.hpp"

namespace gsv::simulation {
namespace {

/// A panorama: clouds above wooded hills on the horizon.
void addSky(WorldBuilder& builder) {
  constexpr int kColumns = 4096, kRows = 512;
  cv::Mat image(kRows, kColumns, CV_8U);
  const cv::Mat clouds = tileableNoise({1024, 512}, builder.random.bits(), {{12, 0.5}, {40, 1}});
  const cv::Mat wood = tileableNoise({1024, 512}, builder.random.bits(), {{1.5, 1}, {5, 0.6}});
  const double phase = builder.uniform(0, 6);
  const double texel = 2 * M_PI / kColumns;  // [rad]
  for (int x = 0; x < kColumns; ++x) {
    const double azimuth = x * texel;
    const double skyline = 0.035 + 0.018 * std::sin(3 * azimuth + phase) +
                           0.01 * std::sin(8 * azimuth + 2 * phase) +
                           0.0015 * wood.at<float>(7, x % 1024);
    for (int y = 0; y < kRows; ++y) {
      const double elevation = kSkyTop - y * texel;
      const double sky = 225 - 60 * std::max(elevation, 0.0) + 5 * clouds.at<float>(y, x % 1024);
      const double hills = 135 - 250 * elevation + 10 * wood.at<float>(y, x % 1024);
      const double blend = std::clamp((skyline - elevation) / (2 * texel) + 0.5, 0.0, 1.0);
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(sky + blend * (hills - sky));
    }
  }
  builder.world.scene.sky = &builder.addTexture(image, texel);
}

void addVehicleMeshes(WorldBuilder& builder) {
  constexpr double kVanGrey = 205;
  for (const double body : {185., 45., 120., 225., 75.}) {
    const Texture& texture = builder.addTexture(carTextureImage(body, builder.random.bits()),
                                                kVehicleTexel, Texture::Wrap::kClamp);
    builder.world.cars.push_back(carMesh(texture, builder.options.sun));
    builder.world.cars.back().updateBoundingSphere();
  }
  // seed + 77: independent of the shared random sequence.
  const Texture& texture =
      builder.addTexture(vanTextureImage(kVanGrey, builder.options.random_seed + 77), kVehicleTexel,
                         Texture::Wrap::kClamp);
  builder.world.van = vanMesh(texture, builder.options.sun);
  builder.world.van.updateBoundingSphere();
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
  builder.place(builder.world.car(builder.random.bits()), T_w_m, s);
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

World::World(const RoadGeometry& road, const SyntheticDrive::Options& options) {
  // All generators draw from one random sequence, so their order must not change. The road texture
  // comes last because it needs the complete shadow map.
  WorldBuilder builder(road, options, this);
  addSky(builder);
  addVehicleMeshes(builder);
  addTreesAndLampPosts(builder);
  if (options.built_up && !options.off_road) addBuildings(builder);
  if (options.parked_cars) addParkedCars(builder);
  if (options.bridge.exists()) addBridge(builder);
  if (options.underpass.exists()) addUnderpass(builder);
  addRoadTexture(builder);
  addRoadMesh(builder);
}

}  // namespace gsv::simulation
