#include "ground_scale_vo/scale/scale_options.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kPlaneThreshold = 0.01;      ///< [m] section III.A and III.B
constexpr double kAngleTolerance = 0.0873;    ///< [rad] 5 degrees, below Eq. 3
constexpr int kWindowFrames = 4;              ///< Alg. 2 line 8
constexpr int kMovingAverageFrames = 20;      ///< section III.C gives no number
constexpr double kUnlimitedHeights = 10000;   ///< [camera heights] ahead
constexpr double kUnlimitedHalfWidth = 1000;  ///< [camera heights]

}  // namespace

ScaleRecoveryOptions ScaleRecoveryOptions::resolved() const {
  ScaleRecoveryOptions paper = *this;
  paper.gpe.random_seed = random_seed;
  if (!paper_literal) return paper;
  paper.refine = false;                   // no direct measurements
  paper.standstill_distance_heights = 0;  // standstill is not detected

  // Eq. 3: t of the last frame pair alone.
  paper.mounting.chord_length_heights = 0.01;

  // Alg. 1 on the whole image.
  paper.gpe.min_lane_features = 0;
  paper.gpe.lane_half_width_heights = kUnlimitedHalfWidth;
  paper.gpe.max_half_width_heights = kUnlimitedHalfWidth;
  paper.gpe.max_ahead_heights = kUnlimitedHeights;
  paper.gpe.frame_pitch_test = true;  // line 10
  paper.gpe.most_inliers = true;      // line 28
  paper.gpe.motion_tolerance_rad = kAngleTolerance;
  paper.gpe.pitch_tolerance_rad = kAngleTolerance;
  paper.gpe.plane_threshold_heights = kPlaneThreshold / camera_height;
  paper.gpe.plane_threshold_sigma = 0;

  // Alg. 2: a window of four frames with all copies of a point.
  paper.gpa.window_heights = 1e6;
  paper.gpa.max_frames = kWindowFrames;
  paper.gpa.unique_features = false;
  // Eq. 6 to 8.
  paper.gpa.fit.homogeneous = true;
  paper.gpa.fit.reject_distance_heights = kPlaneThreshold / camera_height;

  paper.filter.moving_average_frames = kMovingAverageFrames;
  return paper;
}

}  // namespace ground_scale_vo
