#pragma once

#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "simulation/rendering/scene.hpp"
#include "simulation/world/world.hpp"

namespace ground_scale_vo::simulation {

/// The shadow of the car around the camera at s, as high as the camera.
PolygonShadow egoShadow(const SyntheticDrive::Options& options, const RoadGeometry& road,
                        const World& world, double s);

}  // namespace ground_scale_vo::simulation
