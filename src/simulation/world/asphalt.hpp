#pragma once

#include <opencv2/core.hpp>

#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {

/// The value of a surface pattern that does not change the albedo.
constexpr double kNeutral = 128;

/// Patterns of the carriageway: factors on its albedo, 8-bit with kNeutral for a factor of 1, as
/// large as the texture of the road.

/// Patches with tarred seams, cracks, spots and manholes.
void paintAsphalt(cv::Mat pattern, WorldBuilder& builder);
/// Rows of stones across the road, each with its own grey level, with sand in the joints.
void paintCobbles(cv::Mat pattern, WorldBuilder& builder);

}  // namespace ground_scale_vo::simulation
