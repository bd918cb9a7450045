#include "simulation/renderer/scene.hpp"

#include <algorithm>

namespace gsv::simulation {

void Mesh::addTriangle(const Vertex& a, const Vertex& b, const Vertex& c, const Texture& texture) {
  const int n = static_cast<int>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c});
  triangles.push_back({{n, n + 1, n + 2}, &texture});
}

void Mesh::addQuad(const Vertex& a, const Vertex& b, const Vertex& c, const Vertex& d,
                   const Texture& texture) {
  const int n = static_cast<int>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c, d});
  triangles.push_back({{n, n + 1, n + 2}, &texture});
  triangles.push_back({{n, n + 2, n + 3}, &texture});
}

void Mesh::updateBoundingSphere() {
  Eigen::AlignedBox3d box;
  for (const Vertex& vertex : vertices) box.extend(vertex.p);
  centre = box.center();
  radius = box.diagonal().norm() / 2;
}

double diffuseLight(const Eigen::Vector3d& normal, const Eigen::Vector3d& sun) {
  constexpr double kSky = 0.5, kSun = 0.62;  // skylight; sun at perpendicular incidence
  return kSky + kSun * std::max(0.0, normal.dot(sun));
}

}  // namespace gsv::simulation
