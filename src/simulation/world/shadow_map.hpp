#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "simulation/world/road_geometry.hpp"

namespace ground_scale_vo::simulation {

/// Shadows of static objects on the road, at an eighth of the resolution of the road texture.
class ShadowMap {
 public:
  /// sun: unit vector towards the sun, in world axes. road_texels: size of the road texture.
  ShadowMap(const RoadGeometry& road, const Eigen::Vector3d& sun, cv::Size road_texels);

  // Objects stand at (s, u) of the RoadGeometry. Offsets from there are along the road and to its
  // left, heights above the road [m].

  // A later shadow replaces an earlier one where they overlap, also a darker one.

  /// Shadow of a vertical prism over a polygon, or of a vertical wall over two points. opacity: of
  /// the object, 1 halves the light.
  void castPrism(double s, double u, const std::vector<Eigen::Vector2d>& base, double height,
                 double opacity);
  /// Round shadow of a small object at `offset` (along, left, up). radius [m].
  void castSpot(double s, double u, const Eigen::Vector3d& offset, double radius);
  /// Sets the light on the full width of the road between two positions. light: 1 = full.
  void setLight(double s_begin, double s_end, double light);

  /// Light on the road at the resolution of the road texture, 8-bit, 255 = full.
  cv::Mat light() const;

 private:
  Eigen::Vector2d shadowUv(double s, double u, const Eigen::Vector3d& offset) const;
  const RoadGeometry& road_;
  const Eigen::Vector3d sun_;
  const cv::Size road_texels_;
  cv::Mat map_;
};

}  // namespace ground_scale_vo::simulation
