#pragma once

#include <cstddef>
#include <deque>
#include <vector>

#include "simulation/renderer/scene.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/world/road_geometry.hpp"

namespace gsv::simulation {

/// The static street, and the meshes of vehicles. A seed gives the same world on every platform.
struct World {
  World(const RoadGeometry& road, const SyntheticDrive::Options& options);
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  /// The mesh of car model i modulo the number of models, so that every i is valid.
  const Mesh& car(std::size_t i) const { return cars[i % cars.size()]; }

  Scene scene;  ///< static instances, sky and road. Moving vehicles are added per frame
  std::deque<Texture> textures;  ///< references stay valid when one is appended
  std::deque<Mesh> meshes;
  std::vector<Mesh> cars;
  Mesh van;
};

}  // namespace gsv::simulation
