#include "synthetic_world.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "synthetic_car.hpp"
#include "synthetic_paint.hpp"

namespace ground_scale_vo::synthetic {
namespace {

constexpr double kMeshStep = 0.5;  // of the road along s [m]

// The cross-section [m]: u of the kerbs, of the lane's and the pavement's borders. Cars park
// between the right lane and the right kerb.
constexpr double kRightKerb = -4.3, kRightLine = -1.9, kCentreLine = 1.75, kLeftLine = 5.35;
constexpr double kLeftKerb = 5.6, kKerbHeight = 0.12, kKerbStone = 0.18;
constexpr double kRightPavement = -6.3, kLeftPavement = 7.8;
constexpr double kVergeEnd = 25;        // of the mesh, to both sides
constexpr double kRoadTexel = 0.02;     // [m]
constexpr int kRoadColumns = 896;       // of texels: 17.92 m
constexpr double kTextureRight = -8.2;  // u of the texture's first column
constexpr double kTextureLeft =
    kTextureRight + kRoadColumns * kRoadTexel - 2 * kKerbHeight;  // of its last

}  // namespace

/// Builds the world in the order of its constructor; textures and meshes stay where they are.
class World::Builder {
 public:
  Builder(World& world, const Street& street, const WorldOptions& options)
      : world_(world), street_(street), options_(options), random_(options.seed) {
    world_.road_from_ = street.from();
    const int rows = static_cast<int>((street.to() - street.from()) / kRoadTexel / 64 + 1) * 64;
    paint_ = cv::Mat(rows, kRoadColumns, CV_8U, cv::Scalar(kNeutral));
    shadow_ = cv::Mat(rows / kShadowTexels, kRoadColumns / kShadowTexels, CV_8U, cv::Scalar(255));
    leaves_ = &texture(leafImage(), 0.02);
    grass_ =
        &texture(grey(noiseTile({512, 512}, bits(), {{1, 1}, {4, 1}, {20, 1.2}}), 92, 17), 0.03);
    stone_ =
        &texture(grey(noiseTile({256, 256}, bits(), {{1, 1}, {5, 1}, {12, 1}}), 130, 16), 0.015);
    tiles_ = &texture(tileImage(), 0.03);
    sky();
    cars();
    trees();
    if (!options_.off_road) houses();
    if (options_.parked_cars) parkedCars();
    if (options_.wall_at > 0) wall();
    if (options_.bridge_from < options_.bridge_to) parapets();
    if (options_.underpass_from < options_.underpass_to) underpass();
    road();
  }

 private:
  static constexpr double kNeutral = 128;  // of paint_: the surface's own grey
  static constexpr int kShadowTexels = 8;  // a shadow texel's side in road texels
  std::uint64_t bits() { return random_.bits(); }
  double uniform(double from, double to) { return random_.uniform(from, to); }

  const Texture& texture(const cv::Mat& image, double texel_m,
                         Texture::Wrap wrap = Texture::Wrap::kRepeat) {
    return world_.textures_.emplace_back(image, texel_m, wrap);
  }
  const Mesh& keep(Mesh mesh) {
    mesh.bound();
    return world_.meshes_.emplace_back(std::move(mesh));
  }
  void place(const Mesh& mesh, const Eigen::Isometry3d& T_w_m) {
    world_.scene_.instances.push_back({&mesh, T_w_m});
  }

  void placeGround(Mesh mesh) {
    world_.scene_.instances.push_back(
        {&keep(std::move(mesh)), Eigen::Isometry3d::Identity(), false});
  }

  // --- Materials --------------------------------------------------------------------------------

  cv::Mat leafImage() {  // clumps of light leaves before dark gaps
    cv::Mat leaves = noiseTile({256, 256}, bits(), {{1, 1}, {2, 1}, {6, 0.7}});
    cv::max(cv::min(leaves, 1.3), -1.3, leaves);
    return grey(leaves, 96, 42);
  }

  cv::Mat tileImage() {  // a roof's
    cv::Mat image = grey(noiseTile({256, 256}, bits(), {{1, 1}, {6, 1}}), 88, 9);
    for (int row = 0; row < 256; row += 8) image.row(row) *= 0.7;
    return image;
  }

  void sky() {
    constexpr int kColumns = 4096, kRows = 512;
    cv::Mat image(kRows, kColumns, CV_8U);
    const cv::Mat clouds = noiseTile({1024, 512}, bits(), {{12, 0.5}, {40, 1}});
    const cv::Mat wood = noiseTile({1024, 512}, bits(), {{1.5, 1}, {5, 0.6}});
    const double phase = uniform(0, 6);
    const double texel = 2 * kPi / kColumns;
    for (int x = 0; x < kColumns; ++x) {
      const double azimuth = x * texel;
      const double hill = 0.035 + 0.018 * std::sin(3 * azimuth + phase) +
                          0.01 * std::sin(8 * azimuth + 2 * phase) +
                          0.0015 * wood.at<float>(7, x % 1024);
      for (int y = 0; y < kRows; ++y) {
        const double elevation = kSkyTop - y * texel;
        const double air = 225 - 60 * std::max(elevation, 0.0) + 5 * clouds.at<float>(y, x % 1024);
        const double ground = 135 - 250 * elevation + 10 * wood.at<float>(y, x % 1024);
        const double mix = std::clamp((hill - elevation) / (2 * texel) + 0.5, 0.0, 1.0);
        image.at<uchar>(y, x) = cv::saturate_cast<uchar>(air + mix * (ground - air));
      }
    }
    world_.scene_.sky = &texture(image, texel);
  }

