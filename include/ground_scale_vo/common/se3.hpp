#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>

namespace gsv {

// Small motions of a pose are 6-vectors (w, v): w [rad] is a rotation vector (axis times angle), v
// a translation. Both are in the axes of the frame that moves, and translation is not coupled to
// rotation: the retraction is that of SO(3) x R^3, not the exponential map of SE(3). Only
// exponentialMap() and logarithm() couple them.

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// The pose of a camera in a world frame at the stamp of an image.
struct StampedPose {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
};

/// The matrix of the cross product: skew(a) * b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

/// Axis times angle, [rad]: the inverse of exp([w]x).
inline Eigen::Vector3d rotationVector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd rotation(R);
  return rotation.angle() * rotation.axis();
}

/// A rotation matrix without the rounding errors that products of rotations accumulate.
inline Eigen::Matrix3d renormalised(const Eigen::Matrix3d& R) {
  return Eigen::Quaterniond(R).normalized().toRotationMatrix();
}

/// The motion with rotation exp([w]x) and translation v itself: not the exponential map of SE(3),
/// whose translation also depends on w.
inline Eigen::Isometry3d motionFrom(const Vector6d& delta) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  const double angle = delta.head<3>().norm();
  if (angle > 0) T.linear() = Eigen::AngleAxisd(angle, delta.head<3>() / angle).matrix();
  T.translation() = delta.tail<3>();
  return T;
}

/// Exponential map of SE(3): the motion at a constant rotation rate and a constant velocity in the
/// axes of the frame that moves. w: rate times duration, v: velocity times duration.
inline Eigen::Isometry3d exponentialMap(const Eigen::Vector3d& w, const Eigen::Vector3d& v) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = v;
  const double angle = w.norm();
  if (!(angle > 0)) return T;
  const Eigen::Vector3d axis = w / angle;
  T.linear() = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  T.translation() += (1 - std::cos(angle)) / angle * axis.cross(v) +
                     (1 - std::sin(angle) / angle) * axis.cross(axis.cross(v));
  return T;
}

/// Logarithm of SE(3), the inverse of exponentialMap() for angles up to pi: (w, v) with w the
/// rotation vector and v = J_l(w)^-1 t.
inline Vector6d logarithm(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d w = rotationVector(T.linear()), t = T.translation();
  const double half = 0.5 * w.norm();
  const double share = half < 1e-4 ? 1.0 / 12 : (1 - half / std::tan(half)) / (4 * half * half);
  Vector6d log;
  log << w, t - 0.5 * w.cross(t) + share * w.cross(w.cross(t));
  return log;
}

/// The constant twist that moves a frame by T_then_now in dt [s]: linear, then angular velocity, as
/// in geometry_msgs/Twist, in the axes of the frame that moves.
inline Vector6d meanTwist(const Eigen::Isometry3d& T_then_now, double dt) {
  const Vector6d log = logarithm(T_then_now);
  Vector6d twist;
  twist << log.tail<3>(), log.head<3>();
  return twist / dt;
}

/// Retraction: T_a_b after b has moved by delta in its own axes, (R exp([w]x), t + R v).
inline Eigen::Isometry3d boxplus(const Eigen::Isometry3d& T_a_b, const Vector6d& delta) {
  return T_a_b * motionFrom(delta);
}

/// Covariance of a pose (position, then rotation) whose positions are multiplied by
/// a factor.
inline Matrix6d withScaledPosition(const Matrix6d& covariance, double factor) {
  Vector6d factors;
  factors << factor, factor, factor, 1, 1, 1;
  return factors.asDiagonal() * covariance * factors.asDiagonal();
}

/// Adjoint: turns a small motion (w, v) in the axes of b into the same motion in those of a.
inline Matrix6d adjoint(const Eigen::Isometry3d& T_a_b) {
  Matrix6d m;
  m << T_a_b.linear(), Eigen::Matrix3d::Zero(), skew(T_a_b.translation()) * T_a_b.linear(),
      T_a_b.linear();
  return m;
}

}  // namespace gsv
