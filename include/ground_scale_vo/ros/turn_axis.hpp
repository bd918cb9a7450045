#pragma once

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <optional>

#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {

/// The axis about which a vehicle turns, in camera axes: the road's normal, also of a camera that
/// is mounted so that no road can be measured. Unlike a measured plane it does not tell up from
/// down.
class TurnAxis {
 public:
  /// [rad] Rotation of which the axis is one sample. A vehicle hardly pitches or rolls by so much.
  static constexpr double kTurn = 10 * M_PI / 180;
  static constexpr int kMinTurns = 4;

  /// Rotation of the camera of the next frame of a map.
  void add(std::uint32_t map_id, const Eigen::Matrix3d& R_w_c) {
    if (!start_ || map_id != map_id_) start_ = R_w_c;
    map_id_ = map_id;
    const Eigen::Vector3d turn_c = rotationVector(start_->transpose() * R_w_c);
    if (turn_c.norm() < kTurn) return;
    scatter_ += turn_c.normalized() * turn_c.normalized().transpose();
    start_ = R_w_c;
    ++turns_;
  }
  /// Unit, with the sign that has the smaller angle to the camera's up; empty: it has not turned
  /// enough.
  std::optional<Eigen::Vector3d> upward() const {
    if (turns_ < kMinTurns) return std::nullopt;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter_);
    const Eigen::Vector3d axis = solver.eigenvectors().col(2);  // of the largest eigenvalue
    return axis.y() > 0 ? Eigen::Vector3d(-axis) : axis;
  }

 private:
  std::uint32_t map_id_ = 0;
  std::optional<Eigen::Matrix3d> start_;  ///< R_w_c
  Eigen::Matrix3d scatter_ = Eigen::Matrix3d::Zero();
  int turns_ = 0;
};

}  // namespace ground_scale_vo