  // --- Cars -------------------------------------------------------------------------------------

  void cars() {
    for (const double body : {185., 45., 120., 225., 75.}) {
      world_.cars_.push_back(
          carMesh(texture(carImage(body, bits()), kCarTexel, Texture::Wrap::kClamp), options_.sun));
      world_.cars_.back().bound();
    }
    world_.van_ = vanMesh(
        texture(vanImage(205, options_.seed + 77), kCarTexel, Texture::Wrap::kClamp), options_.sun);
    world_.van_.bound();
  }

  void parkedCars() {
    for (double s = street_.from() + 4; s < street_.to() - 4; s += uniform(5.2, 6.5)) {
      if (random_.chance(0.45)) parkCar(s, uniform(-3.35, -3.1), 0);
      if (random_.chance(0.15)) parkCar(s, uniform(6.7, 6.9), kKerbHeight);
    }
  }
  void parkCar(double s, double u, double z) {
    Eigen::Isometry3d T_w_m = street_.frame(s, u);
    T_w_m.translate(Eigen::Vector3d(0, 0, z));
    T_w_m.rotate(
        Eigen::AngleAxisd((u > 0 ? kPi : 0) + uniform(-0.03, 0.03), Eigen::Vector3d::UnitZ()));
    place(world_.car(bits()), T_w_m);
    castShadow(s, u, {{2.1, 0.85}, {2.1, -0.85}, {-2.1, -0.85}, {-2.1, 0.85}}, 0.05, 0.2);
    castShadow(s, u, {{1.9, 0.75}, {1.9, -0.75}, {-1.9, -0.75}, {-1.9, 0.75}}, 0.9, 0.5);
  }

  // --- Trees, poles, hedges, houses -------------------------------------------------------------

  void addPrism(Mesh& mesh, double radius, double top_radius, double height, const Texture& texture,
                double light) const {
    constexpr int kSides = 8;
    const auto rim = [&](int k, double r, double z) {
      const double angle = 2 * kPi * k / kSides;
      const Eigen::Vector3d normal(std::cos(angle), std::sin(angle), 0);
      return Vertex{r * normal + Eigen::Vector3d(0, 0, z),
                    {radius * angle, z},
                    light * lit(normal, options_.sun)};
    };
    for (int k = 0; k < kSides; ++k) {
      mesh.addQuad(rim(k, radius, 0), rim(k + 1, radius, 0), rim(k + 1, top_radius, height),
                   rim(k, top_radius, height), texture);
    }
  }

  /// A bumpy ball of leaves.
  void addCrown(Mesh& mesh, const Eigen::Vector3d& centre, double radius) {
    constexpr int kRound = 18, kUp = 11;
    std::array<std::array<Vertex, kRound + 1>, kUp + 1> grid;
    const Eigen::Vector2d offset(uniform(0, 5), uniform(0, 5));
    for (std::size_t j = 0; j <= kUp; ++j) {
      for (std::size_t i = 0; i <= kRound; ++i) {
        const double a = 2 * kPi * static_cast<double>(i) / kRound;
        const double b = kPi * (static_cast<double>(j) / kUp - 0.5);
        const Eigen::Vector3d n(std::cos(b) * std::cos(a), std::cos(b) * std::sin(a), std::sin(b));
        const bool pole = j == 0 || j == kUp;
        const double r = radius * (pole ? 1 : uniform(0.78, 1.15));
        const double shade =
            0.55 * lit(n, options_.sun) + 0.3 + 0.25 * n.z() + 0.15 * (r / radius - 1);
        grid[j][i] = {centre + r * n, offset + radius * Eigen::Vector2d(a, 1.3 * b), shade};
        if (i == kRound) grid[j][i].p = grid[j][0].p;
      }
    }
    for (std::size_t j = 0; j < kUp; ++j) {
      for (std::size_t i = 0; i < kRound; ++i) {
        mesh.addQuad(grid[j][i], grid[j][i + 1], grid[j + 1][i + 1], grid[j + 1][i], *leaves_);
      }
    }
  }

  void trees() {
    std::vector<const Mesh*> kinds;
    for (int k = 0; k < 6; ++k) {
      Mesh mesh;
      addPrism(mesh, uniform(0.14, 0.24), 0.12, 3.6, *stone_, 0.45);
      const int blobs = 5 + k % 3;
      for (int b = 0; b < blobs; ++b) {
        const double angle = 2 * kPi * b / blobs + uniform(-0.4, 0.4), out = uniform(0.7, 1.4);
        addCrown(mesh, {out * std::cos(angle), out * std::sin(angle), uniform(3.4, 5.6)},
                 uniform(0.8, 1.25));
      }
      addCrown(mesh, {0, 0, 5.2}, 1.5);
      kinds.push_back(&keep(std::move(mesh)));
    }
    Mesh lamp;
    addPrism(lamp, 0.08, 0.05, 6.5, *stone_, 0.6);
    const Mesh& pole = keep(std::move(lamp));
    for (const double u : {-7.3, 8.7}) {
      for (double s = street_.from() + uniform(0, 8); s < street_.to() - 3; s += uniform(7, 15)) {
        Eigen::Isometry3d T_w_m = Eigen::Isometry3d::Identity();
        T_w_m.translation() = street_.point(s, u, kKerbHeight);
        T_w_m.rotate(Eigen::AngleAxisd(uniform(0, 2 * kPi), Eigen::Vector3d::UnitZ()));
        if (random_.chance(0.25)) {
          if (!openBeside(s)) continue;
          place(pole, T_w_m);
          castShadow(s, u, {{0, 0.06}, {0, -0.06}}, 6.5, 0.4);
          continue;
        }
        if (!openBeside(s)) continue;
        place(*kinds[bits() % kinds.size()], T_w_m);
        castShadow(s, u, {{0, 0.16}, {0, -0.16}}, 4, 0.5);
        for (int leaf = 0; leaf < 150; ++leaf) {
          const double r = 2.2 * std::sqrt(uniform(0, 1)), a = uniform(0, 2 * kPi);
          castSpot(s, u, {r * std::cos(a), r * std::sin(a), uniform(3, 6.4)}, uniform(0.08, 0.36));
        }
      }
    }
  }

