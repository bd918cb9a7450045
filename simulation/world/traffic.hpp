#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "simulation/renderer/scene.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/world/motion.hpp"
#include "simulation/world/world.hpp"

namespace gsv::simulation {

/// Moving vehicles other than the ego vehicle, as far as the options enable them: one ahead in the
/// lane with either oncoming cars or cars at the same speed in the left lane, and a lorry that cuts
/// in. Positions (s, u) as in RoadGeometry: s along the lane, u to its left [m].
class Traffic {
 public:
  /// Keeps references to all arguments: they must outlive the object.
  Traffic(const SyntheticDrive::Options& options, const SpeedProfile& profile,
          const RoadGeometry& road, const World& world);
  Traffic(const Traffic&) = delete;
  Traffic& operator=(const Traffic&) = delete;

  /// Adds the vehicles and their shadows in frame i. t: time of the exposure since the start of the
  /// drive [s].
  void addTo(Scene& scene, std::size_t i, double t) const;

 private:
  void addVehicle(Scene& scene, const Mesh& mesh, const Eigen::Vector2d& size, double ego_s,
                  double s, double u, bool oncoming) const;
  void addCars(Scene& scene, double t) const;
  void addLorry(Scene& scene, std::size_t i, double t) const;

  const SyntheticDrive::Options& options_;
  const SpeedProfile& profile_;
  const RoadGeometry& road_;
  const World& world_;
  std::optional<Texture> lorry_texture_;
  Mesh lorry_;
};

/// The shadow on the road of the ego vehicle, whose roof is as high as the camera:
/// Scene::ego_shadow. s: position of the camera along the lane [m].
std::vector<Eigen::Vector3d> egoShadow(const SyntheticDrive::Options& options,
                                       const RoadGeometry& road, double s);

}  // namespace gsv::simulation
