#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "simulation/renderer/texture.hpp"

namespace gsv::simulation {

struct Vertex {
  Eigen::Vector3d p;   ///< in the frame of the mesh [m]
  Eigen::Vector2d uv;  ///< texture coordinates [m]
  double light = 1;    ///< relative irradiance; 1 = full daylight
};

struct Mesh {
  struct Triangle {
    int v[3];  ///< indices of vertices
    const Texture* texture;
  };
  std::vector<Vertex> vertices;
  std::vector<Triangle> triangles;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< of the bounding sphere
  double radius = 0;                                 ///< of the bounding sphere

  /// Corners in cyclic order. No back-face culling.
  void addQuad(const Vertex& a, const Vertex& b, const Vertex& c, const Vertex& d,
               const Texture& texture);
  void addTriangle(const Vertex& a, const Vertex& b, const Vertex& c, const Texture& texture);
  /// Call it when the mesh is complete: the renderer culls by the bounding sphere.
  void updateBoundingSphere();
};

/// Relative irradiance of a Lambertian surface under skylight and sun; 1 = full daylight. normal,
/// sun: unit vectors; sun: direction from the surface to the sun.
double diffuseLight(const Eigen::Vector3d& normal, const Eigen::Vector3d& sun);

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

/// Content of one frame. World axes: z up.
struct Scene {
  std::vector<Instance> instances;
  const Texture* sky = nullptr;   ///< u = azimuth up to a constant, v = kSkyTop - elevation [rad]
  const Texture* road = nullptr;  ///< the only texture on which dynamic shadows fall
  std::vector<BoxShadow> box_shadows;
  /// Sharp shadow of a convex polygon, in texture coordinates of the road [m]: the points for which
  /// a u + b v + c > 0 at every edge (a, b, c). (a, b) is a unit vector. No edges: no shadow.
  std::vector<Eigen::Vector3d> ego_shadow;

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

  double daylight = 1;  ///< illumination, 1 = day; below 1 the headlamps are on
  /// World from headlamps: x right, y down, z ahead, the origin between the two lamps.
  Eigen::Isometry3d T_w_lamps = Eigen::Isometry3d::Identity();
};
constexpr double kSkyTop = 0.68;  ///< elevation of the upper edge of the panorama [rad]

/// The image of an ideal camera: no noise, no quantisation. Grey levels, CV_32F. Visibility is
/// sampled at 2 x 2 places per pixel; each surface within a pixel is shaded once, with its texture
/// filtered over the pixel.
cv::Mat render(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c);

}  // namespace gsv::simulation
