#include "synthetic_renderer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::synthetic {
namespace {

constexpr int kSide = 2;             // visibility samples a pixel, in x and in y
constexpr int kMaxAnisotropy = 16;   // samples along the long axis of a footprint
constexpr double kNear = 0.3;        // [m]
constexpr double kView = 220;        // [m]
constexpr double kHazeLength = 700;  // [m]
constexpr double kHazeGrey = 190;
constexpr double kLampGap = 1.2;       // between the headlamps [m]
constexpr double kLampPower = 2000;    // light, full daylight = 1, at 1 m [m^2]
constexpr double kLampWidth = 0.4;     // of the beam [rad]
constexpr double kLampDepth = 0.07;    // below its upper edge [rad]
constexpr double kLampCutOff = 0.012;  // of that edge below the horizon [rad]
constexpr double kGamma = 0.45;        // of the night's grey levels: eyes and cameras see the dark
constexpr std::uint32_t kSky = std::numeric_limits<std::uint32_t>::max();

/// A triangle in the image: rows are u/z, v/z, shade/z and 1/z, each affine in (x, y, 1) [px].
struct Surface {
  Eigen::Matrix<double, 4, 3> over_z;
  const Texture* texture;
};

double smoothStep(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

class Rasteriser {
 public:
  /// mirror: what puddles show in every pixel; nullptr where nothing is to be mirrored.
  Rasteriser(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c,
             const Rasteriser* mirror)
      : scene_(scene),
        camera_(camera),
        T_c_w_(T_w_c.inverse()),
        R_w_c_(T_w_c.linear()),
        mirror_(mirror),
        dusk_(std::pow(scene.daylight, kGamma)) {
    if (scene.T_w_lamps) T_l_c_ = scene.T_w_lamps->inverse() * T_w_c;
    K_ << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
    width_ = kSide * camera.width;
    const auto samples = static_cast<std::size_t>(width_ * kSide * camera.height);
    inverse_depth_.assign(samples, 0.f);
    id_.assign(samples, kSky);
    for (const Instance& instance : scene.instances) draw(instance);
  }

  cv::Mat shade() const {
    cv::Mat image(camera_.height, camera_.width, CV_32F);
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) image.at<float>(y, x) = shadePixel(x, y);
    }
    return image;
  }

 private:
  static double position(int sample) { return (sample + 0.5) / kSide - 0.5; }  // [px]

  bool inView(const Eigen::Vector3d& p_c, double radius) const {
    if (p_c.z() < kNear - radius || p_c.z() > kView + radius) return false;
    const auto inside = [&](double at, double focal, double from, double to) {
      // The two planes through the camera centre and the image's opposite sides.
      return focal * at - from * p_c.z() > -radius * std::hypot(focal, from) &&
             to * p_c.z() - focal * at > -radius * std::hypot(focal, to);
    };
    return inside(p_c.x(), camera_.fx, -camera_.cx - 1, camera_.width - camera_.cx) &&
           inside(p_c.y(), camera_.fy, -camera_.cy - 1, camera_.height - camera_.cy);
  }

  void draw(const Instance& instance) {
    const Mesh& mesh = *instance.mesh;
    const Eigen::Isometry3d T_c_m = T_c_w_ * instance.T_w_m;
    if (!inView(T_c_m * mesh.centre, mesh.radius)) return;
    std::vector<Eigen::Vector3d> projected;
    projected.reserve(mesh.vertices.size());
    for (const Vertex& vertex : mesh.vertices) projected.emplace_back(K_ * (T_c_m * vertex.p));
    for (const Mesh::Triangle& triangle : mesh.triangles) {
      Eigen::Matrix3d corners;  // columns: homogeneous pixels, the last row is z
      Eigen::Matrix<double, 4, 3> attributes;
      for (int k = 0; k < 3; ++k) {
        const auto index = static_cast<std::size_t>(triangle.v[k]);
        const Vertex& vertex = mesh.vertices[index];
        corners.col(k) = projected[index];
        attributes.col(k) << vertex.uv, vertex.shade, 1;
      }
      draw(corners, attributes, triangle.texture);
    }
  }

