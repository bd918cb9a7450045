#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>

#include "ground_scale_vo/input/camera.hpp"
#include "simulation/renderer/scene.hpp"

namespace gsv::simulation {

constexpr double kCarLength = 4.2, kCarWidth = 1.7;                    // [m]
constexpr double kVanLength = 5.6, kVanWidth = 2.1, kVanHeight = 2.5;  // [m]
constexpr double kVehicleTexel = 0.01;                                 // [m]

// Vehicle meshes: x forward, y left, z up, the origin on the road below the middle. body: grey
// level of the paint; sun: unit vector towards the sun.

// The layout of a texture is given by (u, v) [m] of the upper left corner of each part, and of the
// hub for the wheel.

/// 5.12 x 2.56 m: side at (0, 0), rear at (0, 1.3), paint at (2, 1.3), glass at (3.2, 1.3), wheel
/// hub at (4.7, 0.33).
cv::Mat carTextureImage(double body, std::uint64_t seed);
Mesh carMesh(const Texture& texture, const Eigen::Vector3d& sun);

/// 10.24 x 5.12 m: side at (0, 0), rear at (6, 0), paint at (0, 3), glass at (3, 3), wheel hub at
/// (8, 3).
cv::Mat vanTextureImage(double body, std::uint64_t seed);
Mesh vanMesh(const Texture& texture, const Eigen::Vector3d& sun);

/// The hood of the ego vehicle, 2.56 x 2.56 m, the windscreen at the lower edge.
cv::Mat hoodTextureImage(std::uint64_t seed);
/// In camera axes. image_height_fraction: covered fraction of the image height in the middle; less
/// at both sides.
Mesh hoodMesh(const Texture& texture, const PinholeCamera& camera, double image_height_fraction);

}  // namespace gsv::simulation
