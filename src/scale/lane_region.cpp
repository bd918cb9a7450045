#include "ground_scale_vo/scale/lane_region.hpp"

#include <cmath>

namespace ground_scale_vo {

LaneRegion::LaneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
                       double height, double min_ahead, double max_ahead, double half_width)
    : up_(prior.n_c), min_ahead_(min_ahead), max_ahead_(max_ahead), half_width_(half_width) {
  const bool reverse = prior.forward_c.z() < 0;
  ahead_ = reverse ? Eigen::Vector3d(-prior.forward_c) : prior.forward_c;
  left_ = up_.cross(ahead_);
  if (chord && height > 0) {
    // In reverse the driven path lies ahead of the camera: the chord starts at ahead = +length
    // instead of -length, hence the negative sign.
    chord_length_ = (reverse ? -1 : 1) * chord->length / height;
    curvature_ = up_.dot(chord->turn_c) / chord_length_;
  }
}

bool LaneRegion::contains(const Eigen::Vector3d& ray) const {
  const double down = -up_.dot(ray);
  if (!(down > 0)) return false;
  const double ahead = ahead_.dot(ray) / down;
  if (ahead < min_ahead_ || ahead > max_ahead_) return false;
  // Parabola of the given curvature through both ends of the chord (ahead = 0 and -chord_length_).
  // The offset is relative to the chord, not to the tangent at the camera.
  const double path = 0.5 * curvature_ * ahead * (ahead + chord_length_);
  return std::abs(left_.dot(ray) / down - path) <= half_width_;
}

}  // namespace ground_scale_vo
