#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <optional>
#include <vector>

#include "simulation/rendering/mesh.hpp"
#include "simulation/rendering/texture.hpp"

namespace ground_scale_vo::simulation {

struct Instance {
  const Mesh* mesh;
  Eigen::Isometry3d T_w_m;  ///< world from mesh [m]
  bool reflected = true;    ///< puddles reflect it
  /// Position along the road [m]; not a number: it is far away or moves, and always exists.
  double s = std::numeric_limits<double>::quiet_NaN();
};

/// Soft rectangular shadow of a moving vehicle, in texture coordinates of the road [m].
struct BoxShadow {
  Eigen::Vector2d centre;
  Eigen::Vector2d half_size;
};

/// Sharp shadow of a convex polygon, in texture coordinates of the road [m]: the points for which
/// a u + b v + c > 0 at every edge (a, b, c). (a, b) is a unit vector. No edges: no shadow.
struct PolygonShadow {
  std::vector<Eigen::Vector3d> edges;
};

/// Content of one frame. World axes: z up.
struct Scene {
  std::vector<Instance> instances;
  const Texture* sky = nullptr;   ///< u = azimuth up to a constant, v = kSkyTop - elevation [rad]
  const Texture* road = nullptr;  ///< the only texture on which dynamic shadows fall
  std::vector<BoxShadow> box_shadows;
  PolygonShadow ego_shadow;

  /// Water cover of the road [1/255], in texture coordinates of the road, for u in
  /// [puddles_from, puddles_to] m. Water lies in the plane z = 0 and reflects what is above it.
  /// nullptr: a dry road.
  const Texture* puddles = nullptr;
  double puddles_from = 0, puddles_to = 0;

  /// Detail texture: factor on the albedo of the road, 128 = 1, in texture coordinates of the road.
  /// nullptr: none.
  const Texture* road_detail = nullptr;

  const Texture* hood =
      nullptr;            ///< surfaces with this texture reflect the upper part of the image
  double hood_share = 0;  ///< of the image height

  double daylight = 1;  ///< illumination, 1 = day
  /// World from headlamps: x right, y down, z ahead, the origin between the two lamps. Empty: off.
  std::optional<Eigen::Isometry3d> T_w_lamps;
};
constexpr double kSkyTop = 0.68;  ///< elevation of the upper edge of the panorama [rad]

}  // namespace ground_scale_vo::simulation
