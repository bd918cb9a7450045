#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "simulation/rendering/texture.hpp"

namespace ground_scale_vo::simulation {

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

}  // namespace ground_scale_vo::simulation
