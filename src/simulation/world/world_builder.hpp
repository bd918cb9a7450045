#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <vector>

#include "simulation/rendering/mesh.hpp"
#include "simulation/rendering/random.hpp"
#include "simulation/rendering/scene.hpp"
#include "simulation/rendering/texture.hpp"
#include "simulation/world/road_geometry.hpp"
#include "simulation/world/shadow_map.hpp"

namespace ground_scale_vo::simulation {

/// The subset of SyntheticDrive::Options that shapes the static world; documented there.
struct WorldOptions {
  std::uint64_t seed = 1;
  double road_texture = 1;
  bool lane_markings = true;
  bool shadows = true;
  bool solid_lines = false;
  double arrow_spacing = 0;
  double grain = 0;
  bool cobbles = false;
  double bare_from = 0, bare_to = 0;
  double puddles = 0;
  bool bumps = false;
  bool parked_cars = true;
  double wall_at = 0;
  bool off_road = false;
  double bridge_from = 0, bridge_to = 0;
  double underpass_from = 0, underpass_to = 0;
  double largest_curvature = 0;
  Eigen::Vector3d sun = Eigen::Vector3d::UnitZ();  ///< unit vector towards it

  bool hasBridge() const { return bridge_from < bridge_to; }
  bool hasUnderpass() const { return underpass_from < underpass_to; }
};

/// What the builder makes. Deques keep the addresses of textures and meshes valid.
struct WorldAssets {
  Scene scene;
  std::deque<Texture> textures;
  std::deque<Mesh> meshes;
  std::vector<Mesh> cars;
  Mesh van;

  const Mesh& car(std::size_t i) const { return cars[i % cars.size()]; }
};

/// What the generators of the static world share: they append textures, meshes and instances to the
/// assets and cast shadows on the road. They draw from one random sequence, so their order matters.
class WorldBuilder {
 public:
  WorldBuilder(const RoadGeometry& geometry, const WorldOptions& settings, WorldAssets* target);

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
  /// Adds an instance that puddles reflect.
  void place(const Mesh& mesh, const Eigen::Isometry3d& T_w_m);
  /// Adds a mesh in world coordinates that puddles do not reflect.
  void placeGround(Mesh mesh);

  /// Texture coordinates of a place on the road [m].
  Eigen::Vector2d roadUv(double s, double u) const;
  /// False beside a bridge or an underpass, where no houses and trees stand.
  bool isFreeBeside(double s) const;
};

/// s lies in [begin, end].
inline bool isBetween(double s, double begin, double end) { return s >= begin && s <= end; }

// The generators; that of buildings is in buildings.hpp.
void addSky(WorldBuilder& builder);
void addTreesAndLampPosts(WorldBuilder& builder);
void addBridge(WorldBuilder& builder);
void addUnderpass(WorldBuilder& builder);
/// Sets scene.road, scene.puddles and scene.road_detail.
void addRoadTexture(WorldBuilder& builder);
/// The road with kerbs and pavements, or a gravel track, and the terrain around it.
void addRoadMesh(WorldBuilder& builder);

}  // namespace ground_scale_vo::simulation
