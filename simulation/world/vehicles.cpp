#include "simulation/world/vehicles.hpp"

#include <array>
#include <cmath>

#include "simulation/renderer/texture.hpp"

namespace gsv::simulation {

namespace {

constexpr double kWheelRadius = 0.31, kWheelWidth = 0.2;  // [m]
constexpr double kTyreLight = 0.5;                        // relative irradiance of the tread

// Texture coordinates of the wheel hubs [m].
const Eigen::Vector2d kCarHubUv(4.7, 0.33), kVanHubUv(8, 3);

/// outer_centre: centre of the outer face of the wheel; hub_uv: its texture coordinates.
void addWheel(Mesh& mesh, const Eigen::Vector3d& outer_centre, const Eigen::Vector2d& hub_uv,
              double light, const Texture& texture) {
  const auto rim = [&](int k, double inset) {
    const double angle = M_PI * k / 8;
    const double x = kWheelRadius * std::cos(angle), z = kWheelRadius * std::sin(angle);
    const double in = outer_centre.y() > 0 ? -inset : inset;
    return Vertex{outer_centre + Eigen::Vector3d(x, in, z), hub_uv + Eigen::Vector2d(x, z),
                  inset > 0 ? kTyreLight : light};
  };
  for (int k = 0; k < 16; ++k) {
    if (k > 0 && k < 15) mesh.addTriangle(rim(0, 0), rim(k, 0), rim(k + 1, 0), texture);
    mesh.addQuad(rim(k, 0), rim(k + 1, 0), rim(k + 1, kWheelWidth), rim(k, kWheelWidth), texture);
  }
}

void paintWheel(TexturePainter& painter, const Eigen::Vector2d& hub_uv) {
  painter.ellipse(hub_uv, {0.4, 0.4}, 22);
  painter.ellipse(hub_uv, {0.2, 0.2}, 150);
  for (const double spoke : {0.3, 1.6, 2.8, 4.1, 5.3}) {
    painter.ellipse({hub_uv.x() + 0.12 * std::cos(spoke), hub_uv.y() + 0.12 * std::sin(spoke)},
                    {0.04, 0.04}, 40);
  }
}

}  // namespace

cv::Mat carTextureImage(double body, std::uint64_t seed) {
  cv::Mat image = noiseToGrey(tileableNoise({512, 256}, seed, {{20, 1}}), body, 4);
  TexturePainter painter(image, kVehicleTexel);
  const double dark = body * 0.55, glass = 38;
  painter.box(0, 0.95, 4.3, 0.3, body * 0.8);  // sill
  painter.box(0, 1.13, 4.3, 0.1, dark * 0.6);
  for (const double seam : {1.15, 2.05, 3.05}) painter.box(seam, 0.1, 0.025, 0.98, dark);
  for (const double handle : {1.35, 2.25}) painter.box(handle, 0.72, 0.16, 0.035, 255 - body);
  painter.polygon({{0.62, 0.56}, {0.86, 0.14}, {1.42, 0.14}, {1.42, 0.56}}, glass);
  painter.polygon({{1.52, 0.56}, {1.52, 0.14}, {2.2, 0.14}, {2.72, 0.56}}, glass + 15);
  painter.box(0, 0.68, 0.16, 0.14, 70);      // rear light
  painter.box(3.96, 0.72, 0.24, 0.12, 235);  // headlamp
  // Rear, also used for the front: lights, number plate, seam, bumper.
  painter.box(0.1, 1.45, 0.32, 0.17, 80);
  painter.box(1.28, 1.45, 0.32, 0.17, 80);
  painter.box(0.58, 1.5, 0.54, 0.12, 240);
  painter.box(0.66, 1.53, 0.38, 0.06, 60);
  painter.box(0, 1.68, 1.7, 0.02, dark);
  painter.box(0, 1.72, 1.7, 0.16, body * 0.75);
  painter.box(3.2, 1.25, 1.1, 1.1, glass);
  painter.polygon({{3.3, 2.2}, {3.9, 1.3}, {4.1, 1.3}, {3.5, 2.2}}, glass + 14);
  paintWheel(painter, kCarHubUv);
  return image;
}

Mesh carMesh(const Texture& texture, const Eigen::Vector3d& sun) {
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
    const double light = diffuseLight({0, side, 0}, sun);
    const auto corner = [&](std::size_t k) {
      const Point& p = outline[k];
      return Vertex{{p.x, side * p.half_width, p.z}, sideUv(p), light};
    };
    for (const auto& quad : {std::array<std::size_t, 4>{0, 1, 7, 8}, {1, 2, 6, 7}}) {
      mesh.addQuad(corner(quad[0]), corner(quad[1]), corner(quad[2]), corner(quad[3]), texture);
    }
    mesh.addTriangle(corner(2), corner(5), corner(6), texture);
    mesh.addQuad(corner(2), corner(3), corner(4), corner(5), texture);
    for (const double axle : {rear + 0.8, front - 0.85}) {
      addWheel(mesh, {axle, side * (half + 0.02), kWheelRadius}, kCarHubUv, light, texture);
    }
  }
  // Extrude the side outline across the width. Windows and paint use a fixed patch of the texture.
  const Eigen::Vector2d glass_uv(3.25, 1.3), paint_uv(2.05, 1.35);  // upper left corners [m]
  constexpr double kGlassPatchWidth = 0.9, kPaintPatchWidth = 0.7, kPatchHeight = 0.8;  // [m]
  constexpr double kRearGroundV = 2.16;  // v of the road (z = 0) below the rear's texture [m]
  for (std::size_t k = 0; k + 1 < outline.size(); ++k) {
    const Point &a = outline[k], &b = outline[k + 1];
    const double light = diffuseLight(Eigen::Vector3d(a.z - b.z, 0, b.x - a.x).normalized(), sun);
    const bool is_rear_or_front = k == 0 || k == 7 || k == 6, is_glass = k == 2 || k == 4;
    const Eigen::Vector2d& patch = is_glass ? glass_uv : paint_uv;
    const double ua = is_rear_or_front ? 0 : patch.x();
    const double width =
        is_rear_or_front ? kCarWidth : (is_glass ? kGlassPatchWidth : kPaintPatchWidth);
    const double va = is_rear_or_front ? kRearGroundV - a.z : patch.y();
    const double vb = is_rear_or_front ? kRearGroundV - b.z : patch.y() + kPatchHeight;
    mesh.addQuad({{a.x, a.half_width, a.z}, {ua, va}, light},
                 {{a.x, -a.half_width, a.z}, {ua + width, va}, light},
                 {{b.x, -b.half_width, b.z}, {ua + width, vb}, light},
                 {{b.x, b.half_width, b.z}, {ua, vb}, light}, texture);
  }
  return mesh;
}

