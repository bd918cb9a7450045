#pragma once

#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "simulation/rendering/scene.hpp"
#include "simulation/world/world.hpp"

namespace ground_scale_vo::simulation {

/// The shadow on the road of the ego vehicle, whose roof is as high as the camera. s: position of
/// the camera along the lane [m].
PolygonShadow egoShadow(const SyntheticDrive::Options& options, const RoadGeometry& road,
                        const World& world, double s);

}  // namespace ground_scale_vo::simulation