  /// Walls around the box [0, length] x [0, depth] x [0, height]: front (y = 0, the texture's front
  /// part), ends, and a roof of a ridge along x.
  Mesh house(double length, double depth, double height, double roof, const Eigen::Matrix3d& R_w_m,
             const Texture& front, const Texture& plain) {
    Mesh mesh;
    const auto light = [&](const Eigen::Vector3d& n) {
      return lit(R_w_m * n.normalized(), options_.sun);
    };
    const auto wall = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double top,
                          const Texture& texture, const Eigen::Vector3d& n) {
      const double l = (b - a).norm();
      const Eigen::Vector3d up(0, 0, top);
      const double at = light(n);  // darker at its foot: the sky is half hidden there
      mesh.addQuad({a, {0, top}, 0.85 * at}, {b, {l, top}, 0.85 * at}, {b + up, {l, 0}, at},
                   {a + up, {0, 0}, at}, texture);
    };
    const Eigen::Vector3d a(0, 0, 0), b(length, 0, 0), c(length, depth, 0), d(0, depth, 0);
    wall(a, b, height, front, {0, -1, 0});
    wall(b, c, height, plain, {1, 0, 0});
    wall(d, a, height, plain, {-1, 0, 0});
    if (roof <= 0) return mesh;
    const Eigen::Vector3d eaves(0, 0, height), ridge(0, depth / 2, height + roof);
    for (const double x : {0., length}) {  // gables
      const double at = light({x > 0 ? 1. : -1., 0, 0});
      const Eigen::Vector3d along(x, 0, 0);
      mesh.addTriangle({along + eaves, {0, 3}, at}, {along + eaves + d, {depth, 3}, at},
                       {along + ridge, {depth / 2, 3 - roof}, at}, plain);
    }
    const Eigen::Vector3d out(0.3, 0, 0), over(0, 0.4, 0.8 * roof / depth);
    const double slope = std::hypot(depth / 2, roof);
    for (const double side : {0., 1.}) {
      const double at = light({0, side > 0 ? roof : -roof, depth / 2});
      const Eigen::Vector3d low =
          side > 0 ? Eigen::Vector3d(eaves + d + Eigen::Vector3d(0, 0.4, -over.z()))
                   : Eigen::Vector3d(eaves - over);
      mesh.addQuad({low - out, {0, slope}, at}, {low + b + out, {length, slope}, at},
                   {ridge + b + out, {length, 0}, at}, {ridge - out, {0, 0}, at}, *tiles_);
    }
    return mesh;
  }

  /// Plaster with rows of windows, a door, a plinth and a down pipe.
  cv::Mat facadeImage(double length, double height, int floors, double wall) {
    const double texel = kFacadeTexel;
    const int columns = static_cast<int>(length / texel / 16 + 1) * 16;
    const int rows = static_cast<int>(height / texel / 16 + 1) * 16;
    cv::Mat image;
    cv::repeat(grey(plaster_, wall, 3.5), rows / 256 + 1, columns / 256 + 1, image);
    image = image(cv::Rect(0, 0, columns, rows)).clone();
    Brush brush(image, texel);
    brush.box(0, height - 0.6, length, 0.6, wall * 0.6);
    brush.box(uniform(0.2, 0.5), 0, 0.1, height, wall * 0.55);
    const double pitch = length / std::floor(length / uniform(2.2, 3.2)), storey = height / floors;
    const double w = uniform(0.9, 1.3), h = uniform(1.2, 1.5),
                 frame = random_.chance(0.5) ? 245 : 70;
    const int door = static_cast<int>(uniform(0, length / pitch));
    for (int floor = 0; floor < floors; ++floor) {
      if (floor > 0) brush.box(0, floor * storey - 0.08, length, 0.1, wall * 0.85);
      for (int k = 0; (k + 0.5) * pitch < length; ++k) {
        const double u = (k + 0.5) * pitch - w / 2, v = floor * storey + 0.65;
        if (floor == floors - 1 && k == door) {
          brush.box(u - 0.1, height - 2.3, w + 0.2, 2.3, frame);
          brush.box(u, height - 2.2, w, 2.2, uniform(40, 110));
          brush.box(u + 0.2, height - 2.0, w - 0.4, 0.6, 40);
          continue;
        }
        brush.box(u - 0.12, v - 0.12, w + 0.24, h + 0.24, 0.78 * wall);
        brush.box(u - 0.04, v - 0.04, w + 0.08, h + 0.08, frame);
        brush.box(u + 0.05, v + 0.05, w - 0.1, h - 0.1, uniform(28, 60));
        if (random_.chance(0.5)) {  // curtains or a blind
          brush.box(u + 0.05, v + 0.05, w - 0.1, uniform(0.2, h - 0.2), uniform(110, 190));
        }
        brush.box(u + w / 2 - 0.03, v, 0.06, h, frame);
        brush.box(u - 0.15, v + h + 0.08, w + 0.3, 0.07, 0.5 * wall);
      }
    }
    return image;
  }

