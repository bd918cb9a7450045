#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "simulation/world/world_builder.hpp"

namespace gsv::simulation {
namespace {

constexpr double kFacadeTexel = 0.025;  // [m]
constexpr double kFoundation = 0.5;     // of a house below its ground [m]

/// World from mesh m of a building beside the road: x along the road, its front (y = 0) faces the
/// road. The origin is at (s, u), `height` above the carriageway [m].
Eigen::Isometry3d besideRoad(const RoadGeometry& road, double s, double u, double height) {
  Eigen::Isometry3d T_w_m = Eigen::Isometry3d::Identity();
  T_w_m.translation() = road.surfacePoint(s, u, height);
  T_w_m.rotate(Eigen::AngleAxisd(road.heading(s) + (u > 0 ? 0 : M_PI), Eigen::Vector3d::UnitZ()));
  return T_w_m;
}

/// Coordinates (s, u) as in RoadGeometry: s along the lane, u to its left [m].
/// Mesh axes m of a building: x along its front, y = 0 at the front and positive inwards, z up.
class BuildingGenerator {
 public:
  explicit BuildingGenerator(WorldBuilder& builder);
  void addHouses();
  /// A house across road and pavements at options.wall_at_m.
  void addWallAcrossRoad();

 private:
  void addHedge(double s, double u, double length);
  Mesh houseMesh(double length, double depth, double height, double roof_height,
                 const Eigen::Matrix3d& R_w_m, const Texture& front, const Texture& sides) const;
  cv::Mat facadeImage(double length, double height, int floors, double wall_grey);
  bool isClearOfRoad(double s, const Eigen::Isometry3d& T_w_m, double length, double depth) const;