cv::Mat vanTextureImage(double body, std::uint64_t seed) {
  cv::Mat image = noiseToGrey(tileableNoise({1024, 512}, seed, {{3, 0.5}, {25, 1}}), body, 3.5);
  TexturePainter painter(image, kVehicleTexel);
  const double dark = body * 0.5, glass = 40;
  painter.box(0, 1.9, 5.6, 0.3, body * 0.75);  // side: sill, rubbing strip, doors, window
  painter.box(0, 1.35, 5.6, 0.1, dark);
  for (const double seam : {0.05, 2.2, 3.7, 4.6}) painter.box(seam, 0.1, 0.03, 2.0, dark);
  painter.polygon({{3.8, 0.35}, {4.5, 0.35}, {4.8, 1.0}, {3.8, 1.0}}, glass);
  painter.box(0.7, 0.5, 2.1, 0.45, body * 0.6);  // lettering
  for (int k = 0; k < 7; ++k) painter.box(0.8 + 0.28 * k, 0.58, 0.17, 0.28, 250);
  const double x = 6;  // rear: two doors with windows, hinges, lights, number plate, bumper
  painter.box(x + 1.04, 0.1, 0.03, 1.95, dark);
  for (const double window : {0.16, 1.14}) {
    painter.box(x + window, 0.3, 0.8, 0.62, dark);
    painter.box(x + window + 0.04, 0.34, 0.72, 0.54, glass);
    painter.polygon({{x + window + 0.1, 0.84},
                     {x + window + 0.35, 0.38},
                     {x + window + 0.5, 0.38},
                     {x + window + 0.25, 0.84}},
                    glass + 25);
  }
  for (const double lamp : {0.02, 1.9}) {
    painter.box(x + lamp, 0.95, 0.18, 0.65, 95);
    painter.box(x + lamp, 1.15, 0.18, 0.2, 200);
  }
  for (const double hinge : {0.25, 1.1, 1.8}) {
    painter.box(x, hinge, 0.14, 0.06, dark);
    painter.box(x + 1.96, hinge, 0.14, 0.06, dark);
  }
  painter.box(x + 1.12, 1.2, 0.16, 0.05, 30);
  painter.box(x + 0.3, 1.25, 0.52, 0.12, 240);
  painter.box(x + 0.36, 1.28, 0.4, 0.06, 60);
  painter.box(x, 1.92, 2.1, 0.28, 55);
  painter.box(3, 3, 2.2, 1.4, glass);
  painter.polygon({{3.2, 4.2}, {4.2, 3.1}, {4.5, 3.1}, {3.5, 4.2}}, glass + 16);
  paintWheel(painter, kVanHubUv);
  return image;
}

