#include "ground_scale_vo/scale/camera_path.hpp"

#include <algorithm>

namespace ground_scale_vo {

void CameraPath::add(const Eigen::Isometry3d& T_w_c, const NormalPrior& prior, double step,
                     double max_length) {
  travelled_ += step;
  entries_.push_back({{T_w_c, prior}, travelled_});
  while (entries_.size() > kMaxCameras || travelled_ - entries_.front().travelled > max_length) {
    entries_.pop_front();
  }
}

const CameraPath::Camera& CameraPath::nearest(const Eigen::Vector3d& p_w) const {
  const auto squaredDistance = [&](const Entry& entry) {
    return (entry.camera.T_w_c.translation() - p_w).squaredNorm();
  };
  return std::min_element(entries_.begin(), entries_.end(),
                          [&](const Entry& a, const Entry& b) {
                            return squaredDistance(a) < squaredDistance(b);
                          })
      ->camera;
}

void CameraPath::clear() { *this = CameraPath(); }

}  // namespace ground_scale_vo
