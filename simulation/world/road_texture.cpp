#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "simulation/world/world_builder.hpp"

namespace gsv::simulation {
namespace {

// Patterns of the carriageway: factors on its albedo, 8-bit with kNeutral for a factor of 1, as
// large as the texture of the road.

constexpr double kNeutral = 128;  // the value that does not change the albedo

/// Column of the road texture at lateral offset u [m]; at a kerb the first one after its vertical
/// face.
int roadTextureColumn(double u) {
  const double right = u >= kRightKerb ? kKerbFace : 0, left = u >= kLeftKerb ? kKerbFace : 0;
  return static_cast<int>(std::lround((u - kTextureRight + right + left) / kRoadTexel));
}

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
      const Eigen::Vector2d at = builder_.road.textureUv(s, uniform(kRightKerb, kLeftKerb - 2.5));
      const double width = uniform(0.7, 2.4), length = uniform(1, 6), seam = 0.05;
      painter_.box(at.x() - seam, at.y() - seam, width + 2 * seam, length + 2 * seam, tone(-45));
      painter_.box(at.x(), at.y(), width, length, tone(uniform(-22, 14)));
    }
  }

  /// Random walks: half of them start along the road, the others in any direction.
  void paintCracks() {
    constexpr double kStep = 0.25;  // [m]
    for (double s = begin_; s < end_ - 10; s += uniform(1.5, 3)) {
      Eigen::Vector2d at = builder_.road.textureUv(s, anyOffset());
      double angle =
          builder_.random.chance(0.5) ? uniform(0, 2 * M_PI) : M_PI / 2 + uniform(-0.2, 0.2);
      const double width = uniform(0.02, 0.09), grey = tone(uniform(-60, -30));
      const double right = builder_.road.textureUv(s, kRightKerb + 0.1).x();
      const double left = builder_.road.textureUv(s, kLeftKerb - 0.1).x();
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
      painter_.ellipse(builder_.road.textureUv(s, anyOffset()), {r, r * elongation}, grey);
    }
  }

  void paintManholes() {
    for (double s = begin_ + uniform(0, 15); s < end_ - 2; s += uniform(9, 20)) {
      const Eigen::Vector2d at = builder_.road.textureUv(s, uniform(-1.2, 4.8));
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

/// Rows of stones across the road, each with its own grey level, with sand in the joints.
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

/// Composes the texture: albedo x pattern of the carriageway x light x grit.
class RoadTexturePainter {
 public:
  explicit RoadTexturePainter(WorldBuilder& builder)
      : builder_(builder),
        road_(builder.road),
        options_(builder.options),
        pattern_(builder.road_texels, CV_8U, cv::Scalar(kNeutral)),
        albedo_(builder.road_texels, CV_8U),
        grit_contrast_(kRoadColumns) {}

  void paint() {
    // Cobbles cover the asphalt; it is painted all the same, to draw the same random numbers.
    AsphaltPainter asphalt(pattern_, builder_);
    asphalt.paintPatches();
    asphalt.paintCracks();
    asphalt.paintSpots();
    asphalt.paintManholes();
    if (options_.cobbles) paintCobbles(pattern_, builder_);
    if (options_.puddles > 0) addPuddles();
    if (options_.grain > 0) addDetail();
    paintZones();
    TexturePainter painter(albedo_, kRoadTexel);
    if (options_.built_up) {
      for (double s = road_.sBegin(); s < road_.sEnd(); s += 1) paintPavement(painter, s);
    }
    if (options_.lane_markings) paintLines(painter);
    if (options_.arrow_spacing > 0) paintArrows(painter);
    if (options_.bump_height > 0) paintBumps(painter);
    const cv::Mat texture = compose();
    builder_.world.scene.road = &builder_.addTexture(texture, kRoadTexel, Texture::Wrap::kClamp);
  }

 private:
  /// Irregular pools of some metres with narrow shores; the pattern repeats after 41 m.
  void addPuddles() {
    constexpr double kShore = 0.12, kTexel = 0.08;  // [standard deviations of the noise, m]
    cv::Mat depth =
        tileableNoise({256, 512}, builder_.random.bits(), {{3, 0.35}, {8, 1}, {20, 0.8}});
    std::vector<float> sorted(depth.begin<float>(), depth.end<float>());
    const auto water_level =
        sorted.begin() + static_cast<std::ptrdiff_t>((1 - options_.puddles) *
                                                     static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), water_level, sorted.end());
    depth.convertTo(depth, CV_8U, 255 / kShore, -255 * *water_level / kShore);
    Scene& scene = builder_.world.scene;
    scene.puddles = &builder_.addTexture(depth, kTexel);
    scene.puddles_from = builder_.road.textureUv(0, kRightKerb).x();
    scene.puddles_to = builder_.road.textureUv(0, kLeftKerb).x() - kKerbFace;
  }

  /// Stones of some millimetres, below the resolution of the texture of the road.
  void addDetail() {
    const cv::Mat stones =
        tileableNoise({1024, 1024}, builder_.random.bits(), {{0.8, 1}, {1.8, 1}, {3.5, 0.8}});
    builder_.world.scene.road_detail =
        &builder_.addTexture(noiseToGrey(stones, kNeutral, kNeutral * options_.grain), 0.004);
  }

  /// Albedo and contrast of the grit in each zone of the cross-section.
  void paintZones() {
    const auto zone = [&](double from, double to, double albedo, double contrast) {
      const int a = roadTextureColumn(from), b = roadTextureColumn(to);
      albedo_.colRange(a, b) = albedo;
      std::fill(grit_contrast_.begin() + a, grit_contrast_.begin() + b,
                static_cast<float>(contrast));
    };
    const double texture = options_.road_texture;
    zone(kTextureRight, kTextureLeft, 85, 0.2);  // verges
    zone(kRightPavement, kRightKerb, 150, 0.07);
    zone(kLeftKerb, kLeftPavement, 150, 0.07);
    zone(kRightKerb - kKerbStoneWidth, kRightKerb, 170, 0.06);
    zone(kLeftKerb, kLeftKerb + kKerbStoneWidth, 170, 0.06);
    zone(kRightKerb, kLeftKerb, 118, 0.085 * texture);  // lanes
    zone(kRightKerb, kRightLine, 128, 0.11 * texture);  // parking bays
  }

  /// One metre of slabs and kerb stones.
  void paintPavement(TexturePainter& painter, double s) {
    for (const double from : {kRightPavement, kLeftKerb + kKerbStoneWidth}) {
      for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 2; ++j) {
          const Eigen::Vector2d at = builder_.road.textureUv(s + 0.5 * j, from + 0.45 * i);
          painter.box(at.x(), at.y(), 0.45, 0.5, 85);
          painter.box(at.x() + 0.015, at.y() + 0.02, 0.42, 0.46, builder_.uniform(128, 175));
        }
      }
    }
    for (const double u : {kRightKerb - kKerbStoneWidth, kLeftKerb}) {
      const Eigen::Vector2d at = builder_.road.textureUv(s, u);
      painter.box(at.x() - (u > 0 ? kKerbFace : 0), at.y(), kKerbStoneWidth + kKerbFace, 0.03, 90);
    }
  }

  void paintLines(TexturePainter& painter) {
    constexpr double kSpacing = 6, kWidth = 0.12;  // [m]
    const double dash = options_.solid_lines ? kSpacing : 3;
    for (double s = road_.sBegin(); s < road_.sEnd(); s += kSpacing) {
      const Eigen::Vector2d at = builder_.road.textureUv(s, kCentreLine - kWidth / 2);
      painter.box(at.x(), at.y(), kWidth, dash, 215);
      if (options_.solid_lines || !options_.built_up) continue;
      const Eigen::Vector2d bay = builder_.road.textureUv(s, kRightKerb);
      painter.box(bay.x(), bay.y(), kRightLine - kRightKerb, 0.1, 195);
    }
    for (const double u : {kRightLine, kLeftLine}) {
      const Eigen::Vector2d at = builder_.road.textureUv(road_.sBegin(), u - kWidth / 2);
      painter.box(at.x(), at.y(), kWidth, road_.sEnd() - road_.sBegin(), 205);
    }
  }

  /// Straight-on arrows in the middle of the lane: a shaft and a head.
  void paintArrows(TexturePainter& painter) {
    for (double s = road_.sBegin() + 4; s < road_.sEnd() - 6; s += options_.arrow_spacing) {
      const Eigen::Vector2d at = builder_.road.textureUv(s, 0);
      const auto corner = [&](double x, double y) {
        return Eigen::Vector2d(at + Eigen::Vector2d(x, y));
      };
      painter.box(at.x() - 0.08, at.y(), 0.16, 3.1, 215);
      painter.polygon({corner(-0.38, 3), corner(0.38, 3), corner(0, 4.9)}, 215);
    }
  }

  /// Darker asphalt, with white fields on the flank that faces the traffic.
  void paintBumps(TexturePainter& painter) {
    for (double s = kFirstBump; s < road_.sEnd() - kBumpLength; s += kBumpSpacing) {
      const Eigen::Vector2d at = builder_.road.textureUv(s, kRightKerb);
      painter.box(at.x(), at.y(), kLeftKerb - kRightKerb, kBumpLength, 88);
      for (double x = 0.3; x < kLeftKerb - kRightKerb - 0.5 && options_.lane_markings; x += 1) {
        const bool right = kRightKerb + x < kCentreLine;
        painter.box(at.x() + x, at.y() + (right ? 0.3 : kBumpLength - 1.2), 0.5, 0.9, 210);
      }
    }
  }

  /// The product of all layers. The grit repeats after 20 m. Between its ends, the bare the
  /// carriageway has neither pattern nor grit.
  cv::Mat compose() {
    const int bare_first = row(options_.bare.from_m), bare_end = row(options_.bare.to_m);
    const int road_first = roadTextureColumn(kRightKerb), road_end = roadTextureColumn(kLeftKerb);
    if (bare_first < bare_end) {
      pattern_(cv::Range(bare_first, bare_end), cv::Range(road_first, road_end)) = kNeutral;
    }
    std::vector<float> bare_contrast = grit_contrast_;
    std::fill(bare_contrast.begin() + road_first, bare_contrast.begin() + road_end, 0.f);

    const cv::Mat grit = tileableNoise({kRoadColumns, 1024}, builder_.random.bits(),
                                       {{0.7, 1.1}, {1.8, 0.8}, {5, 0.4}, {40, 0.5}});
    cv::Mat light = builder_.shadows.light();
    if (!options_.shadows) light.setTo(255);
    cv::Mat texture = albedo_;
    for (int y = 0; y < texture.rows; ++y) {
      const float* grit_row = grit.ptr<float>(y % grit.rows);
      const uchar *pattern_row = pattern_.ptr(y), *light_row = light.ptr(y);
      const bool is_bare = y >= bare_first && y < bare_end;
      const std::vector<float>& contrast = is_bare ? bare_contrast : grit_contrast_;
      uchar* out = texture.ptr(y);
      for (int x = 0; x < texture.cols; ++x) {
        // Pattern and light are 1 at kNeutral and 255.
        const float tone = static_cast<float>(pattern_row[x] * light_row[x]) /
                           (static_cast<float>(kNeutral) * 255.f);
        const float grit_factor = 1 + contrast[static_cast<std::size_t>(x)] * grit_row[x];
        out[x] = cv::saturate_cast<uchar>(static_cast<float>(out[x]) * tone * grit_factor);
      }
    }
    return texture;
  }

  /// Row of the texture; s may lie outside of it.
  int row(double s) const {
    const double at = (s - road_.sBegin()) / kRoadTexel;
    return static_cast<int>(std::lround(std::clamp(at, 0.0, static_cast<double>(pattern_.rows))));
  }

  WorldBuilder& builder_;
  const RoadGeometry& road_;
  const SyntheticDrive::Options& options_;
  cv::Mat pattern_;                   // of the carriageway: factor on the albedo, kNeutral = 1
  cv::Mat albedo_;                    // [grey levels]
  std::vector<float> grit_contrast_;  // standard deviation of each column, relative to the albedo
};

}  // namespace

void addRoadTexture(WorldBuilder& builder) { RoadTexturePainter(builder).paint(); }

}  // namespace gsv::simulation