  /// Homogeneous rasterisation: the weights w = corners^-1 (x, y, 1) are those of the corners,
  /// divided by z; nothing needs to be cut at the near plane but the bounding box.
  void draw(const Eigen::Matrix3d& corners, const Eigen::Matrix<double, 4, 3>& attributes,
            const Texture* texture) {
    if (corners.row(2).maxCoeff() < kNear) return;
    Eigen::Array2d low(1e9, 1e9), high(-1e9, -1e9);
    const auto extend = [&](const Eigen::Vector3d& h) {
      low = low.min(h.head<2>().array() / h.z());
      high = high.max(h.head<2>().array() / h.z());
    };
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d a = corners.col(k), b = corners.col((k + 1) % 3);
      if (a.z() >= kNear) extend(a);
      if ((a.z() < kNear) != (b.z() < kNear)) {
        extend(a + (b - a) * ((kNear - a.z()) / (b.z() - a.z())));
      }
    }
    if (high.x() < -1 || high.y() < -1 || low.x() > camera_.width || low.y() > camera_.height) {
      return;
    }
    const auto first = [](double px) {
      return static_cast<int>(std::ceil((std::max(px, -1.0) + 0.5) * kSide - 0.5));
    };
    const auto last = [](double px, int size) {
      return static_cast<int>(std::floor((std::min<double>(px, size) + 0.5) * kSide - 0.5));
    };
    const int y0 = std::max(0, first(low.y()));
    const int y1 = std::min(kSide * camera_.height - 1, last(high.y(), camera_.height));
    if (y0 > y1 || first(low.x()) > last(high.x(), camera_.width)) return;
    bool invertible = false;
    Eigen::Matrix3d weights;
    corners.computeInverseWithCheck(weights, invertible, 1e-9);
    if (!invertible) return;  // seen from its edge

