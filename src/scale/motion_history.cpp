#include "ground_scale_vo/scale/motion_history.hpp"

#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {

void MotionHistory::add(const Eigen::Isometry3d& T_w_c) {
  travelled_ += distanceFromLast(T_w_c);
  poses_.push_back({T_w_c, travelled_});
  if (poses_.size() > kMaxPoses) poses_.pop_front();
}

double MotionHistory::distanceFromLast(const Eigen::Isometry3d& T_w_c) const {
  return poses_.empty() ? 0 : (T_w_c.translation() - poses_.back().T_w_c.translation()).norm();
}

Eigen::Isometry3d MotionHistory::lastMotion() const {
  if (poses_.size() < 2) return Eigen::Isometry3d::Identity();
  return poses_.back().T_w_c.inverse() * poses_[poses_.size() - 2].T_w_c;
}

std::optional<MotionHistory::Chord> MotionHistory::chord(double min_length) const {
  if (poses_.size() < 2) return std::nullopt;
  auto start = poses_.rbegin() + 1;
  while (start + 1 != poses_.rend() && travelled_ - start->travelled < min_length) ++start;
  const Eigen::Isometry3d& T_w_c = poses_.back().T_w_c;
  const Eigen::Vector3d chord_w = T_w_c.translation() - start->T_w_c.translation();
  const double length = chord_w.norm();
  if (!(length > 0)) return std::nullopt;
  return Chord{T_w_c.linear().transpose() * chord_w / length, length,
               rotationVector(start->T_w_c.linear().transpose() * T_w_c.linear())};
}

void MotionHistory::reset() {
  poses_.clear();
  travelled_ = 0;
}

}  // namespace ground_scale_vo