  WorldBuilder& builder_;
  cv::Mat plaster_;  ///< noise texture of the plaster
};

BuildingGenerator::BuildingGenerator(WorldBuilder& builder)
    : builder_(builder),
      plaster_(tileableNoise({256, 256}, builder.random.bits(), {{1, 0.7}, {6, 1}, {30, 1}})) {}

void BuildingGenerator::addHouses() {
  const RoadGeometry& road = builder_.road;
  Random& random = builder_.random;
  const Texture& plaster = builder_.addTexture(noiseToGrey(plaster_, 165, 5), kFacadeTexel);
  for (const double side : {-1., 1.}) {
    for (double s = road.sBegin() - 5; s < road.sEnd() + 25;) {
      const double length = random.uniform(8, 14), gap = random.uniform(1.5, 5);
      const double u = side > 0 ? random.uniform(11.5, 14.5) : -random.uniform(10.5, 13.5);
      const int floors = random.chance(0.3) ? 3 : 2;
      const double height = 3.0 * floors, depth = random.uniform(8, 11);
      const double wall_grey = side > 0 ? random.uniform(130, 245) : random.uniform(130, 225);
      // A house beyond the road's end continues the street on the left and moves back on the right,
      // 150 m ahead of the last camera.
      const double middle = std::min(s + length / 2, road.sEnd());
      Eigen::Isometry3d T_w_m = besideRoad(road, middle, u, builder_.options.kerb_height);
      T_w_m.translate(Eigen::Vector3d(-length / 2 + s + length / 2 - middle, 0, -kFoundation));
      const Texture& front =
          builder_.addTexture(facadeImage(length, height + kFoundation, floors, wall_grey),
                              kFacadeTexel, Texture::Wrap::kClamp);
      Mesh mesh = houseMesh(length, depth, height + kFoundation, random.uniform(2, 3.5),
                            T_w_m.linear(), front, plaster);
      const bool is_free = builder_.isClearOfBridgeAndUnderpass(s) &&
                           builder_.isClearOfBridgeAndUnderpass(s + length);
      const bool is_clear = isClearOfRoad(middle, T_w_m, length, depth);
      if (is_free && is_clear) {
        builder_.place(builder_.addMesh(std::move(mesh)), T_w_m, middle);
      }
      // On a generated road also of a house that is left out in a tight curve.
      if (is_free && (is_clear || !road.isRecorded()) && side * builder_.options.sun.y() > 0) {
        builder_.shadows.castPrism(middle, u, {{length / 2, 0}, {-length / 2, 0}}, height, 1);
      }
      if (is_free) {
        const double hedge_length = length * random.uniform(0.4, 1);
        addHedge(middle, side > 0 ? random.uniform(9.6, 10.4) : -random.uniform(8.6, 9.4),
                 hedge_length);
      }
      s += length + gap;
    }
  }
}

/// A hedge or a low stone wall.
void BuildingGenerator::addHedge(double s, double u, double length) {
  Eigen::Isometry3d T_w_m = besideRoad(builder_.road, s, u, builder_.options.kerb_height - 0.1);
  T_w_m.translate(Eigen::Vector3d(-length / 2, 0, 0));
  const Texture& texture = builder_.random.chance(0.65) ? *builder_.leaves : *builder_.stone;
  const double height = builder_.uniform(0.8, 1.5), depth = 0.4;
  Mesh mesh = houseMesh(length, depth, height, 0, T_w_m.linear(), texture, texture);
  mesh.addQuad({{0, 0, height}, {0, 0}, 0.95}, {{length, 0, height}, {length, 0}, 0.95},
               {{length, depth, height}, {length, depth}, 0.95},
               {{0, depth, height}, {0, depth}, 0.95}, texture);
  if (isClearOfRoad(s, T_w_m, length, depth)) {
    builder_.place(builder_.addMesh(std::move(mesh)), T_w_m, s);
  }
}

void BuildingGenerator::addWallAcrossRoad() {
  constexpr double kLength = 26, kDepth = 6, kHeight = 6.5, kRoofHeight = 2.5, kWallGrey = 150;
  const Texture& front = builder_.addTexture(facadeImage(kLength, kHeight, 2, kWallGrey),
                                             kFacadeTexel, Texture::Wrap::kClamp);
  Eigen::Isometry3d T_w_m = builder_.road.surfaceFrame(builder_.options.wall_at_m, kLength / 2);
  T_w_m.rotate(Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitZ()));
  builder_.place(builder_.addMesh(houseMesh(kLength, kDepth, kHeight, kRoofHeight, T_w_m.linear(),
                                            front, front)),
                 T_w_m);
}

/// The box [0, length] x [0, depth] x [0, height]: front (y = 0), both ends, and a gable roof with
/// its ridge along x, in mesh axes m. roof_height: of the ridge above the walls [m]; 0: no roof.
Mesh BuildingGenerator::houseMesh(double length, double depth, double height, double roof_height,
                                  const Eigen::Matrix3d& R_w_m, const Texture& front,
                                  const Texture& sides) const {
  Mesh mesh;
  const auto lightOn = [&](const Eigen::Vector3d& n) {
    return diffuseLight(R_w_m * n.normalized(), builder_.options.sun);
  };
  const auto addWall = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                           const Texture& texture, const Eigen::Vector3d& n) {
    const double l = (b - a).norm();
    const Eigen::Vector3d up(0, 0, height);
    const double light = lightOn(n), foot = 0.85 * light;  // half of the sky is hidden at the foot
    mesh.addQuad({a, {0, height}, foot}, {b, {l, height}, foot}, {b + up, {l, 0}, light},
                 {a + up, {0, 0}, light}, texture);
  };
  const Eigen::Vector3d a(0, 0, 0), b(length, 0, 0), c(length, depth, 0), d(0, depth, 0);
  addWall(a, b, front, {0, -1, 0});
  addWall(b, c, sides, {1, 0, 0});
  addWall(d, a, sides, {-1, 0, 0});
  if (roof_height <= 0) return mesh;

