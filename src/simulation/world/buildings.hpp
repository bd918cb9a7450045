#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {

/// Houses beside the road, their hedges, and a house across the road.
class BuildingGenerator {
 public:
  explicit BuildingGenerator(WorldBuilder& builder);
  void addHouses();
  /// The front of a house across road and pavements at options.wall_at.
  void addHouseAcrossRoad();

 private:
  void addHedge(double s, double u, double length);
  Mesh houseMesh(double length, double depth, double height, double roof,
                 const Eigen::Matrix3d& R_w_m, const Texture& front, const Texture& sides) const;
  cv::Mat facadeImage(double length, double height, int floors, double wall);
  bool isClearOfRoad(const Eigen::Isometry3d& T_w_m, double length, double depth) const;

  WorldBuilder& builder_;
  cv::Mat plaster_;  // noise
};

}  // namespace ground_scale_vo::simulation