    const auto id = static_cast<std::uint32_t>(surfaces_.size());
    surfaces_.push_back({attributes * weights, texture});
    const Eigen::RowVector3d over_z = surfaces_.back().over_z.row(3);
    for (int j = y0; j <= y1; ++j) {
      const double y = position(j);
      double from = low.x(), to = high.x();
      for (int k = 0; k < 3; ++k) {
        const double slope = weights(k, 0), at_zero = weights(k, 1) * y + weights(k, 2);
        if (slope > 0) from = std::max(from, -at_zero / slope);
        if (slope < 0) to = std::min(to, -at_zero / slope);
        if (slope == 0 && at_zero < 0) to = from - 1;
      }
      const int x0 = std::max(0, first(from - 1e-7));
      const int x1 = std::min(width_ - 1, last(to + 1e-7, camera_.width));
      for (int i = x0; i <= x1; ++i) {
        const auto at = static_cast<std::size_t>(j * width_ + i);
        const auto near = static_cast<float>(over_z(0) * position(i) + over_z(1) * y + over_z(2));
        if (near > inverse_depth_[at]) {
          inverse_depth_[at] = near;
          id_[at] = id;
        }
      }
    }
  }

  float shadePixel(int x, int y) const {
    constexpr int kSamples = kSide * kSide;
    std::array<std::uint32_t, kSamples> ids;
    for (int k = 0; k < kSamples; ++k) {
      const int i = kSide * x + k % kSide, j = kSide * y + k / kSide;
      ids[static_cast<std::size_t>(k)] = id_[static_cast<std::size_t>(j * width_ + i)];
    }
    float sum = 0;
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (std::find(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(k), ids[k]) !=
          ids.begin() + static_cast<std::ptrdiff_t>(k)) {
        continue;  // this surface is done
      }
      int count = 0;
      Eigen::Vector2d centre(0, 0);  // of the samples that see it
      for (std::size_t m = k; m < ids.size(); ++m) {
        if (ids[m] != ids[k]) continue;
        ++count;
        const int s = static_cast<int>(m);
        centre += Eigen::Vector2d(position(kSide * x + s % kSide), position(kSide * y + s / kSide));
      }
      centre /= count;
      const float grey = ids[k] == kSky ? sky(centre) : surface(surfaces_[ids[k]], centre);
      sum += grey * static_cast<float>(count);
    }
    return sum / kSamples;
  }

  float sky(const Eigen::Vector2d& u) const {
    const Eigen::Vector3d ray = R_w_c_ * camera_.ray(u);
    const double azimuth = std::atan2(ray.y(), ray.x());
    const double elevation = std::atan2(ray.z(), std::hypot(ray.x(), ray.y()));
    const float day = scene_.sky->sample({azimuth + 4, std::clamp(kSkyTop - elevation, 0.0, 0.78)},
                                         Eigen::Matrix2d::Identity() / camera_.fx);
    return scene_.daylight < 1 ? day * static_cast<float>(dusk_) : day;
  }

  float surface(const Surface& s, const Eigen::Vector2d& u) const {
    const Eigen::Vector4d a = s.over_z * u.homogeneous();
    const double z = 1 / a(3);
    const Eigen::Vector2d uv = a.head<2>() * z;
    const Eigen::Matrix2d J =
        (s.over_z.topLeftCorner<2, 2>() - uv * s.over_z.bottomLeftCorner<1, 2>()) * z;
    double light = a(2) * z;
    if (s.texture == scene_.road) light *= carShadow(uv) * ownShadow(uv);
    if (scene_.daylight < 1) light *= night(s, z * camera_.ray(u));
    const double clear = std::exp(-z / kHazeLength);
    const double haze = kHazeGrey * dusk_;
    double grey = s.texture->sample(uv, J) * light;
    if (scene_.grain && s.texture == scene_.road) grey *= scene_.grain->sample(uv, J) / 128;
    if (s.texture == scene_.hood) grey = polished(grey, u);
    if (mirror_ && s.texture == scene_.road) grey = wet(grey, uv, J, u);
    return static_cast<float>(grey * clear + haze * (1 - clear));
  }

  /// Grey of the curved hood: its edge mirrors the horizon, what is near the zenith.
  double polished(double paint, const Eigen::Vector2d& u) const {
    const double height = camera_.height * scene_.hood_share;
    const double rise = std::clamp((camera_.height - u.y()) / height, 0.0, 1.0);
    const double edge = camera_.height - height;  // never the hood in the hood
    const double row = rise * std::clamp(0.95 * camera_.cy, 0.0, edge - 2);
    return 0.7 * paint + 0.35 * shadePixel(static_cast<int>(std::lround(u.x())),
                                           static_cast<int>(std::lround(row)));
  }

  /// Grey of the road under the puddles: darker where it is wet, and a mirror at a flat angle.
  double wet(double grey, const Eigen::Vector2d& uv, const Eigen::Matrix2d& J,
             const Eigen::Vector2d& u) const {
    if (uv.x() < scene_.puddles_from || uv.x() > scene_.puddles_to) return grey;
    const double water = scene_.puddles->sample(uv, J) / 255;
    if (water <= 0) return grey;
    const double upright = std::abs((R_w_c_ * camera_.ray(u).normalized()).z());
    const double mirrored = 0.02 + 0.98 * std::pow(1 - upright, 5);  // Schlick's, for water
    const double seen = mirror_->shadePixel(static_cast<int>(std::lround(u.x())),
                                            static_cast<int>(std::lround(u.y())));
    const double pool = 0.6 * grey * (1 - mirrored) + seen * mirrored;
    return grey + water * (pool - grey);
  }

  /// Factor on the day's grey at the place p_c of a surface.
  double night(const Surface& s, const Eigen::Vector3d& p_c) const {
    if (!scene_.T_w_lamps) return dusk_;
    const Eigen::Vector3d p_l = T_l_c_ * p_c;
    const Eigen::Vector3d n_l =
        T_l_c_.linear() * (K_.transpose() * s.over_z.row(3).transpose()).normalized();
    double light = scene_.daylight;
    for (const double side : {-0.5, 0.5}) {
      const Eigen::Vector3d way = p_l - Eigen::Vector3d(side * kLampGap, 0, 0);
      if (way.z() <= 0) continue;
      const double distance = way.norm(), across = std::atan2(way.x(), way.z()) / kLampWidth;
      const double below = std::atan2(way.y(), way.z()) - kLampCutOff;
      const double lit_part = smoothStep(0.5 + below / 0.02);
      const double beam = std::exp(-across * across) *
                          (0.015 + lit_part * std::exp(-std::max(below, 0.0) / kLampDepth));
      light += kLampPower / 2 * beam * std::abs(n_l.dot(way)) / std::pow(distance, 3);
    }
    return std::min(std::pow(light, kGamma), 1.3);
  }

  double carShadow(const Eigen::Vector2d& uv) const {
    double light = 1;
    for (const CarShadow& shadow : scene_.shadows) {
      const Eigen::Array2d outside = ((uv - shadow.uv).cwiseAbs() - shadow.half_size).array();
      light *= 1 - 0.65 * smoothStep(0.5 - outside.x() / 0.6) * smoothStep(0.5 - outside.y() / 0.6);
    }
    return light;
  }

  /// The light that is left in the own car's shadow.
  double ownShadow(const Eigen::Vector2d& uv) const {
    constexpr double kPenumbra = 0.1;  // [m]
    if (scene_.own_shadow.edges.empty()) return 1;
    double inside = 1e9;
    for (const Eigen::Vector3d& edge : scene_.own_shadow.edges) {
      inside = std::min(inside, edge.dot(uv.homogeneous()));
    }
    return 1 - 0.5 * smoothStep(0.5 + inside / kPenumbra);
  }

  const Scene& scene_;
  const PinholeCamera& camera_;
  const Eigen::Isometry3d T_c_w_;
  const Eigen::Matrix3d R_w_c_;
  const Rasteriser* mirror_;
  const double dusk_;  // factor on the day's grey where no lamp shines
  Eigen::Isometry3d T_l_c_ = Eigen::Isometry3d::Identity();  // lamps from camera
  Eigen::Matrix3d K_;
  int width_ = 0;                     // in samples
  std::vector<float> inverse_depth_;  // [1/m]
  std::vector<std::uint32_t> id_;     // of the surface that a sample sees
  std::vector<Surface> surfaces_;
};

}  // namespace

