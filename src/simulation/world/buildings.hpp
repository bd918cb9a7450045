#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {

/// Houses beside the road, their hedges or low walls, and a house that blocks the road.
/// Coordinates (s, u) as in RoadGeometry: s along the lane, u to its left [m].
/// Mesh axes m of a building: x along its front, y = 0 at the front and positive inwards, z up.
class BuildingGenerator {
 public:
  explicit BuildingGenerator(WorldBuilder& builder);
  void addHouses();
  /// A house across road and pavements at options.wall_at_m.
  void addWallAcrossRoad();

 private:
  void addHedge(double s, double u, double length);
  Mesh houseMesh(double length, double depth, double height, double roof_height,
                 const Eigen::Matrix3d& R_w_m, const Texture& front, const Texture& sides) const;
  cv::Mat facadeImage(double length, double height, int floors, double wall_grey);
  bool isClearOfRoad(double s, const Eigen::Isometry3d& T_w_m, double length, double depth) const;

  WorldBuilder& builder_;
  cv::Mat plaster_;  ///< noise texture of the plaster
};

}  // namespace ground_scale_vo::simulation
