#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <vector>

#include "synthetic_renderer.hpp"
#include "synthetic_street.hpp"

namespace ground_scale_vo::synthetic {

/// As SyntheticDrive::Options says.
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
};

/// Everything that stands still, and the meshes of cars. Immutable once built.
class World {
 public:
  World(const Street& street, const WorldOptions& options);
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  /// Static instances, sky and road; moving cars are to be added.
  const Scene& scene() const { return scene_; }
  const Mesh& car(std::size_t i) const { return cars_[i % cars_.size()]; }
  const Mesh& van() const { return van_; }
  Eigen::Vector2d roadTexture(double s, double u) const;  ///< [m]

 private:
  class Builder;
  Scene scene_;
  double road_from_ = 0;  ///< s of the road texture's upper edge
  std::deque<Texture> textures_;
  std::deque<Mesh> meshes_;
  std::vector<Mesh> cars_;  ///< x forward, origin on the road below the middle
  Mesh van_;                ///< the same axes
};

}  // namespace ground_scale_vo::synthetic
