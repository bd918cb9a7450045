#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "simulation/rendering/mesh.hpp"
#include "simulation/rendering/random.hpp"
#include "simulation/rendering/scene.hpp"
#include "simulation/rendering/texture.hpp"
#include "simulation/world/road_geometry.hpp"
#include "simulation/world/shadow_map.hpp"

namespace ground_scale_vo::simulation {

/// The subset of SyntheticDrive::Options that shapes the static world; documented there under the
/// same names.
struct WorldOptions {
  std::uint64_t random_seed = 1;
  double road_texture = 1;
  bool lane_markings = true;
  bool shadows = true;
  bool solid_lines = false;
  double arrow_spacing = 0;
  double grain = 0;
  bool cobbles = false;
  double bare_from_m = 0, bare_to_m = 0;
  double puddles = 0;
  bool bumps = false;  ///< speed bumps: bump_height > 0
  bool parked_cars = true;
  bool built_up = true;
  double kerb_height = 0.12;
  double wall_at_m = 0;
  bool off_road = false;
  double bridge_from_m = 0, bridge_to_m = 0;
  double underpass_from_m = 0, underpass_to_m = 0;
  double curvature = 0;
  Eigen::Vector3d sun = Eigen::Vector3d::UnitZ();  ///< unit vector towards the sun

  bool hasBridge() const { return bridge_from_m < bridge_to_m; }
  bool hasUnderpass() const { return underpass_from_m < underpass_to_m; }
};

/// Output of WorldBuilder. std::deque, so that references stay valid on append.
struct WorldAssets {
  Scene scene;
  std::deque<Texture> textures;
  std::deque<Mesh> meshes;
  std::vector<Mesh> cars;
  Mesh van;

  const Mesh& car(std::size_t i) const { return cars[i % cars.size()]; }  ///< see World::car()
};

/// State shared by the generators of the static world. The generators append textures, meshes and
/// instances to the assets and cast shadows on the road. They draw from one random sequence, so
/// their order matters.
class WorldBuilder {
 public:
  WorldBuilder(const RoadGeometry& road_geometry, const WorldOptions& world_options,
               WorldAssets* world_assets);

  const RoadGeometry& road;
  const WorldOptions& options;
  WorldAssets& assets;
  Random random;
  const cv::Size road_texels;  ///< size of the road texture
  ShadowMap shadows;

  /// Common materials.
  const Texture *leaves, *grass, *stone, *roof_tiles;

  double uniform(double from, double to) { return random.uniform(from, to); }
  const Texture& addTexture(const cv::Mat& image, double texel_m,
                            Texture::Wrap wrap = Texture::Wrap::kRepeat);
  const Mesh& addMesh(Mesh mesh);
  // Instances stand at s along the road [m]; without it they exist everywhere on a recorded road.

  static constexpr double kEverywhere = std::numeric_limits<double>::quiet_NaN();
  /// Adds an instance that is also rendered in puddle reflections.
  void place(const Mesh& mesh, const Eigen::Isometry3d& T_w_m, double s = kEverywhere);
  /// Adds a mesh in world coordinates that is not rendered in puddle reflections.
  void placeGround(Mesh mesh, double s = kEverywhere);

  /// See World::roadUv().
  Eigen::Vector2d roadUv(double s, double u) const;
  /// Whether houses and trees may be placed beside the road at s: not near a bridge or an
  /// underpass.
  bool isClearOfBridgeAndUnderpass(double s) const;
};

/// s lies in [begin, end].
inline bool isBetween(double s, double begin, double end) { return s >= begin && s <= end; }

// Generators; the generator of buildings is in buildings.hpp.
void addSky(WorldBuilder& builder);
void addTreesAndLampPosts(WorldBuilder& builder);
void addBridge(WorldBuilder& builder);
void addUnderpass(WorldBuilder& builder);
/// Sets scene.road, scene.puddles and scene.road_detail.
void addRoadTexture(WorldBuilder& builder);
/// The road with kerbs and pavements, or a gravel track, and the terrain around it.
void addRoadMesh(WorldBuilder& builder);

}  // namespace ground_scale_vo::simulation