Texture::Texture(const cv::Mat& base, double texel_m, Wrap wrap)
    : levels_{base}, texel_m_(texel_m), wrap_(wrap) {
  while (levels_.back().cols % 2 == 0 && levels_.back().rows % 2 == 0) {
    cv::Mat half;
    cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
    levels_.push_back(half);
  }
}

float Texture::bilinear(std::size_t level, double x, double y) const {
  const cv::Mat& image = levels_[level];
  const double fx = std::floor(x), fy = std::floor(y);
  const auto dx = static_cast<float>(x - fx), dy = static_cast<float>(y - fy);
  int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy), x1 = x0 + 1, y1 = y0 + 1;
  if (wrap_ == Wrap::kRepeat) {
    x0 &= image.cols - 1, x1 &= image.cols - 1;
    y0 &= image.rows - 1, y1 &= image.rows - 1;
  } else {
    x0 = std::clamp(x0, 0, image.cols - 1), x1 = std::clamp(x1, 0, image.cols - 1);
    y0 = std::clamp(y0, 0, image.rows - 1), y1 = std::clamp(y1, 0, image.rows - 1);
  }
  const std::uint8_t *upper = image.ptr(y0), *lower = image.ptr(y1);
  const float a = upper[x0] + dx * static_cast<float>(upper[x1] - upper[x0]);
  const float b = lower[x0] + dx * static_cast<float>(lower[x1] - lower[x0]);
  return a + dy * (b - a);
}

