#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "synthetic_renderer.hpp"

namespace ground_scale_vo::synthetic {

constexpr double kCarLength = 4.2, kCarWidth = 1.7;  // [m]
constexpr double kCarTexel = 0.01;                   // [m]

/// The skin of a car in the grey level `body`, 5.12 x 2.56 m: the side at (0, 0), the rear at
/// (0, 1.3), paint at (2, 1.3), glass at (3.2, 1.3), a wheel at (4.35, 0).
cv::Mat carImage(double body, std::uint64_t seed);

/// A car in its skin: side profiles drawn out over the width. x forward, y left, z up, the origin
/// on the road below its middle.
Mesh carMesh(const Texture& texture);

}  // namespace ground_scale_vo::synthetic
