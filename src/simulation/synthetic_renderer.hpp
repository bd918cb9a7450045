#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo::synthetic {

/// A grey texture with its pyramid, addressed in metres from its upper left corner.
class Texture {
 public:
  enum class Wrap { kRepeat, kClamp };

  /// base: 8-bit, one channel; for kRepeat both sides are powers of two. texel_m: side of a texel.
  Texture(const cv::Mat& base, double texel_m, Wrap wrap);

  double width() const { return levels_[0].cols * texel_m_; }   ///< [m]
  double height() const { return levels_[0].rows * texel_m_; }  ///< [m]

  /// Grey level averaged over the ellipse that one pixel covers: J = d(u, v)/d(x, y) [m/px].
  /// Samples stand along the ellipse's long axis, on the level of its short one.
  float sample(const Eigen::Vector2d& uv, const Eigen::Matrix2d& J) const;

 private:
  float bilinear(std::size_t level, double x, double y) const;
  std::vector<cv::Mat> levels_;
  double texel_m_;
  Wrap wrap_;
};

struct Vertex {
  Eigen::Vector3d p;   ///< [m] in the mesh's frame
  Eigen::Vector2d uv;  ///< in the texture [m]
  double shade = 1;    ///< light that falls on it, 1 = full
};

struct Mesh {
  struct Triangle {
    int v[3];
    const Texture* texture;
  };
  std::vector<Vertex> vertices;
  std::vector<Triangle> triangles;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< of a sphere around it
  double radius = 0;

  /// The corners in turn, in either sense.
  void addQuad(const Vertex& a, const Vertex& b, const Vertex& c, const Vertex& d,
               const Texture& texture);
  void addTriangle(const Vertex& a, const Vertex& b, const Vertex& c, const Texture& texture);
  /// Sets centre and radius; to be called when the mesh is complete.
  void bound();
};

struct Instance {
  const Mesh* mesh;
  Eigen::Isometry3d T_w_m;
  bool mirrored = true;  ///< puddles show it
};

/// Shadow of a moving car, in the road texture's metres.
struct CarShadow {
  Eigen::Vector2d uv;
  Eigen::Vector2d half_size;
};

/// Sharp shadow of a convex outline, in the road texture's metres: where every edge (a, b, c) has
/// a u + b v + c > 0. (a, b) is a unit vector.
struct OutlineShadow {
  std::vector<Eigen::Vector3d> edges;
};

struct Scene {
  std::vector<Instance> instances;
  const Texture* sky = nullptr;   ///< panorama: u = azimuth, v = kSkyTop - elevation [rad]
  const Texture* road = nullptr;  ///< the only one on which shadows fall
  std::vector<CarShadow> shadows;
  OutlineShadow own_shadow;  ///< none without edges

  /// Share of water on the road [1/255], addressed as the road's texture, between these u [m].
  /// Water lies in the plane z = 0 and mirrors what is above it. nullptr: dry.
  const Texture* puddles = nullptr;
  double puddles_from = 0, puddles_to = 0;

  /// Factor on the road's grey, 128 = 1, addressed as the road's texture; nullptr: none.
  const Texture* grain = nullptr;

  const Texture* hood = nullptr;  ///< what has this texture mirrors the upper part of the picture
  double hood_share = 0;          ///< of the image's height

  double daylight = 1;  ///< 1 = day
  /// Axes x right, y down, z ahead, the origin between two headlamps; without it they are off.
  std::optional<Eigen::Isometry3d> T_w_lamps;
};
constexpr double kSkyTop = 0.68;  ///< elevation of the panorama's upper edge [rad]

/// What an ideal camera sees, in grey levels (CV_32F). World axes: z up. Two by two visibility
/// samples a pixel; each surface in a pixel is shaded once, with its texture filtered over it.
cv::Mat render(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c);

}  // namespace ground_scale_vo::synthetic