  void houses() {
    plaster_ = noiseTile({256, 256}, bits(), {{1, 0.7}, {6, 1}, {30, 1}});
    const Texture& plaster = texture(grey(plaster_, 165, 5), kFacadeTexel);
    for (const double side : {-1., 1.}) {
      for (double s = street_.from() - 5; s < street_.to() + 25;) {
        const double length = uniform(8, 14), gap = uniform(1.5, 5);
        const double u = side > 0 ? uniform(11.5, 14.5) : -uniform(10.5, 13.5);
        const int floors = random_.chance(0.3) ? 3 : 2;
        const double height = 3.0 * floors, depth = uniform(8, 11);
        const double wall = side > 0 ? uniform(130, 245) : uniform(130, 225);
        const double at = std::min(s + length / 2, street_.to());
        Eigen::Isometry3d T_w_m = Eigen::Isometry3d::Identity();
        T_w_m.translation() = street_.point(at, u, kKerbHeight);
        T_w_m.rotate(Eigen::AngleAxisd(street_.heading(at) + (side > 0 ? 0 : kPi),
                                       Eigen::Vector3d::UnitZ()));
        T_w_m.translate(Eigen::Vector3d(-length / 2 + s + length / 2 - at, 0, -0.5));
        const Texture& front = texture(facadeImage(length, height + 0.5, floors, wall),
                                       kFacadeTexel, Texture::Wrap::kClamp);
        Mesh mesh =
            house(length, depth, height + 0.5, uniform(2, 3.5), T_w_m.linear(), front, plaster);
        const bool open = openBeside(s) && openBeside(s + length);
        if (open && clearOfRoad(T_w_m, length, depth)) place(keep(std::move(mesh)), T_w_m);
        if (open && side * options_.sun.y() > 0) {
          castShadow(at, u, {{length / 2, 0}, {-length / 2, 0}}, height, 1);
        }
        if (open)
          hedge(at, side > 0 ? uniform(9.6, 10.4) : -uniform(8.6, 9.4), length * uniform(0.4, 1));
        s += length + gap;
      }
    }
  }

  void hedge(double s, double u, double length) {
    Eigen::Isometry3d T_w_m = Eigen::Isometry3d::Identity();
    T_w_m.translation() = street_.point(s, u, kKerbHeight - 0.1);
    T_w_m.rotate(
        Eigen::AngleAxisd(street_.heading(s) + (u > 0 ? 0 : kPi), Eigen::Vector3d::UnitZ()));
    T_w_m.translate(Eigen::Vector3d(-length / 2, 0, 0));
    const Texture& skin = random_.chance(0.65) ? *leaves_ : *stone_;
    const double height = uniform(0.8, 1.5), depth = 0.4;
    Mesh mesh = house(length, depth, height, 0, T_w_m.linear(), skin, skin);
    mesh.addQuad({{0, 0, height}, {0, 0}, 0.95}, {{length, 0, height}, {length, 0}, 0.95},
                 {{length, depth, height}, {length, depth}, 0.95},
                 {{0, depth, height}, {0, depth}, 0.95}, skin);
    if (clearOfRoad(T_w_m, length, depth)) place(keep(std::move(mesh)), T_w_m);
  }

  /// Inside a tight curve a long box would reach over to the road again.
  bool clearOfRoad(const Eigen::Isometry3d& T_w_m, double length, double depth) const {
    constexpr double kWide = 0.035, kClear = 8.5;
    if (options_.largest_curvature <= kWide) return true;
    for (const double x : {0., 0.25, 0.5, 0.75, 1.}) {
      for (const double y : {0., 1.}) {
        if (street_.distance(T_w_m * Eigen::Vector3d(x * length, y * depth, 0)) < kClear) {
          return false;
        }
      }
    }
    return true;
  }

  // --- What stands across or beside the road ----------------------------------------------------

  static bool between(double s, double from, double to) { return s >= from && s <= to; }
  /// Neither bridge nor underpass takes the place of houses and trees.
  bool openBeside(double s) const {
    constexpr double kClear = 3;
    const auto near = [&](double from, double to) {
      return from < to && between(s, from - kClear, to + kClear);
    };
    return !near(options_.bridge_from, options_.bridge_to) &&
           !near(options_.underpass_from, options_.underpass_to);
  }

  /// The front of a house across road and pavements.
  void wall() {
    constexpr double kLength = 26, kHeight = 6.5;
    const Texture& front =
        texture(facadeImage(kLength, kHeight, 2, 150), kFacadeTexel, Texture::Wrap::kClamp);
    Eigen::Isometry3d T_w_m = street_.frame(options_.wall_at, kLength / 2);
    T_w_m.rotate(Eigen::AngleAxisd(-kPi / 2, Eigen::Vector3d::UnitZ()));
    place(keep(house(kLength, 6, kHeight, 2.5, T_w_m.linear(), front, front)), T_w_m);
  }

  /// A strip between two places of the cross-section (u, z), along the road.
  void placeStrip(double from, double to, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                  double shade, const Texture& skin) {
    Mesh mesh;
    const double width = (b - a).norm();
    const auto vertex = [&](double s, const Eigen::Vector2d& uz, double across) {
      return Vertex{street_.point(s, uz.x(), uz.y()), {across, s - street_.from()}, shade};
    };
    for (double s = from; s < to; s += 2) {
      const double next = std::min(s + 2, to);
      mesh.addQuad(vertex(s, a, 0), vertex(s, b, width), vertex(next, b, width), vertex(next, a, 0),
                   skin);
    }
    place(keep(std::move(mesh)), Eigen::Isometry3d::Identity());
  }

