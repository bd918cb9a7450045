#pragma once

#include <Eigen/Core>
#include <cmath>

namespace ground_scale_vo::simulation {

// The cross-section of the street, offsets u to the left of the middle of the right lane [m]. Cars
// park between the right lane and the right kerb.
constexpr double kRightPavement = -6.3;  // outer border
constexpr double kRightKerb = -4.3;
constexpr double kRightLine = -1.9;
constexpr double kCentreLine = 1.75;
constexpr double kLeftLine = 5.35;
constexpr double kLeftKerb = 5.6;
constexpr double kLeftPavement = 7.8;  // outer border
constexpr double kKerbHeight = 0.12, kKerbStoneWidth = 0.18;

// The texture of the road covers carriageway, kerbs, pavements and the edge of the verges. Its
// u axis unrolls the cross-section, so the vertical faces of the kerbs take kKerbHeight each.
constexpr double kRoadTexel = 0.02;     // [m]
constexpr int kRoadColumns = 896;       // 17.92 m
constexpr double kTextureRight = -8.2;  // u of the first column
constexpr double kTextureLeft =
    kTextureRight + kRoadColumns * kRoadTexel - 2 * kKerbHeight;  // u of the last column

/// Texture coordinates [m] of the place (s, u) on the road. s_begin: s of the first row.
inline Eigen::Vector2d roadTextureUv(double s_begin, double s, double u) {
  const double kerbs = (u >= kRightKerb ? kKerbHeight : 0) + (u >= kLeftKerb ? kKerbHeight : 0);
  return {u - kTextureRight + kerbs, s - s_begin};
}

inline int roadTextureColumn(double u) {
  const double right = u >= kRightKerb ? kKerbHeight : 0, left = u >= kLeftKerb ? kKerbHeight : 0;
  return static_cast<int>(std::lround((u - kTextureRight + right + left) / kRoadTexel));
}

}  // namespace ground_scale_vo::simulation