Mesh vanMesh(const Texture& texture, const Eigen::Vector3d& sun) {
  Mesh mesh;
  const double half = kVanWidth / 2, rear = -kVanLength / 2, front = kVanLength / 2;
  const double low = 0.35, high = kVanHeight, windscreen_top_x = front - 1.4, bonnet_z = 1.15;
  for (const double side : {-1., 1.}) {
    const double y = side * half, light = diffuseLight({0, side, 0}, sun);
    const auto corner = [&](double x, double z) {
      return Vertex{{x, y, z}, {x - rear, high - z}, light};
    };
    mesh.addQuad(corner(rear, low), corner(rear, high), corner(windscreen_top_x, high),
                 corner(windscreen_top_x, low), texture);
    mesh.addQuad(corner(windscreen_top_x, low), corner(windscreen_top_x, high),
                 corner(front, bonnet_z), corner(front, low), texture);
    for (const double axle : {rear + 1.1, front - 0.95}) {
      addWheel(mesh, {axle, side * (half + 0.02), kWheelRadius}, kVanHubUv, light, texture);
    }
  }
  const auto addPanelAcrossWidth = [&](double xa, double za, double xb, double zb,
                                       const Eigen::Vector2d& uv, const Eigen::Vector3d& normal) {
    const double light = diffuseLight(normal.normalized(), sun),
                 length = std::hypot(xb - xa, zb - za);
    mesh.addQuad({{xa, half, za}, uv, light},
                 {{xa, -half, za}, {uv.x() + kVanWidth, uv.y()}, light},
                 {{xb, -half, zb}, {uv.x() + kVanWidth, uv.y() + length}, light},
                 {{xb, half, zb}, {uv.x(), uv.y() + length}, light}, texture);
  };
  addPanelAcrossWidth(rear, high, rear, low, {6, 0}, {-1, 0, 0});
  addPanelAcrossWidth(rear, high, windscreen_top_x, high, {0, 3}, {0, 0, 1});
  addPanelAcrossWidth(windscreen_top_x, high, front, bonnet_z, {3, 3}, {1.35, 0, 1.4});
  addPanelAcrossWidth(front, bonnet_z, front, low, {0, 3}, {1, 0, 0});
  return mesh;
}

cv::Mat hoodTextureImage(std::uint64_t seed) {
  // seed + 99: noise that differs from that of the other textures.
  cv::Mat image = noiseToGrey(tileableNoise({256, 256}, seed + 99, {{30, 1}}), 48, 4);
  TexturePainter painter(image, kVehicleTexel);
  for (const double x : {0.55, 1.95}) {  // creases
    painter.line({x, 0}, {x + 0.2 * (x - 1.25), 2.56}, 0.03, 120);
    painter.line({x + 0.03, 0}, {x + 0.03 + 0.2 * (x - 1.25), 2.56}, 0.03, 28);
  }
  for (const double x : {0.85, 1.65})
    painter.ellipse({x, 1.6}, {0.05, 0.03}, 25);  // washer nozzles
  return image;
}

Mesh hoodMesh(const Texture& texture, const PinholeCamera& camera, double image_height_fraction) {
  constexpr int kStrips = 16;
  constexpr double kFarEdgeDepth = 1.8, kNearEdgeDepth = 0.8;  // [m]
  Mesh mesh;
  const auto vertex = [&](int k, bool far) {
    const double a = 2.0 * k / kStrips - 1, edge = image_height_fraction * (1 - 0.4 * a * a);
    const double u = (0.5 + 0.6 * a) * camera.width;
    const double v = far ? (1 - edge) * camera.height : 1.6 * camera.height;
    const double z = far ? kFarEdgeDepth : kNearEdgeDepth;
    return Vertex{z * camera.ray({u, v}), {1.28 + 1.2 * a, far ? 0 : 2.5}, 1 - 0.25 * a * a};
  };
  for (int k = 0; k < kStrips; ++k) {
    mesh.addQuad(vertex(k, true), vertex(k + 1, true), vertex(k + 1, false), vertex(k, false),
                 texture);
  }
  mesh.updateBoundingSphere();
  return mesh;
}

}  // namespace gsv::simulation