  void parapets() {
    constexpr double kTop = kKerbHeight + 1.0, kThick = 0.25;
    const double from = options_.bridge_from, to = options_.bridge_to;
    for (const auto& [u, out] : {std::pair(kRightPavement, -kThick), {kLeftPavement, kThick}}) {
      placeStrip(from, to, {u, kKerbHeight}, {u, kTop}, 0.7, *stone_);
      placeStrip(from, to, {u, kTop}, {u + out, kTop}, 1, *stone_);
      placeStrip(from, to, {u + out, kTop}, {u + out, -2}, 0.6, *stone_);
    }
  }

  /// Walls, a ceiling and its two faces; the road below lies in the dark.
  void underpass() {
    constexpr double kClearance = 4.6, kThick = 1.2, kLight = 0.2;
    const double from = options_.underpass_from, to = options_.underpass_to;
    const double right = kRightPavement - 0.5, left = kLeftPavement + 0.5;
    for (const double u : {right, left}) {
      placeStrip(from, to, {u, kKerbHeight}, {u, kClearance}, kLight, *stone_);
    }
    placeStrip(from, to, {right, kClearance}, {left, kClearance}, kLight, *stone_);
    for (const double s : {from, to}) {
      Mesh face;
      const auto corner = [&](double u, double z) {
        return Vertex{street_.point(s, u, z), {u, z}, 0.7};
      };
      face.addQuad(corner(right - 8, kClearance), corner(left + 8, kClearance),
                   corner(left + 8, kClearance + kThick), corner(right - 8, kClearance + kThick),
                   *stone_);
      for (const auto& [a, b] : {std::pair(right - 8, right), {left, left + 8}}) {
        face.addQuad(corner(a, kKerbHeight), corner(b, kKerbHeight), corner(b, kClearance),
                     corner(a, kClearance), *stone_);
      }
      place(keep(std::move(face)), Eigen::Isometry3d::Identity());
    }
    const Eigen::Vector2d at = onRoad(from, kTextureRight);
    Brush(shadow_, kShadowTexels * kRoadTexel)
        .box(at.x(), at.y(), kRoadColumns * kRoadTexel, to - from, 255 * kLight);
  }

  // --- The road ---------------------------------------------------------------------------------

  Eigen::Vector2d onRoad(double s, double u) const { return world_.roadTexture(s, u); }

  /// Where the shadow of a point falls: at height h above (s, u), offset (along, left) in road
  /// axes.
  Eigen::Vector2d shadowOf(double s, double u, const Eigen::Vector3d& above) const {
    const Eigen::Vector3d sun =
        Eigen::AngleAxisd(-street_.heading(s), Eigen::Vector3d::UnitZ()) * options_.sun;
    return onRoad(s + above.x() - sun.x() / sun.z() * above.z(),
                  u + above.y() - sun.y() / sun.z() * above.z());
  }
  /// Shadow of an upright prism over a polygon, or of an upright wall over a line (two points).
  void castShadow(double s, double u, const std::vector<Eigen::Vector2d>& base, double height,
                  double depth) {
    std::vector<cv::Point2f> points;
    for (const Eigen::Vector2d& p : base) {
      for (const double z : {0., height}) {
        const Eigen::Vector2d at = shadowOf(s, u, {p.x(), p.y(), z});
        points.emplace_back(static_cast<float>(at.x()), static_cast<float>(at.y()));
      }
    }
    std::vector<cv::Point2f> hull;
    cv::convexHull(points, hull);
    std::vector<Eigen::Vector2d> corners;
    corners.reserve(hull.size());
    for (const cv::Point2f& p : hull) corners.emplace_back(p.x, p.y);
    Brush(shadow_, kShadowTexels * kRoadTexel).polygon(corners, 255 * (1 - 0.5 * depth));
  }
  void castSpot(double s, double u, const Eigen::Vector3d& above, double radius) {
    Brush(shadow_, kShadowTexels * kRoadTexel)
        .ellipse(shadowOf(s, u, above), {radius, radius}, 255 * 0.52);
  }

