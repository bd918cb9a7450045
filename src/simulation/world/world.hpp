#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "simulation/world/road_geometry.hpp"
#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {

/// The static street, and the meshes of cars. Immutable once built. A seed gives the same world on
/// every platform.
class World {
 public:
  World(const RoadGeometry& road, const WorldOptions& options);
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  /// Static instances, sky and road. Moving vehicles are added per frame.
  const Scene& scene() const { return assets_.scene; }
  /// The mesh of car model i modulo the number of models, so that every i is valid.
  const Mesh& car(std::size_t i) const { return assets_.car(i); }
  const Mesh& van() const { return assets_.van; }
  /// Texture coordinates (across, along) [m] of the road surface at (s, u), as in RoadGeometry: s
  /// is the length along the middle of the right lane, in which the camera drives, u the offset to
  /// its left [m].
  Eigen::Vector2d roadUv(double s, double u) const;

 private:
  WorldAssets assets_;
  double s_begin_;  // [m] s at which the road texture begins
};

}  // namespace ground_scale_vo::simulation
