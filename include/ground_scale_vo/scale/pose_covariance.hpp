#pragma once

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Covariance of the frame's pose relative to its map points: position [m], then rotation [rad],
/// both in camera axes. It is that of least squares, sigma^2 (J^T J)^-1, with the Jacobian J of the
/// reprojections of all inliers; sigma is estimated from the reprojection errors, so that it adapts
/// to noise, blur and compression. Zero with fewer than kMinPosePoints usable points and when the
/// result is not finite. scale: [m per VO unit].
Matrix6d poseCovariance(const VoFrame& frame, double scale);

constexpr int kMinPosePoints = 12;

}  // namespace ground_scale_vo
