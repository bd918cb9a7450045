#include "scale/camera_path.hpp"

#include <limits>

namespace ground_scale_vo {

void CameraPath::add(const Eigen::Isometry3d& T_w_c, std::int64_t stamp_ns) {
  const double travelled = empty() ? 0 : newest().travelled + distanceTo(T_w_c);
  Camera& camera = cameras_.emplace_back();
  camera.T_w_c = T_w_c;
  camera.stamp_ns = stamp_ns;
  camera.travelled = travelled;
  if (cameras_.size() > kMaxCameras) cameras_.pop_front();
}

double CameraPath::distanceTo(const Eigen::Isometry3d& T_w_c) const {
  return empty() ? 0 : (T_w_c.translation() - newest().T_w_c.translation()).norm();
}

Eigen::Isometry3d CameraPath::lastMotion() const {
  if (cameras_.size() < 2) return Eigen::Isometry3d::Identity();
  return newest().T_w_c.inverse() * cameras_[cameras_.size() - 2].T_w_c;
}

std::optional<Chord> CameraPath::chord(double min_length) const {
  if (cameras_.size() < 2) return std::nullopt;
  auto start = cameras_.rbegin() + 1;
  while (start + 1 != cameras_.rend() && newest().travelled - start->travelled < min_length) {
    ++start;
  }
  const Eigen::Isometry3d& T_w_c = newest().T_w_c;
  const Eigen::Vector3d chord_w = T_w_c.translation() - start->T_w_c.translation();
  const double length = chord_w.norm();
  if (!(length > 0)) return std::nullopt;
  return Chord{T_w_c.linear().transpose() * chord_w / length, length,
               rotationVector(start->T_w_c.linear().transpose() * T_w_c.linear())};
}

const CameraPath::Camera& CameraPath::nearest(const Eigen::Vector3d& p_w, double max_length) const {
  const Camera* nearest = &newest();
  double least = std::numeric_limits<double>::infinity();
  for (auto camera = cameras_.rbegin(); camera != cameras_.rend(); ++camera) {
    if (newest().travelled - camera->travelled > max_length) break;
    const double distance = (camera->T_w_c.translation() - p_w).norm();
    if (distance < least) {
      least = distance;
      nearest = &*camera;
    }
  }
  return *nearest;
}

}  // namespace ground_scale_vo