float Texture::sample(const Eigen::Vector2d& uv, const Eigen::Matrix2d& J) const {
  // The footprint's ellipse: eigenvalues and first eigenvector of J J^T, in texels.
  const Eigen::Matrix2d A = J * J.transpose() / (texel_m_ * texel_m_);
  const double mean = A.trace() / 2, difference = (A(0, 0) - A(1, 1)) / 2;
  const double root = std::hypot(difference, A(0, 1));
  const double major = std::sqrt(mean + root), minor = std::sqrt(std::max(mean - root, 0.0));
  const int count =
      std::clamp(static_cast<int>(std::ceil(major / std::max(minor, 1.0))), 1, kMaxAnisotropy);
  Eigen::Vector2d axis = difference > 0 ? Eigen::Vector2d(difference + root, A(0, 1))
                                        : Eigen::Vector2d(A(0, 1), root - difference);
  axis *= axis.squaredNorm() > 0 ? 1.25 * major / axis.norm() : 0;

  const double level = std::clamp(std::log2(std::max({minor, major / count, 1.0})), 0.0,
                                  static_cast<double>(levels_.size()) - 1);
  const auto fine = static_cast<std::size_t>(level);
  const auto blend = static_cast<float>(level - static_cast<double>(fine));
  const Eigen::Vector2d centre = uv / texel_m_;
  float sum = 0, weights = 0;
  for (int k = 0; k < count; ++k) {
    const double t = (k + 0.5) / count - 0.5;
    const auto weight = static_cast<float>(1 - 3 * t * t);
    const Eigen::Vector2d at = (centre + t * axis) / static_cast<double>(1 << fine);
    float grey = bilinear(fine, at.x() - 0.5, at.y() - 0.5);
    if (blend > 0) {
      grey += blend * (bilinear(fine + 1, at.x() / 2 - 0.5, at.y() / 2 - 0.5) - grey);
    }
    sum += weight * grey;
    weights += weight;
  }
  return sum / weights;
}

void Mesh::addTriangle(const Vertex& a, const Vertex& b, const Vertex& c, const Texture& texture) {
  const int n = static_cast<int>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c});
  triangles.push_back({{n, n + 1, n + 2}, &texture});
}

void Mesh::addQuad(const Vertex& a, const Vertex& b, const Vertex& c, const Vertex& d,
                   const Texture& texture) {
  const int n = static_cast<int>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c, d});
  triangles.push_back({{n, n + 1, n + 2}, &texture});
  triangles.push_back({{n, n + 2, n + 3}, &texture});
}

void Mesh::bound() {
  Eigen::AlignedBox3d box;
  for (const Vertex& vertex : vertices) box.extend(vertex.p);
  centre = box.center();
  radius = box.diagonal().norm() / 2;
}

cv::Mat render(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c) {
  if (!scene.puddles) return Rasteriser(scene, camera, T_w_c, nullptr).shade();
  // A mirror at z = 0 shows, in the same pixels, what a camera below it sees upside down.
  Scene mirrored = scene;
  mirrored.puddles = nullptr;
  mirrored.instances.clear();
  for (const Instance& instance : scene.instances) {
    if (instance.mirrored) mirrored.instances.push_back(instance);
  }
  Eigen::Isometry3d T_w_below = T_w_c;
  T_w_below.matrix().row(2) *= -1;
  const Rasteriser mirror(mirrored, camera, T_w_below, nullptr);
  return Rasteriser(scene, camera, T_w_c, &mirror).shade();
}

}  // namespace ground_scale_vo::synthetic
