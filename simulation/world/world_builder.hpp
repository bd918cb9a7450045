#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "simulation/renderer/random.hpp"
#include "simulation/renderer/scene.hpp"
#include "simulation/renderer/texture.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/world/road_geometry.hpp"
#include "simulation/world/world.hpp"

namespace gsv::simulation {

/// Shadows of static objects on the road, at an eighth of the resolution of the road texture.
class ShadowMap {
 public:
  /// sun: unit vector towards the sun, in world axes. road_texels: size of the road texture.
  ShadowMap(const RoadGeometry& road, const Eigen::Vector3d& sun, cv::Size road_texels);

  // Objects stand at (s, u) of the RoadGeometry. Offsets from there are along the road and to its
  // left, heights above the road [m].

  // A later shadow replaces an earlier one where they overlap, also a darker one.

  /// Shadow of a vertical prism over a polygon, or of a vertical wall over two points. opacity: of
  /// the object, 1 halves the light.
  void castPrism(double s, double u, const std::vector<Eigen::Vector2d>& base, double height,
                 double opacity);
  /// Round shadow of a small object at `offset` (along, left, up). radius [m].
  void castSpot(double s, double u, const Eigen::Vector3d& offset, double radius);
  /// Sets the light on the full width of the road between two positions. light: 1 = full.
  void setLight(double s_begin, double s_end, double light);

  /// Light on the road at the resolution of the road texture, 8-bit, 255 = full.
  cv::Mat light() const;

 private:
  Eigen::Vector2d shadowUv(double s, double u, const Eigen::Vector3d& offset) const;
  const RoadGeometry& road_;
  const Eigen::Vector3d sun_;
  const cv::Size road_texels_;
  cv::Mat map_;
};

/// State shared by the generators of the static world. The generators append textures, meshes and
/// instances to the world and cast shadows on the road. They draw from one random sequence, so
/// their order matters.
class WorldBuilder {
 public:
  /// world: what is built.
  WorldBuilder(const RoadGeometry& road_geometry, const SyntheticDrive::Options& drive_options,
               World* built_world);

  const RoadGeometry& road;
  const SyntheticDrive::Options& options;
  World& world;
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

  /// Whether houses and trees may be placed beside the road at s: not near a bridge or an
  /// underpass.
  bool isClearOfBridgeAndUnderpass(double s) const;
};

// Generators.
void addTreesAndLampPosts(WorldBuilder& builder);
/// Houses beside the road, their hedges or low walls, and the house across the road.
void addBuildings(WorldBuilder& builder);
void addBridge(WorldBuilder& builder);
void addUnderpass(WorldBuilder& builder);
/// Sets scene.road, scene.puddles and scene.road_detail.
void addRoadTexture(WorldBuilder& builder);
/// The road with kerbs and pavements, or a gravel track, and the terrain around it.
void addRoadMesh(WorldBuilder& builder);

}  // namespace gsv::simulation
