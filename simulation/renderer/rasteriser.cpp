#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/vector_loop.hpp"
#include "simulation/renderer/scene.hpp"

namespace gsv::simulation {
namespace {

constexpr int kSamplesPerSide = 2;     // visibility samples per pixel, in x and in y
constexpr double kNearPlane = 0.3;     // [m]
constexpr double kFarPlane = 220;      // [m]
constexpr double kHazeDistance = 700;  // at which haze has absorbed 1 - 1/e of the light [m]
constexpr double kHazeGrey = 190;      // of the haze by day [grey levels]

// Two headlamps with an elliptic Gaussian beam below a horizontal cut-off.
constexpr double kLampSpacing = 1.2;      // [m]
constexpr double kLampIntensity = 2000;   // illumination at 1 m, full daylight = 1 [m^2]
constexpr double kBeamWidth = 0.4;        // half width at 1/e [rad]
constexpr double kBeamHeight = 0.07;      // decay below the cut-off, to 1/e [rad]
constexpr double kCutOffAngle = 0.012;    // of the cut-off below the horizon [rad]
constexpr double kCutOffSoftness = 0.02;  // transition at the cut-off [rad]
constexpr double kStrayLight = 0.015;     // above the cut-off, as a share of the beam
constexpr double kNightGamma = 0.45;      // exponent from illumination to grey level
constexpr double kMaxNightGain = 1.3;     // limit of the factor on the daylight grey level

// Shadows of moving vehicles (box) and of the ego vehicle. Edge: width of the penumbra [m]; depth:
// share of the light lost.
constexpr double kBoxShadowEdge = 0.6, kBoxShadowDepth = 0.65;
constexpr double kEgoShadowEdge = 0.1, kEgoShadowDepth = 0.5;

constexpr double kSkyRotation = 4;   // of the panorama about the vertical [rad]
constexpr double kSkyHeight = 0.78;  // extent of the panorama in elevation [rad]

/// Id of samples that show no surface.
constexpr std::int32_t kSky = -1;

/// A projected triangle. Rows: u/z, v/z, light/z and 1/z, each affine in the pixel (x, y, 1).
struct Surface {
  Eigen::Matrix<double, 4, 3> over_z;
  const Texture* texture;
};

double smoothStep(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

/// Pixel coordinate of a sample's column or row; the centre of the first pixel is 0 [px].
constexpr double position(int sample) { return (sample + 0.5) / kSamplesPerSide - 0.5; }

/// The first sample at or after a pixel coordinate, and the last one at or before it. At most one
/// pixel outside an image of this size.
inline int firstSample(double px) {
  return static_cast<int>(std::ceil((std::max(px, -1.0) + 0.5) * kSamplesPerSide - 0.5));
}
inline int lastSample(double px, int size) {
  return static_cast<int>(std::floor((std::min<double>(px, size) + 0.5) * kSamplesPerSide - 0.5));
}

/// Where and what to draw: rows y0 to y1 of samples, columns within [low_x, high_x] px.
struct TriangleExtent {
  int y0, y1;
  double low_x, high_x;
};

/// Draws a triangle where it is nearer than what the samples show. weights: rows, the barycentric
/// weights divided by z, affine in the pixel (x, y, 1); over_z: likewise 1/z. width: of the image
/// [px].
GSV_VECTOR_LOOP
void drawTriangle(const Eigen::Matrix3d& weights, const Eigen::RowVector3d& over_z,
                  const TriangleExtent& extent, int width, std::int32_t id, float* inverse_depth,
                  std::int32_t* ids) {
  const int samples = kSamplesPerSide * width;
  for (int j = extent.y0; j <= extent.y1; ++j) {
    const double y = position(j);
    double from = extent.low_x, to = extent.high_x;
    for (int k = 0; k < 3; ++k) {
      const double slope = weights(k, 0), at_zero = weights(k, 1) * y + weights(k, 2);
      if (slope > 0) from = std::max(from, -at_zero / slope);
      if (slope < 0) to = std::min(to, -at_zero / slope);
      if (slope == 0 && at_zero < 0) to = from - 1;
    }
    const int x0 = std::max(0, firstSample(from - 1e-7));
    const int x1 = std::min(samples - 1, lastSample(to + 1e-7, width));
    const double slope = over_z(0), row = over_z(1) * y, constant = over_z(2);
    float* const nearest = inverse_depth + static_cast<std::ptrdiff_t>(j) * samples;
    std::int32_t* const shown = ids + static_cast<std::ptrdiff_t>(j) * samples;
    for (int i = x0; i <= x1; ++i) {
      const auto inverse_z = static_cast<float>(slope * position(i) + row + constant);
      const bool is_nearer = inverse_z > nearest[i];
      nearest[i] = is_nearer ? inverse_z : nearest[i];
      shown[i] = is_nearer ? id : shown[i];
    }
  }
}

class Rasteriser {
 public:
  /// Rasterises all instances. reflection: the image reflected by puddles; nullptr for a dry road.
  Rasteriser(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c,
             const Rasteriser* reflection)
      : scene_(scene),
        camera_(camera),
        T_c_w_(T_w_c.inverse()),
        R_w_c_(T_w_c.linear()),
        reflection_(reflection),
        ambient_(std::pow(scene.daylight, kNightGamma)),
        T_l_c_(scene.T_w_lamps.inverse() * T_w_c) {
    K_ << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
    width_ = kSamplesPerSide * camera.width;
    const auto samples = static_cast<std::size_t>(width_ * kSamplesPerSide * camera.height);
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
  bool isVisible(const Eigen::Vector3d& p_c, double radius) const {
    if (p_c.z() < kNearPlane - radius || p_c.z() > kFarPlane + radius) return false;
    const auto inside = [&](double at, double focal, double from, double to) {
      // The two planes through the camera centre and opposite sides of the image.
      return focal * at - from * p_c.z() > -radius * std::hypot(focal, from) &&
             to * p_c.z() - focal * at > -radius * std::hypot(focal, to);
    };
    return inside(p_c.x(), camera_.fx, -camera_.cx - 1, camera_.width - camera_.cx) &&
           inside(p_c.y(), camera_.fy, -camera_.cy - 1, camera_.height - camera_.cy);
  }

  void draw(const Instance& instance) {
    const Mesh& mesh = *instance.mesh;
    const Eigen::Isometry3d T_c_m = T_c_w_ * instance.T_w_m;
    if (!isVisible(T_c_m * mesh.centre, mesh.radius)) return;
    std::vector<Eigen::Vector3d> projected;  // vertices, homogeneous pixels
    projected.reserve(mesh.vertices.size());
    for (const Vertex& vertex : mesh.vertices) projected.emplace_back(K_ * (T_c_m * vertex.p));
    for (const Mesh::Triangle& triangle : mesh.triangles) {
      Eigen::Matrix3d corners;  // columns: homogeneous pixels, the last row is z
      Eigen::Matrix<double, 4, 3> attributes;
      for (int k = 0; k < 3; ++k) {
        const auto index = static_cast<std::size_t>(triangle.v[k]);
        const Vertex& vertex = mesh.vertices[index];
        corners.col(k) = projected[index];
        attributes.col(k) << vertex.uv, vertex.light, 1;
      }
      draw(corners, attributes, triangle.texture);
    }
  }

  /// Homogeneous rasterisation (Olano and Greer 1997): corners^-1 (x, y, 1) are the barycentric
  /// weights divided by z, so only the bounding box needs clipping at the near plane.
  void draw(const Eigen::Matrix3d& corners, const Eigen::Matrix<double, 4, 3>& attributes,
            const Texture* texture) {
    if (corners.row(2).maxCoeff() < kNearPlane) return;
    Eigen::Array2d low(1e9, 1e9), high(-1e9, -1e9);
    const auto extend = [&](const Eigen::Vector3d& h) {
      low = low.min(h.head<2>().array() / h.z());
      high = high.max(h.head<2>().array() / h.z());
    };
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d a = corners.col(k), b = corners.col((k + 1) % 3);
      if (a.z() >= kNearPlane) extend(a);
      if ((a.z() < kNearPlane) != (b.z() < kNearPlane)) {
        extend(a + (b - a) * ((kNearPlane - a.z()) / (b.z() - a.z())));
      }
    }
    if (high.x() < -1 || high.y() < -1 || low.x() > camera_.width || low.y() > camera_.height) {
      return;
    }
    const TriangleExtent extent{
        std::max(0, firstSample(low.y())),
        std::min(kSamplesPerSide * camera_.height - 1, lastSample(high.y(), camera_.height)),
        low.x(), high.x()};
    if (extent.y0 > extent.y1 || firstSample(low.x()) > lastSample(high.x(), camera_.width)) return;
    bool invertible = false;
    Eigen::Matrix3d weights;
    corners.computeInverseWithCheck(weights, invertible, 1e-9);
    if (!invertible) return;  // seen edge-on

    const auto id = static_cast<std::int32_t>(surfaces_.size());
    surfaces_.push_back({attributes * weights, texture});
    drawTriangle(weights, surfaces_.back().over_z.row(3), extent, camera_.width, id,
                 inverse_depth_.data(), id_.data());
  }

  float shadePixel(int x, int y) const {
    constexpr int kSamples = kSamplesPerSide * kSamplesPerSide;
    std::array<std::int32_t, kSamples> ids;
    for (int k = 0; k < kSamples; ++k) {
      const int i = kSamplesPerSide * x + k % kSamplesPerSide,
                j = kSamplesPerSide * y + k / kSamplesPerSide;
      ids[static_cast<std::size_t>(k)] = id_[static_cast<std::size_t>(j * width_ + i)];
    }
    if (std::all_of(ids.begin() + 1, ids.end(), [&](std::int32_t id) { return id == ids[0]; })) {
      return shadeSurface(ids[0], {x, y});
    }
    float sum = 0;
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (std::find(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(k), ids[k]) !=
          ids.begin() + static_cast<std::ptrdiff_t>(k)) {
        continue;  // this surface is already shaded
      }
      int count = 0;
      Eigen::Vector2d centre(0, 0);  // of the samples that show it
      for (std::size_t m = k; m < ids.size(); ++m) {
        if (ids[m] != ids[k]) continue;
        ++count;
        const int s = static_cast<int>(m);
        centre += Eigen::Vector2d(position(kSamplesPerSide * x + s % kSamplesPerSide),
                                  position(kSamplesPerSide * y + s / kSamplesPerSide));
      }
      centre /= count;
      sum += shadeSurface(ids[k], centre) * static_cast<float>(count);
    }
    return sum / kSamples;
  }

  float shadeSurface(std::int32_t id, const Eigen::Vector2d& u) const {
    return id == kSky ? sky(u) : surface(surfaces_[static_cast<std::size_t>(id)], u);
  }

  float sky(const Eigen::Vector2d& u) const {
    const Eigen::Vector3d ray = R_w_c_ * camera_.ray(u);
    const double azimuth = std::atan2(ray.y(), ray.x());
    const double elevation = std::atan2(ray.z(), std::hypot(ray.x(), ray.y()));
    const float day = scene_.sky->sample(
        {azimuth + kSkyRotation, std::clamp(kSkyTop - elevation, 0.0, kSkyHeight)},
        Eigen::Matrix2d::Identity() / camera_.fx);
    return scene_.daylight < 1 ? day * static_cast<float>(ambient_) : day;
  }

  float surface(const Surface& s, const Eigen::Vector2d& u) const {
    const Eigen::Vector4d a = s.over_z * u.homogeneous();
    const double z = 1 / a(3);
    const Eigen::Vector2d uv = a.head<2>() * z;
    const Eigen::Matrix2d J =
        (s.over_z.topLeftCorner<2, 2>() - uv * s.over_z.bottomLeftCorner<1, 2>()) * z;
    double light = a(2) * z;
    if (s.texture == scene_.road) light *= boxShadows(uv) * egoShadow(uv);
    if (scene_.daylight < 1) light *= nightGain(s, z * camera_.ray(u));
    const double clear = std::exp(-z / kHazeDistance);
    const double haze = kHazeGrey * ambient_;
    double grey = s.texture->sample(uv, J) * light;
    if (scene_.road_detail && s.texture == scene_.road)
      grey *= scene_.road_detail->sample(uv, J) / 128;
    if (s.texture == scene_.hood) grey = hoodReflection(grey, u);
    if (reflection_ && s.texture == scene_.road) grey = puddleReflection(grey, uv, J, u);
    return static_cast<float>(grey * clear + haze * (1 - clear));
  }

  /// Grey level of the curved hood: its far edge reflects the horizon, its near part the zenith.
  double hoodReflection(double paint, const Eigen::Vector2d& u) const {
    const double height = camera_.height * scene_.hood_share;
    const double rise = std::clamp((camera_.height - u.y()) / height, 0.0, 1.0);
    const double edge = camera_.height - height;  // the hood does not reflect itself
    const double row = rise * std::clamp(0.95 * camera_.cy, 0.0, edge - 2);
    return 0.7 * paint + 0.35 * shadePixel(static_cast<int>(std::lround(u.x())),
                                           static_cast<int>(std::lround(row)));
  }

  /// Grey level of the road with puddles: wet asphalt is darker and reflects at grazing angles.
  double puddleReflection(double grey, const Eigen::Vector2d& uv, const Eigen::Matrix2d& J,
                          const Eigen::Vector2d& u) const {
    if (uv.x() < scene_.puddles_from || uv.x() > scene_.puddles_to) return grey;
    const double water = scene_.puddles->sample(uv, J) / 255;
    if (water <= 0) return grey;
    const double cos_incidence = std::abs((R_w_c_ * camera_.ray(u).normalized()).z());
    const double reflectance = 0.02 + 0.98 * std::pow(1 - cos_incidence, 5);  // Schlick, water
    const double seen = reflection_->shadePixel(static_cast<int>(std::lround(u.x())),
                                                static_cast<int>(std::lround(u.y())));
    const double pool = 0.6 * grey * (1 - reflectance) + seen * reflectance;
    return grey + water * (pool - grey);
  }

  /// Factor on the daylight grey level of the surface at p_c.
  double nightGain(const Surface& s, const Eigen::Vector3d& p_c) const {
    const Eigen::Vector3d p_l = T_l_c_ * p_c;
    const Eigen::Vector3d n_l =
        T_l_c_.linear() * (K_.transpose() * s.over_z.row(3).transpose()).normalized();
    double light = scene_.daylight;
    for (const double side : {-0.5, 0.5}) {
      const Eigen::Vector3d ray = p_l - Eigen::Vector3d(side * kLampSpacing, 0, 0);
      if (ray.z() <= 0) continue;
      const double distance = ray.norm(), across = std::atan2(ray.x(), ray.z()) / kBeamWidth;
      const double below = std::atan2(ray.y(), ray.z()) - kCutOffAngle;
      const double below_cut_off = smoothStep(0.5 + below / kCutOffSoftness);
      const double beam =
          std::exp(-across * across) *
          (kStrayLight + below_cut_off * std::exp(-std::max(below, 0.0) / kBeamHeight));
      light += kLampIntensity / 2 * beam * std::abs(n_l.dot(ray)) / std::pow(distance, 3);
    }
    return std::min(std::pow(light, kNightGamma), kMaxNightGain);
  }

  /// Factor on the light in the shadows of moving vehicles.
  double boxShadows(const Eigen::Vector2d& uv) const {
    double light = 1;
    for (const BoxShadow& shadow : scene_.box_shadows) {
      const Eigen::Array2d outside = ((uv - shadow.centre).cwiseAbs() - shadow.half_size).array();
      light *= 1 - kBoxShadowDepth * smoothStep(0.5 - outside.x() / kBoxShadowEdge) *
                       smoothStep(0.5 - outside.y() / kBoxShadowEdge);
    }
    return light;
  }

  /// Factor on the light in the shadow of the ego vehicle.
  double egoShadow(const Eigen::Vector2d& uv) const {
    if (scene_.ego_shadow.empty()) return 1;
    double inside = 1e9;
    for (const Eigen::Vector3d& edge : scene_.ego_shadow) {
      inside = std::min(inside, edge.dot(uv.homogeneous()));
    }
    return 1 - kEgoShadowDepth * smoothStep(0.5 + inside / kEgoShadowEdge);
  }

  const Scene& scene_;
  const PinholeCamera& camera_;
  const Eigen::Isometry3d T_c_w_;
  const Eigen::Matrix3d R_w_c_;
  const Rasteriser* reflection_;
  const double ambient_;           // factor on the daylight grey level where no lamp shines
  const Eigen::Isometry3d T_l_c_;  // lamps from camera
  Eigen::Matrix3d K_;
  int width_ = 0;                     // in samples
  std::vector<float> inverse_depth_;  // of every sample [1/m]
  std::vector<std::int32_t> id_;      // of the surface that every sample shows
  std::vector<Surface> surfaces_;
};

}  // namespace

cv::Mat render(const Scene& scene, const PinholeCamera& camera, const Eigen::Isometry3d& T_w_c) {
  if (!scene.puddles) return Rasteriser(scene, camera, T_w_c, nullptr).shade();
  // The reflection in the plane z = 0 is, in the same pixels, the upside-down image of a camera
  // below that plane.
  Scene reflected = scene;
  reflected.puddles = nullptr;
  reflected.instances.clear();
  for (const Instance& instance : scene.instances) {
    if (instance.reflected) reflected.instances.push_back(instance);
  }
  Eigen::Isometry3d T_w_below = T_w_c;
  T_w_below.matrix().row(2) *= -1;
  const Rasteriser reflection(reflected, camera, T_w_below, nullptr);
  return Rasteriser(scene, camera, T_w_c, &reflection).shade();
}

}  // namespace gsv::simulation