  const Eigen::Vector3d eaves(0, 0, height), ridge(0, depth / 2, height + roof_height);
  for (const double x : {0., length}) {  // gables
    const double light = lightOn({x > 0 ? 1. : -1., 0, 0});
    const Eigen::Vector3d along(x, 0, 0);
    mesh.addTriangle({along + eaves, {0, 3}, light}, {along + eaves + d, {depth, 3}, light},
                     {along + ridge, {depth / 2, 3 - roof_height}, light}, sides);
  }
  // The roof overhangs by 0.3 m at the ends and by 0.4 m at the eaves.
  const Eigen::Vector3d out(0.3, 0, 0), over(0, 0.4, 0.8 * roof_height / depth);
  const double slope = std::hypot(depth / 2, roof_height);
  for (const double side : {0., 1.}) {
    const double light = lightOn({0, side > 0 ? roof_height : -roof_height, depth / 2});
    const Eigen::Vector3d low =
        side > 0 ? Eigen::Vector3d(eaves + d + Eigen::Vector3d(0, 0.4, -over.z()))
                 : Eigen::Vector3d(eaves - over);
    mesh.addQuad({low - out, {0, slope}, light}, {low + b + out, {length, slope}, light},
                 {ridge + b + out, {length, 0}, light}, {ridge - out, {0, 0}, light},
                 *builder_.roof_tiles);
  }
  return mesh;
}

/// Plaster with rows of windows, a door, a plinth and a down pipe. wall_grey: grey level of the
/// plaster.
cv::Mat BuildingGenerator::facadeImage(double length, double height, int floors, double wall_grey) {
  Random& random = builder_.random;
  const int columns = static_cast<int>(length / kFacadeTexel / 16 + 1) * 16;
  const int rows = static_cast<int>(height / kFacadeTexel / 16 + 1) * 16;
  cv::Mat image;
  cv::repeat(noiseToGrey(plaster_, wall_grey, 3.5), rows / 256 + 1, columns / 256 + 1, image);
  image = image(cv::Rect(0, 0, columns, rows)).clone();
  TexturePainter painter(image, kFacadeTexel);
  painter.box(0, height - 0.6, length, 0.6, wall_grey * 0.6);               // plinth
  painter.box(random.uniform(0.2, 0.5), 0, 0.1, height, wall_grey * 0.55);  // down pipe
  const double pitch = length / std::floor(length / random.uniform(2.2, 3.2));
  const double storey = height / floors;
  const double w = random.uniform(0.9, 1.3), h = random.uniform(1.2, 1.5);  // of a window
  const double frame = random.chance(0.5) ? 245 : 70;
  const int door = static_cast<int>(random.uniform(0, length / pitch));
  for (int floor = 0; floor < floors; ++floor) {
    if (floor > 0) painter.box(0, floor * storey - 0.08, length, 0.1, wall_grey * 0.85);
    for (int k = 0; (k + 0.5) * pitch < length; ++k) {
      const double u = (k + 0.5) * pitch - w / 2, v = floor * storey + 0.65;
      if (floor == floors - 1 && k == door) {
        painter.box(u - 0.1, height - 2.3, w + 0.2, 2.3, frame);
        painter.box(u, height - 2.2, w, 2.2, random.uniform(40, 110));
        painter.box(u + 0.2, height - 2.0, w - 0.4, 0.6, 40);
        continue;
      }
      painter.box(u - 0.12, v - 0.12, w + 0.24, h + 0.24, 0.78 * wall_grey);
      painter.box(u - 0.04, v - 0.04, w + 0.08, h + 0.08, frame);
      painter.box(u + 0.05, v + 0.05, w - 0.1, h - 0.1, random.uniform(28, 60));
      if (random.chance(0.5)) {  // curtains or a blind
        const double grey = random.uniform(110, 190), drop = random.uniform(0.2, h - 0.2);
        painter.box(u + 0.05, v + 0.05, w - 0.1, drop, grey);
      }
      painter.box(u + w / 2 - 0.03, v, 0.06, h, frame);
      painter.box(u - 0.15, v + h + 0.08, w + 0.3, 0.07, 0.5 * wall_grey);
    }
  }
  return image;
}

