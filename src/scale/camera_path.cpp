#include "scale/camera_path.hpp"

#include <limits>

namespace gsv {
namespace {

/// Kept images. Two baselines at the minimum spacing are ten intervals between eleven images; two
/// more: the current one, and the one before it, which may be closer to its predecessor.
constexpr std::size_t kMaxImages = 13;

double distanceBetween(const StampedPose& a, const StampedPose& b) {
  return (a.T_w_c.translation() - b.T_w_c.translation()).norm();
}

}  // namespace

CameraPath::Pose& CameraPath::add(const StampedPose& pose) {
  const double travelled = empty() ? 0 : newest().travelled + distanceTo(pose.T_w_c);
  Pose& added = poses_.emplace_back();
  static_cast<StampedPose&>(added) = pose;
  added.travelled = travelled;
  if (poses_.size() > kMaxPoses) poses_.pop_front();
  return added;
}

void CameraPath::keepRoad(const RoadImage& road) {
  for (Pose& pose : poses_) {
    if (pose.road.setting != road.setting) pose.road = {};
  }
  poses_.back().road = road;
  std::vector<Pose*> kept;  // newest first
  for (auto pose = poses_.rbegin(); pose != poses_.rend(); ++pose) {
    if (!pose->road.roi.empty()) kept.push_back(&*pose);
  }
  if (kept.size() > 2 && distanceBetween(*kept[1], *kept[2]) < road.min_spacing) kept[1]->road = {};
  for (std::size_t i = kMaxImages; i < kept.size(); ++i) kept[i]->road = {};
}

double CameraPath::distanceTo(const Eigen::Isometry3d& T_w_c) const {
  return empty() ? 0 : (T_w_c.translation() - newest().T_w_c.translation()).norm();
}

Eigen::Isometry3d CameraPath::lastMotion() const {
  if (poses_.size() < 2) return Eigen::Isometry3d::Identity();
  return newest().T_w_c.inverse() * poses_[poses_.size() - 2].T_w_c;
}

std::optional<Chord> CameraPath::chord(double min_length) const {
  if (poses_.size() < 2) return std::nullopt;
  auto start = poses_.rbegin() + 1;
  while (start + 1 != poses_.rend() && newest().travelled - start->travelled < min_length) {
    ++start;
  }
  const Eigen::Isometry3d& T_w_c = newest().T_w_c;
  const Eigen::Vector3d chord_w = T_w_c.translation() - start->T_w_c.translation();
  const double length = chord_w.norm();
  if (!(length > 0)) return std::nullopt;
  return Chord{T_w_c.linear().transpose() * chord_w / length, length,
               rotationVector(start->T_w_c.linear().transpose() * T_w_c.linear())};
}

const CameraPath::Pose& CameraPath::nearest(const Eigen::Vector3d& p_w, double max_length) const {
  const Pose* nearest = &newest();
  double least = std::numeric_limits<double>::infinity();
  for (auto pose = poses_.rbegin(); pose != poses_.rend(); ++pose) {
    if (newest().travelled - pose->travelled > max_length) break;
    const double distance = (pose->T_w_c.translation() - p_w).norm();
    if (distance < least) {
      least = distance;
      nearest = &*pose;
    }
  }
  return *nearest;
}

}  // namespace gsv
