#include "synthetic_car.hpp"

#include <array>
#include <cmath>

#include "synthetic_paint.hpp"
#include "synthetic_street.hpp"

namespace ground_scale_vo::synthetic {

cv::Mat carImage(double body, std::uint64_t seed) {
  cv::Mat image = grey(noiseTile({512, 256}, seed, {{20, 1}}), body, 4);
  Brush brush(image, 0.01);
  const double dark = body * 0.55, glass = 38;
  brush.box(0, 0.95, 4.3, 0.3, body * 0.8);  // the lower side
  brush.box(0, 1.13, 4.3, 0.1, dark * 0.6);
  for (const double seam : {1.15, 2.05, 3.05}) brush.box(seam, 0.1, 0.025, 0.98, dark);
  for (const double handle : {1.35, 2.25}) brush.box(handle, 0.72, 0.16, 0.035, 255 - body);
  brush.polygon({{0.62, 0.56}, {0.86, 0.14}, {1.42, 0.14}, {1.42, 0.56}}, glass);
  brush.polygon({{1.52, 0.56}, {1.52, 0.14}, {2.2, 0.14}, {2.72, 0.56}}, glass + 15);
  brush.box(0, 0.68, 0.16, 0.14, 70);      // rear light
  brush.box(3.96, 0.72, 0.24, 0.12, 235);  // head light
  brush.box(0.1, 1.45, 0.32, 0.17, 80);    // rear: lights, plate, seam, bumper
  brush.box(1.28, 1.45, 0.32, 0.17, 80);
  brush.box(0.58, 1.5, 0.54, 0.12, 240);
  brush.box(0.66, 1.53, 0.38, 0.06, 60);
  brush.box(0, 1.68, 1.7, 0.02, dark);
  brush.box(0, 1.72, 1.7, 0.16, body * 0.75);
  brush.box(3.2, 1.25, 1.1, 1.1, glass);
  brush.polygon({{3.3, 2.2}, {3.9, 1.3}, {4.1, 1.3}, {3.5, 2.2}}, glass + 14);
  brush.ellipse({4.7, 0.33}, {0.4, 0.4}, 22);
  brush.ellipse({4.7, 0.33}, {0.2, 0.2}, 150);
  for (const double spoke : {0.3, 1.6, 2.8, 4.1, 5.3}) {
    brush.ellipse({4.7 + 0.12 * std::cos(spoke), 0.33 + 0.12 * std::sin(spoke)}, {0.04, 0.04}, 40);
  }
  return image;
}

Mesh carMesh(const Texture& texture) {
  Mesh mesh;
  const double half = kCarWidth / 2, rear = -kCarLength / 2, front = kCarLength / 2;
  struct Point {
    double x, z, half_width;
  };
  const std::array<Point, 9> outline{{{rear, 0.28, half},
                                      {rear, 0.8, half},
                                      {rear + 0.3, 0.92, half},
                                      {rear + 0.75, 1.42, half - 0.16},
                                      {rear + 2.25, 1.42, half - 0.16},
                                      {rear + 2.95, 0.9, half},
                                      {front - 0.1, 0.78, half},
                                      {front, 0.6, half},
                                      {front, 0.28, half}}};
  const auto sideUv = [&](const Point& p) { return Eigen::Vector2d(p.x - rear, 1.5 - p.z); };
  for (const double side : {-1., 1.}) {
    const double shade = lit({0, side, 0});
    const auto corner = [&](std::size_t k) {
      const Point& p = outline[k];
      return Vertex{{p.x, side * p.half_width, p.z}, sideUv(p), shade};
    };
    for (const auto& quad : {std::array<std::size_t, 4>{0, 1, 7, 8}, {1, 2, 6, 7}}) {
      mesh.addQuad(corner(quad[0]), corner(quad[1]), corner(quad[2]), corner(quad[3]), texture);
    }
    mesh.addTriangle(corner(2), corner(5), corner(6), texture);
    mesh.addQuad(corner(2), corner(3), corner(4), corner(5), texture);
    for (const double axle : {rear + 0.8, front - 0.85}) {  // wheels
      const auto rim = [&](int k, double inset, const Eigen::Vector2d& uv) {
        const double angle = kPi * k / 8, x = 0.31 * std::cos(angle), z = 0.31 * std::sin(angle);
        return Vertex{{axle + x, side * (half + 0.02 - inset), 0.31 + z},
                      uv + Eigen::Vector2d(x, z),
                      inset > 0 ? 0.5 : shade};
      };
      const Eigen::Vector2d hub(4.7, 0.33);
      for (int k = 0; k < 16; ++k) {
        if (k > 0 && k < 15)
          mesh.addTriangle(rim(0, 0, hub), rim(k, 0, hub), rim(k + 1, 0, hub), texture);
        mesh.addQuad(rim(k, 0, hub), rim(k + 1, 0, hub), rim(k + 1, 0.2, hub), rim(k, 0.2, hub),
                     texture);
      }
    }
  }
  for (std::size_t k = 0; k + 1 < outline.size(); ++k) {  // rear, boot, window, roof, ... front
    const Point &a = outline[k], &b = outline[k + 1];
    const double shade = lit(Eigen::Vector3d(a.z - b.z, 0, b.x - a.x).normalized());
    const bool end = k == 0 || k == 7 || k == 6, glass = k == 2 || k == 4;
    const Eigen::Vector2d from(end ? 0 : (glass ? 3.25 : 2.05), glass ? 1.3 : 1.35);
    const double width = end ? kCarWidth : (glass ? 0.9 : 0.7);
    const double va = end ? 2.16 - a.z : from.y(), vb = end ? 2.16 - b.z : from.y() + 0.8;
    mesh.addQuad({{a.x, a.half_width, a.z}, {from.x(), va}, shade},
                 {{a.x, -a.half_width, a.z}, {from.x() + width, va}, shade},
                 {{b.x, -b.half_width, b.z}, {from.x() + width, vb}, shade},
                 {{b.x, b.half_width, b.z}, {from.x(), vb}, shade}, texture);
  }
  return mesh;
}

}  // namespace ground_scale_vo::synthetic
