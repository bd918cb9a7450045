#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/asphalt.hpp"
#include "simulation/world/cross_section.hpp"
#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {
namespace {

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
    paintAsphalt(pattern_, builder_);
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
    if (options_.bumps) paintBumps(painter);
    const cv::Mat texture = compose();
    builder_.assets.scene.road = &builder_.addTexture(texture, kRoadTexel, Texture::Wrap::kClamp);
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
    Scene& scene = builder_.assets.scene;
    scene.puddles = &builder_.addTexture(depth, kTexel);
    scene.puddles_from = builder_.roadUv(0, kRightKerb).x();
    scene.puddles_to = builder_.roadUv(0, kLeftKerb).x() - kKerbFace;
  }

  /// Stones of some millimetres, below the resolution of the texture of the road.
  void addDetail() {
    const cv::Mat stones =
        tileableNoise({1024, 1024}, builder_.random.bits(), {{0.8, 1}, {1.8, 1}, {3.5, 0.8}});
    builder_.assets.scene.road_detail =
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
          const Eigen::Vector2d at = builder_.roadUv(s + 0.5 * j, from + 0.45 * i);
          painter.box(at.x(), at.y(), 0.45, 0.5, 85);
          painter.box(at.x() + 0.015, at.y() + 0.02, 0.42, 0.46, builder_.uniform(128, 175));
        }
      }
    }
    for (const double u : {kRightKerb - kKerbStoneWidth, kLeftKerb}) {
      const Eigen::Vector2d at = builder_.roadUv(s, u);
      painter.box(at.x() - (u > 0 ? kKerbFace : 0), at.y(), kKerbStoneWidth + kKerbFace, 0.03, 90);
    }
  }

  void paintLines(TexturePainter& painter) {
    constexpr double kSpacing = 6, kWidth = 0.12;  // [m]
    const double dash = options_.solid_lines ? kSpacing : 3;
    for (double s = road_.sBegin(); s < road_.sEnd(); s += kSpacing) {
      const Eigen::Vector2d at = builder_.roadUv(s, kCentreLine - kWidth / 2);
      painter.box(at.x(), at.y(), kWidth, dash, 215);
      if (options_.solid_lines || !options_.built_up) continue;
      const Eigen::Vector2d bay = builder_.roadUv(s, kRightKerb);
      painter.box(bay.x(), bay.y(), kRightLine - kRightKerb, 0.1, 195);
    }
    for (const double u : {kRightLine, kLeftLine}) {
      const Eigen::Vector2d at = builder_.roadUv(road_.sBegin(), u - kWidth / 2);
      painter.box(at.x(), at.y(), kWidth, road_.sEnd() - road_.sBegin(), 205);
    }
  }

  /// Straight-on arrows in the middle of the lane: a shaft and a head.
  void paintArrows(TexturePainter& painter) {
    for (double s = road_.sBegin() + 4; s < road_.sEnd() - 6; s += options_.arrow_spacing) {
      const Eigen::Vector2d at = builder_.roadUv(s, 0);
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
      const Eigen::Vector2d at = builder_.roadUv(s, kRightKerb);
      painter.box(at.x(), at.y(), kLeftKerb - kRightKerb, kBumpLength, 88);
      for (double x = 0.3; x < kLeftKerb - kRightKerb - 0.5 && options_.lane_markings; x += 1) {
        const bool right = kRightKerb + x < kCentreLine;
        painter.box(at.x() + x, at.y() + (right ? 0.3 : kBumpLength - 1.2), 0.5, 0.9, 210);
      }
    }
  }

  /// The product of all layers. The grit repeats after 20 m. Between bare_from_m and bare_to_m the
  /// carriageway has neither pattern nor grit.
  cv::Mat compose() {
    const int bare_first = row(options_.bare_from_m), bare_end = row(options_.bare_to_m);
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
  const WorldOptions& options_;
  cv::Mat pattern_;                   // of the carriageway: factor on the albedo, kNeutral = 1
  cv::Mat albedo_;                    // [grey levels]
  std::vector<float> grit_contrast_;  // standard deviation of each column, relative to the albedo
};

}  // namespace

void addRoadTexture(WorldBuilder& builder) { RoadTexturePainter(builder).paint(); }

}  // namespace ground_scale_vo::simulation