  void road() {
    paintAsphalt();
    if (options_.cobbles) paintCobbles();
    if (options_.puddles > 0) puddles();
    if (options_.grain > 0) {
      const cv::Mat stones = noiseTile({1024, 1024}, bits(), {{0.8, 1}, {1.8, 1}, {3.5, 0.8}});
      world_.scene_.grain = &texture(grey(stones, kNeutral, kNeutral * options_.grain), 0.004);
    }
    cv::Mat shadow = shadow_;
    cv::GaussianBlur(shadow, shadow, {}, 0.8);
    cv::resize(shadow, shadow, paint_.size(), 0, 0, cv::INTER_LINEAR);
    if (!options_.shadows) shadow.setTo(255);

    cv::Mat albedo(paint_.size(), CV_8U);
    std::vector<float> contrast(kRoadColumns);
    const auto zone = [&](double from, double to, double level, double grain) {
      const int a = column(from), b = column(to);
      albedo.colRange(a, b) = level;
      std::fill(contrast.begin() + a, contrast.begin() + b, static_cast<float>(grain));
    };
    const double k = options_.road_texture, cross = kTextureLeft;
    zone(kTextureRight, cross, 85, 0.2);  // verges
    zone(kRightPavement, kRightKerb, 150, 0.07);
    zone(kLeftKerb, kLeftPavement, 150, 0.07);
    zone(kRightKerb - kKerbStone, kRightKerb, 170, 0.06);
    zone(kLeftKerb, kLeftKerb + kKerbStone, 170, 0.06);
    zone(kRightKerb, kLeftKerb, 118, 0.085 * k);
    zone(kRightKerb, kRightLine, 128, 0.11 * k);
    Brush brush(albedo, kRoadTexel);
    for (double s = street_.from(); s < street_.to(); s += 1) pavementRow(brush, s);
    if (options_.lane_markings) paintLines(brush);
    if (options_.arrow_spacing > 0) paintArrows(brush);
    if (options_.bumps) paintBumps(brush);
    const int bare_first = row(options_.bare_from), bare_end = row(options_.bare_to);
    const int road_first = column(kRightKerb), road_end = column(kLeftKerb);
    if (bare_first < bare_end) {
      paint_(cv::Range(bare_first, bare_end), cv::Range(road_first, road_end)) = kNeutral;
    }

    std::vector<float> bare = contrast;  // where the asphalt shows nothing
    std::fill(bare.begin() + road_first, bare.begin() + road_end, 0.f);

    // 20 m of grit, repeated: the paint's, the light's and the surface's grey are multiplied.
    const cv::Mat grit =
        noiseTile({kRoadColumns, 1024}, bits(), {{0.7, 1.1}, {1.8, 0.8}, {5, 0.4}, {40, 0.5}});
    for (int y = 0; y < albedo.rows; ++y) {
      const float* grain = grit.ptr<float>(y % grit.rows);
      const uchar *paint = paint_.ptr(y), *light = shadow.ptr(y);
      const std::vector<float>& strength = y >= bare_first && y < bare_end ? bare : contrast;
      uchar* out = albedo.ptr(y);
      for (int x = 0; x < albedo.cols; ++x) {
        const float tone = static_cast<float>(paint[x] * light[x]) / (128.f * 255.f);
        const float grainy = 1 + strength[static_cast<std::size_t>(x)] * grain[x];
        out[x] = cv::saturate_cast<uchar>(static_cast<float>(out[x]) * tone * grainy);
      }
    }
    world_.scene_.road = &texture(albedo, kRoadTexel, Texture::Wrap::kClamp);
    meshRoad();
  }

  static int column(double u) {
    // The kerbs' faces stand between the road's and the pavements' columns.
    const double right = u >= kRightKerb ? kKerbHeight : 0, left = u >= kLeftKerb ? kKerbHeight : 0;
    return static_cast<int>(std::lround((u - kTextureRight + right + left) / kRoadTexel));
  }

  /// Of the road's texture; s may lie outside of it.
  int row(double s) const {
    const double at = (s - street_.from()) / kRoadTexel;
    return static_cast<int>(std::lround(std::clamp(at, 0.0, static_cast<double>(paint_.rows))));
  }

