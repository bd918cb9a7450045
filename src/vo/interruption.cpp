#include "vo/interruption.hpp"

#include <utility>
#include <vector>

namespace ground_scale_vo {

/// Keeps the more certain of two rotations: the one since the last frame with a pose, and the
/// product of the rotations from image to image.
void Interruption::addImage(const std::optional<RelativeRotation>& rotation, Descriptors corners) {
  RotationChain direct;
  direct.append(rotation);
  if (last_) rotation_.append(rotationBetween(*last_, corners));
  if (!last_ || direct.sigma() < rotation_.sigma()) rotation_ = direct;
  last_ = std::move(corners);
  ++images_;
}

void Interruption::end() {
  images_ = 0;
  last_.reset();
  rotation_ = {};
}

std::optional<RelativeRotation> Interruption::rotationBetween(const Descriptors& a,
                                                              const Descriptors& b) const {
  std::vector<Eigen::Vector2d> u1, u2;
  for (const DescriptorMatch& match : matchDescriptors(a, b)) {
    const cv::Point2f &p1 = a.points()[match.from], &p2 = b.points()[match.to];
    u1.emplace_back(p1.x, p1.y);
    u2.emplace_back(p2.x, p2.y);
  }
  return two_view_.estimateRotation(camera_, u1, u2);
}

}  // namespace ground_scale_vo
