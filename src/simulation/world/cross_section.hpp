#pragma once

#include <Eigen/Core>
#include <cmath>

namespace ground_scale_vo::simulation {

// The cross-section of the street: lateral offsets u [m] from the middle of the right lane,
// positive to the left. Cars park between the right lane and the right kerb.
constexpr double kRightPavement = -6.3;  // outer border
constexpr double kRightKerb = -4.3;
constexpr double kRightLine = -1.9;
constexpr double kCentreLine = 1.75;
constexpr double kLeftLine = 5.35;
constexpr double kLeftKerb = 5.6;
constexpr double kLeftPavement = 7.8;  // outer border
constexpr double kKerbStoneWidth = 0.18;

// The texture of the road covers carriageway, kerbs, pavements and the edge of the verges.
// Across the road the texture unrolls the cross-section: the vertical faces of the kerbs take
// kKerbFace each, whatever the height of the kerbs.
constexpr double kKerbFace = 0.12;
constexpr double kRoadTexel = 0.02;     // [m]
constexpr int kRoadColumns = 896;       // 17.92 m
constexpr double kTextureRight = -8.2;  // right edge: u of column 0
constexpr double kTextureLeft = kTextureRight + kRoadColumns * kRoadTexel -
                                2 * kKerbFace;  // left edge: one past the last column

/// Texture coordinates [m] (across, along) of the road point at arc length s and lateral offset u
/// [m]. s_begin: s of the first row.
inline Eigen::Vector2d roadTextureUv(double s_begin, double s, double u) {
  const double kerbs = (u >= kRightKerb ? kKerbFace : 0) + (u >= kLeftKerb ? kKerbFace : 0);
  return {u - kTextureRight + kerbs, s - s_begin};
}

/// Column of the road texture at lateral offset u [m]; at a kerb the first one after its vertical
/// face.
inline int roadTextureColumn(double u) {
  const double right = u >= kRightKerb ? kKerbFace : 0, left = u >= kLeftKerb ? kKerbFace : 0;
  return static_cast<int>(std::lround((u - kTextureRight + right + left) / kRoadTexel));
}

}  // namespace ground_scale_vo::simulation