  void pavementRow(Brush& brush, double s) {  // one metre of slabs and kerb stones
    for (const double from : {kRightPavement, kLeftKerb + kKerbStone}) {
      for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 2; ++j) {
          const Eigen::Vector2d at = onRoad(s + 0.5 * j, from + 0.45 * i);
          brush.box(at.x(), at.y(), 0.45, 0.5, 85);
          brush.box(at.x() + 0.015, at.y() + 0.02, 0.42, 0.46, uniform(128, 175));
        }
      }
    }
    for (const double u : {kRightKerb - kKerbStone, kLeftKerb}) {
      const Eigen::Vector2d at = onRoad(s, u);
      brush.box(at.x() - (u > 0 ? kKerbHeight : 0), at.y(), kKerbStone + kKerbHeight, 0.03, 90);
    }
  }

  void paintLines(Brush& brush) {
    const double dash = options_.solid_lines ? 6 : 3;
    for (double s = street_.from(); s < street_.to(); s += 6) {
      const Eigen::Vector2d at = onRoad(s, kCentreLine - 0.06);
      brush.box(at.x(), at.y(), 0.12, dash, 215);
      if (options_.solid_lines) continue;
      const Eigen::Vector2d bay = onRoad(s, kRightKerb);
      brush.box(bay.x(), bay.y(), kRightLine - kRightKerb, 0.1, 195);
    }
    for (const double u : {kRightLine, kLeftLine}) {
      const Eigen::Vector2d at = onRoad(street_.from(), u - 0.06);
      brush.box(at.x(), at.y(), 0.12, street_.to() - street_.from(), 205);
    }
  }

  /// Straight on, in the middle of the lane: a shaft and a head.
  void paintArrows(Brush& brush) {
    for (double s = street_.from() + 4; s < street_.to() - 6; s += options_.arrow_spacing) {
      const Eigen::Vector2d at = onRoad(s, 0);
      const auto corner = [&](double x, double y) {
        return Eigen::Vector2d(at + Eigen::Vector2d(x, y));
      };
      brush.box(at.x() - 0.08, at.y(), 0.16, 3.1, 215);
      brush.polygon({corner(-0.38, 3), corner(0.38, 3), corner(0, 4.9)}, 215);
    }
  }

  /// Fresh, darker asphalt, and white fields on the flank that faces the traffic.
  void paintBumps(Brush& brush) {
    for (double s = kBumpAt; s < street_.to() - kBumpLength; s += kBumpSpacing) {
      const Eigen::Vector2d at = onRoad(s, kRightKerb);
      brush.box(at.x(), at.y(), kLeftKerb - kRightKerb, kBumpLength, 88);
      for (double x = 0.3; x < kLeftKerb - kRightKerb - 0.5 && options_.lane_markings; x += 1) {
        const bool right = kRightKerb + x < kCentreLine;
        brush.box(at.x() + x, at.y() + (right ? 0.3 : kBumpLength - 1.2), 0.5, 0.9, 210);
      }
    }
  }

  /// Stones in rows across the road, each of its own grey, with sand between them.
  void paintCobbles() {
    paint_.colRange(column(kRightKerb), column(kLeftKerb)) = kNeutral;
    constexpr int kAcross = 9, kAlong = 7;  // texels of a stone with its joint
    const int first = column(kRightKerb), end = column(kLeftKerb);
    std::vector<double> stones(static_cast<std::size_t>((end - first) / kAcross + 2));
    int shift = 0;
    for (int y = 0; y < paint_.rows; ++y) {
      if (y % kAlong == 0) {
        for (double& stone : stones) stone = uniform(-22, 20);
        shift = static_cast<int>(uniform(0, kAcross));
      }
      uchar* out = paint_.ptr(y);
      for (int x = first; x < end; ++x) {
        const int at = x - first + shift, in_row = y % kAlong, in_stone = at % kAcross;
        const bool joint = in_row == 0 || in_stone == 0;
        const bool rim = in_row == 1 || in_row == kAlong - 1 || in_stone == 1;  // rounded off
        const double stone = stones[static_cast<std::size_t>(at / kAcross)];
        const double percent = joint ? -45 : stone - (rim ? 9 : 0);
        out[x] = cv::saturate_cast<uchar>(out[x] * (1 + percent / 100));
      }
    }
  }

  /// Irregular pools of some metres with narrow shores, repeated after 41 m.
  void puddles() {
    cv::Mat depth = noiseTile({256, 512}, bits(), {{3, 0.35}, {8, 1}, {20, 0.8}});
    std::vector<float> sorted(depth.begin<float>(), depth.end<float>());
    const auto shore =
        sorted.begin() + static_cast<std::ptrdiff_t>((1 - options_.puddles) *
                                                     static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), shore, sorted.end());
    const double narrow = 0.12;
    depth.convertTo(depth, CV_8U, 255 / narrow, -255 * *shore / narrow);
    world_.scene_.puddles = &texture(depth, 0.08);
    world_.scene_.puddles_from = onRoad(0, kRightKerb).x();
    world_.scene_.puddles_to = onRoad(0, kLeftKerb).x() - kKerbHeight;
  }

  /// Patches, tarred joints and cracks, spots, manholes: factors on the asphalt's grey.
  void paintAsphalt() {
    Brush brush(paint_, kRoadTexel);
    const double k = options_.road_texture;
    const auto tone = [&](double percent) {
      return std::clamp(kNeutral * (1 + k * percent / 100), 0.0, 255.0);
    };
    const auto across = [&] { return uniform(kRightKerb + 0.3, kLeftKerb - 0.3); };
    for (double s = street_.from() + 3; s < street_.to() - 12; s += uniform(7, 14)) {  // patches
      const Eigen::Vector2d at = onRoad(s, uniform(kRightKerb, kLeftKerb - 2.5));
      const double width = uniform(0.7, 2.4), length = uniform(1, 6), seam = 0.05;
      brush.box(at.x() - seam, at.y() - seam, width + 2 * seam, length + 2 * seam, tone(-45));
      brush.box(at.x(), at.y(), width, length, tone(uniform(-22, 14)));
    }
    for (double s = street_.from(); s < street_.to() - 10; s += uniform(1.5, 3)) {  // cracks
      Eigen::Vector2d at = onRoad(s, across());
      double angle = random_.chance(0.5) ? uniform(0, 2 * kPi) : kPi / 2 + uniform(-0.2, 0.2);
      const double width = uniform(0.02, 0.09), level = tone(uniform(-60, -30));
      for (double left = uniform(1, 7); left > 0; left -= 0.25) {
        angle += uniform(-0.35, 0.35);
        const Eigen::Vector2d next = at + 0.25 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
        if (next.x() < onRoad(s, kRightKerb + 0.1).x() || next.x() > onRoad(s, kLeftKerb - 0.1).x())
          break;
        brush.line(at, next + 0.1 * (next - at), width, level);
        at = next;
      }
    }
    for (double s = street_.from(); s < street_.to(); s += uniform(0.1, 0.35)) {  // spots, gum, oil
      const double r = uniform(0.02, 0.12);
      brush.ellipse(onRoad(s, across()), {r, r * uniform(0.6, 2.5)}, tone(uniform(-35, 28)));
    }
    for (double s = street_.from() + uniform(0, 15); s < street_.to() - 2; s += uniform(9, 20)) {
      const Eigen::Vector2d at = onRoad(s, uniform(-1.2, 4.8));  // manholes
      brush.ellipse(at, {0.42, 0.42}, tone(30));
      brush.ellipse(at, {0.34, 0.34}, tone(-50));
      brush.ellipse(at, {0.30, 0.30}, tone(-15));
      for (int i = -1; i <= 1; ++i) {
        for (int j = -1; j <= 1; ++j) {
          brush.ellipse(at + 0.14 * Eigen::Vector2d(i, j), {0.045, 0.045}, tone(-60));
        }
      }
    }
  }

  /// Ruts, tufts and holes of some centimetres around the plane.
  static double roughness(double s, double u) {
    return 0.025 * std::sin(1.9 * s + 0.7 * u) + 0.02 * std::sin(3.1 * u - 1.3 * s + 1) +
           0.02 * std::sin(4.3 * s + 2.7 * u + 2);
  }

  /// No road: uneven all over, gravel where the road would be.
  void meshGravel() {
    const Texture& gravel = texture(
        grey(noiseTile({512, 512}, bits(), {{0.8, 1}, {2, 1}, {8, 0.8}, {40, 0.8}}), 118, 20),
        0.02);
    const double verge = std::min(kVergeEnd, 0.8 / std::max(options_.largest_curvature, 1e-9));
    constexpr double kWidth = 0.5, kLength = 10;
    const auto vertex = [&](double s, double u) {
      const double z = roughness(s, u);
      return Vertex{street_.point(s, u, z), {u, s - street_.from()}, 0.95 + 2 * z};
    };
    for (double first = street_.from(); first + kMeshStep < street_.to(); first += kLength) {
      Mesh mesh;
      for (double s = first; s < std::min(first + kLength, street_.to()); s += kMeshStep) {
        for (double u = -verge; u < verge; u += kWidth) {
          const bool track = u > kRightKerb && u < kLeftKerb;
          mesh.addQuad(vertex(s, u), vertex(s, u + kWidth), vertex(s + kMeshStep, u + kWidth),
                       vertex(s + kMeshStep, u), track ? gravel : *grass_);
        }
      }
      placeGround(std::move(mesh));
    }
  }

  void meshRoad() {
    if (options_.off_road) {
      meshGravel();
    } else {
      meshStrips();
    }
    Mesh plain;  // what lies beyond the verges
    const double size = 500, below = options_.bridge_from < options_.bridge_to ? kBelowBridge : 0.5;
    const double low = std::min(0.0, street_.lowest()) - street_.point(0, 0).z() - below;
    const auto corner = [&](double x, double y) {
      return Vertex{street_.point(0, 0, low) + Eigen::Vector3d(x, y, 0), {x, y}, 0.9};
    };
    const double to = street_.to() + size;
    plain.addQuad(corner(-size, -to), corner(to, -to), corner(to, to), corner(-size, to), *grass_);
    placeGround(std::move(plain));
  }

  void meshStrips() {
    struct Strip {
      double u, z, u_next, z_next;
      bool verge;
    };
    // Inside a tight curve the verge ends before the curve's centre, where it would fold.
    const double verge = std::min(kVergeEnd, 0.8 / std::max(options_.largest_curvature, 1e-9));
    const double middle = std::min(14.0, (verge - kTextureRight) / 2);
    const std::array<Strip, 8> strips{{
        {-verge, kKerbHeight, -middle, kKerbHeight, true},
        {-middle, kKerbHeight, kTextureRight, kKerbHeight, true},
        {kTextureRight, kKerbHeight, kRightKerb, kKerbHeight, false},
        {kRightKerb, kKerbHeight, kRightKerb, 0, false},
        {kRightKerb, 0, kLeftKerb, 0, false},
        {kLeftKerb, 0, kLeftKerb, kKerbHeight, false},
        {kLeftKerb, kKerbHeight, kTextureLeft, kKerbHeight, false},
        {kTextureLeft, kKerbHeight, verge, kKerbHeight, true},
    }};
    const auto vertex = [&](const Strip& strip, double s, double u, double z, double u_texture) {
      const bool face = strip.z != strip.z_next;
      const Eigen::Vector2d uv(strip.verge ? u : u_texture, s - street_.from());
      return Vertex{street_.point(s, u, z), uv, face ? 0.6 : 0.97};
    };
    const int per_mesh = 20, steps = static_cast<int>((street_.to() - street_.from()) / kMeshStep);
    for (int first = 0; first < steps; first += per_mesh) {
      Mesh mesh;
      for (int k = first; k < std::min(first + per_mesh, steps); ++k) {
        const double s0 = street_.from() + kMeshStep * k, s1 = s0 + kMeshStep;
        double along = 0;  // the cross-section, in the texture
        for (const Strip& strip : strips) {
          const double a = along;
          if (!strip.verge) {
            along += std::hypot(strip.u_next - strip.u, strip.z_next - strip.z);
          }
          const bool falls_away = between(s0, options_.bridge_from, options_.bridge_to - kMeshStep);
          if (falls_away && strip.verge) continue;
          mesh.addQuad(vertex(strip, s0, strip.u, strip.z, a),
                       vertex(strip, s0, strip.u_next, strip.z_next, along),
                       vertex(strip, s1, strip.u_next, strip.z_next, along),
                       vertex(strip, s1, strip.u, strip.z, a),
                       strip.verge ? *grass_ : *world_.scene_.road);
        }
      }
      placeGround(std::move(mesh));
    }
  }

  static constexpr double kFacadeTexel = 0.025;  // [m]
  static constexpr double kBelowBridge = 9;      // [m]
  World& world_;
  const Street& street_;
  const WorldOptions options_;
  Random random_;
  cv::Mat paint_;   // factor on the road's grey, kNeutral = 1
  cv::Mat shadow_;  // light on the road, 255 = full
  cv::Mat plaster_;
  const Texture *leaves_, *grass_, *stone_, *tiles_;
};

World::World(const Street& street, const WorldOptions& options) { Builder(*this, street, options); }

Eigen::Vector2d World::roadTexture(double s, double u) const {
  const double kerbs = (u >= kRightKerb ? kKerbHeight : 0) + (u >= kLeftKerb ? kKerbHeight : 0);
  return {u - kTextureRight + kerbs, s - road_from_};
}

}  // namespace ground_scale_vo::synthetic