/// False where a long box at s, inside a tight curve or beside a crossing, would reach the road
/// again.
bool BuildingGenerator::isClearOfRoad(double s, const Eigen::Isometry3d& T_w_m, double length,
                                      double depth) const {
  constexpr double kTightCurvature = 0.035, kClearance = 8.5;  // [1/m, m]
  const bool is_recorded = builder_.road.isRecorded();
  if (!is_recorded && builder_.options.curvature <= kTightCurvature) return true;
  for (const double x : {0., 0.25, 0.5, 0.75, 1.}) {
    for (const double y : {0., 1.}) {
      const Eigen::Vector3d p = T_w_m * Eigen::Vector3d(x * length, y * depth, 0);
      if (builder_.road.distanceToLane(s, p) < kClearance) return false;
    }
  }
  return true;
}

/// A surface along the road between two points a and b of the cross-section (u, z).
void placeStrip(WorldBuilder& builder, double s_begin, double s_end, const Eigen::Vector2d& a,
                const Eigen::Vector2d& b, double light) {
  constexpr double kStep = 2;  // [m]
  const RoadGeometry& road = builder.road;
  Mesh mesh;
  const double width = (b - a).norm();
  const auto vertex = [&](double s, const Eigen::Vector2d& uz, double across) {
    return Vertex{road.surfacePoint(s, uz.x(), uz.y()), {across, s - road.sBegin()}, light};
  };
  for (double s = s_begin; s < s_end; s += kStep) {
    const double next = std::min(s + kStep, s_end);
    mesh.addQuad(vertex(s, a, 0), vertex(s, b, width), vertex(next, b, width), vertex(next, a, 0),
                 *builder.stone);
  }
  builder.place(builder.addMesh(std::move(mesh)), Eigen::Isometry3d::Identity());
}

}  // namespace

void addBuildings(WorldBuilder& builder) {
  BuildingGenerator buildings(builder);
  buildings.addHouses();
  if (builder.options.wall_at_m > 0) buildings.addWallAcrossRoad();
}

/// Parapets. The mesh of the road leaves out the verges of a bridge.
void addBridge(WorldBuilder& builder) {
  const double kerb = builder.options.kerb_height, top = kerb + 1.0;  // [m]
  constexpr double kThickness = 0.25, kBottom = -2;                   // [m]
  const double begin = builder.options.bridge.from_m, end = builder.options.bridge.to_m;
  for (const auto& [u, out] :
       {std::pair(kRightPavement, -kThickness), {kLeftPavement, kThickness}}) {
    placeStrip(builder, begin, end, {u, kerb}, {u, top}, 0.7);
    placeStrip(builder, begin, end, {u, top}, {u + out, top}, 1);
    placeStrip(builder, begin, end, {u + out, top}, {u + out, kBottom}, 0.6);
  }
}

/// Walls, a ceiling and both portals. The road below is dark.
void addUnderpass(WorldBuilder& builder) {
  constexpr double kClearance = 4.6, kThickness = 1.2, kPortalWidth = 8;  // [m]
  constexpr double kLight = 0.2;
  const double begin = builder.options.underpass.from_m, end = builder.options.underpass.to_m;
  const double kerb = builder.options.kerb_height;
  const double right = kRightPavement - 0.5, left = kLeftPavement + 0.5;
  for (const double u : {right, left}) {
    placeStrip(builder, begin, end, {u, kerb}, {u, kClearance}, kLight);
  }
  placeStrip(builder, begin, end, {right, kClearance}, {left, kClearance}, kLight);
  for (const double s : {begin, end}) {
    Mesh portal;
    const auto corner = [&](double u, double z) {
      return Vertex{builder.road.surfacePoint(s, u, z), {u, z}, 0.7};
    };
    const double outer_right = right - kPortalWidth, outer_left = left + kPortalWidth;
    portal.addQuad(corner(outer_right, kClearance), corner(outer_left, kClearance),
                   corner(outer_left, kClearance + kThickness),
                   corner(outer_right, kClearance + kThickness), *builder.stone);
    for (const auto& [a, b] : {std::pair(outer_right, right), {left, outer_left}}) {
      portal.addQuad(corner(a, kerb), corner(b, kerb), corner(b, kClearance), corner(a, kClearance),
                     *builder.stone);
    }
    builder.place(builder.addMesh(std::move(portal)), Eigen::Isometry3d::Identity());
  }
  builder.shadows.setLight(begin, end, kLight);
}

}  // namespace gsv::simulation
