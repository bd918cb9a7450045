#include "simulation/world/asphalt.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/cross_section.hpp"

namespace ground_scale_vo::simulation {
namespace {

/// Draws damage and fixtures, one kind after the other. Lengths are in metres.
class AsphaltPainter {
 public:
  AsphaltPainter(cv::Mat pattern, WorldBuilder& builder)
      : painter_(std::move(pattern), kRoadTexel),
        builder_(builder),
        begin_(builder.road.sBegin()),
        end_(builder.road.sEnd()) {}

  void paintPatches() {
    for (double s = begin_ + 3; s < end_ - 12; s += uniform(7, 14)) {
      const Eigen::Vector2d at = builder_.roadUv(s, uniform(kRightKerb, kLeftKerb - 2.5));
      const double width = uniform(0.7, 2.4), length = uniform(1, 6), seam = 0.05;
      painter_.box(at.x() - seam, at.y() - seam, width + 2 * seam, length + 2 * seam, tone(-45));
      painter_.box(at.x(), at.y(), width, length, tone(uniform(-22, 14)));
    }
  }

  /// Random walks: half of them start along the road, the others in any direction.
  void paintCracks() {
    constexpr double kStep = 0.25;  // [m]
    for (double s = begin_; s < end_ - 10; s += uniform(1.5, 3)) {
      Eigen::Vector2d at = builder_.roadUv(s, anyOffset());
      double angle =
          builder_.random.chance(0.5) ? uniform(0, 2 * M_PI) : M_PI / 2 + uniform(-0.2, 0.2);
      const double width = uniform(0.02, 0.09), grey = tone(uniform(-60, -30));
      const double right = builder_.roadUv(s, kRightKerb + 0.1).x();
      const double left = builder_.roadUv(s, kLeftKerb - 0.1).x();
      for (double remaining = uniform(1, 7); remaining > 0; remaining -= kStep) {
        angle += uniform(-0.35, 0.35);
        const Eigen::Vector2d next = at + kStep * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        if (next.x() < right || next.x() > left) break;
        painter_.line(at, next + 0.1 * (next - at), width, grey);
        at = next;
      }
    }
  }

  void paintSpots() {
    for (double s = begin_; s < end_; s += uniform(0.1, 0.35)) {
      const double r = uniform(0.02, 0.12), grey = tone(uniform(-35, 28));
      const double elongation = uniform(0.6, 2.5);
      painter_.ellipse(builder_.roadUv(s, anyOffset()), {r, r * elongation}, grey);
    }
  }

  void paintManholes() {
    for (double s = begin_ + uniform(0, 15); s < end_ - 2; s += uniform(9, 20)) {
      const Eigen::Vector2d at = builder_.roadUv(s, uniform(-1.2, 4.8));
      painter_.ellipse(at, {0.42, 0.42}, tone(30));
      painter_.ellipse(at, {0.34, 0.34}, tone(-50));
      painter_.ellipse(at, {0.30, 0.30}, tone(-15));
      for (int i = -1; i <= 1; ++i) {
        for (int j = -1; j <= 1; ++j) {
          painter_.ellipse(at + 0.14 * Eigen::Vector2d(i, j), {0.045, 0.045}, tone(-60));
        }
      }
    }
  }

 private:
  double uniform(double from, double to) { return builder_.uniform(from, to); }
  double anyOffset() { return uniform(kRightKerb + 0.3, kLeftKerb - 0.3); }
  /// Pattern value for a contrast to the surrounding asphalt [%], scaled by options.road_texture.
  double tone(double percent) const {
    return std::clamp(kNeutral * (1 + builder_.options.road_texture * percent / 100), 0.0, 255.0);
  }

  TexturePainter painter_;
  WorldBuilder& builder_;
  const double begin_, end_;  // s [m]
};

}  // namespace

void paintAsphalt(cv::Mat pattern, WorldBuilder& builder) {
  AsphaltPainter asphalt(std::move(pattern), builder);
  asphalt.paintPatches();
  asphalt.paintCracks();
  asphalt.paintSpots();
  asphalt.paintManholes();
}

void paintCobbles(cv::Mat pattern, WorldBuilder& builder) {
  constexpr int kAcross = 9, kAlong = 7;  // a stone with its joint [texels]
  const int first = roadTextureColumn(kRightKerb), end = roadTextureColumn(kLeftKerb);
  pattern.colRange(first, end) = kNeutral;
  std::vector<double> contrasts(static_cast<std::size_t>((end - first) / kAcross + 2));  // [%]
  int shift = 0;
  for (int y = 0; y < pattern.rows; ++y) {
    if (y % kAlong == 0) {
      for (double& contrast : contrasts) contrast = builder.uniform(-22, 20);
      shift = static_cast<int>(builder.uniform(0, kAcross));
    }
    uchar* out = pattern.ptr(y);
    for (int x = first; x < end; ++x) {
      const int at = x - first + shift, in_row = y % kAlong, in_stone = at % kAcross;
      const bool joint = in_row == 0 || in_stone == 0;
      const bool rounded_edge = in_row == 1 || in_row == kAlong - 1 || in_stone == 1;
      const double stone = contrasts[static_cast<std::size_t>(at / kAcross)];
      const double percent = joint ? -45 : stone - (rounded_edge ? 9 : 0);
      out[x] = cv::saturate_cast<uchar>(out[x] * (1 + percent / 100));
    }
  }
}

}  // namespace ground_scale_vo::simulation
