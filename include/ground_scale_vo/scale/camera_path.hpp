#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>

#include "ground_scale_vo/scale/ground_plane.hpp"

namespace ground_scale_vo {

/// The cameras of the last part of the path, to find the one above a piece of road.
///
/// The height of a camera above a plane is accurate where the points of the plane are: the error of
/// the plane's normal, and of the assumption that the road is plane, grow with the distance. Of
/// all cameras of the path, the newest is nearest to the road ahead of it. A camera that faces
/// backwards sees road that it has passed, so an earlier one is nearer.
class CameraPath {
 public:
  struct Camera {
    Eigen::Isometry3d T_w_c;
    NormalPrior prior;  ///< of the road's normal at this camera
  };

  /// Appends the newest camera, `step` after the previous one. Drops those farther back along the
  /// path than max_length. Lengths in VO units.
  void add(const Eigen::Isometry3d& T_w_c, const NormalPrior& prior, double step,
           double max_length);

  /// The camera with the least distance from p_w. Precondition: not empty.
  const Camera& nearest(const Eigen::Vector3d& p_w) const;

  bool empty() const { return entries_.empty(); }
  void clear();

 private:
  static constexpr std::size_t kMaxCameras = 1000;  ///< bounds the time of nearest()

  struct Entry {
    Camera camera;
    double travelled;
  };
  std::deque<Entry> entries_;
  double travelled_ = 0;
};

}  // namespace ground_scale_vo
