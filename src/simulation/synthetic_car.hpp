#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "synthetic_renderer.hpp"

namespace ground_scale_vo::synthetic {

constexpr double kCarLength = 4.2, kCarWidth = 1.7;                    // [m]
constexpr double kVanLength = 5.6, kVanWidth = 2.1, kVanHeight = 2.5;  // [m]
constexpr double kCarTexel = 0.01;                                     // [m]

/// The skin of a car in the grey level `body`, 5.12 x 2.56 m: the side at (0, 0), the rear at
/// (0, 1.3), paint at (2, 1.3), glass at (3.2, 1.3), a wheel at (4.35, 0).
cv::Mat carImage(double body, std::uint64_t seed);

/// A car in its skin: side profiles drawn out over the width. x forward, y left, z up, the origin
/// on the road below its middle. sun: unit vector towards it.
Mesh carMesh(const Texture& texture, const Eigen::Vector3d& sun);

/// Dark paint with creases, 2.56 x 2.56 m, the windscreen's side at the bottom.
cv::Mat hoodImage(std::uint64_t seed);

/// The own hood in its skin, in the camera's axes: it hides this share of the image's height in the
/// middle, less to both sides.
Mesh hoodMesh(const Texture& texture, const PinholeCamera& camera, double share);

/// The skin of a van, 10.24 x 5.12 m: the side at (0, 0), the rear at (6, 0), paint at (0, 3),
/// glass at (3, 3), a wheel at (8, 3).
cv::Mat vanImage(double body, std::uint64_t seed);

/// A van in its skin; axes as carMesh's.
Mesh vanMesh(const Texture& texture, const Eigen::Vector3d& sun);

}  // namespace ground_scale_vo::synthetic
