#include "ground_scale_vo/vo/patch_alignment.hpp"

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "ground_scale_vo/error.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kMaxWindow = 21;
constexpr double kProbe_px = 2;          // step of the numeric derivative of the warp
constexpr float kConverged_px = 0.003f;  // last step
constexpr float kMinCornerness = 1e-3f;  // determinant over squared trace of the gradient matrix
constexpr double kMinAreaRatio = 0.1;    // of a patch in the two images, and its inverse

/// The four pixels around a place and their bilinear weights. Precondition: inside the image.
struct Bilinear {
  Bilinear(float x, float y) : column(static_cast<int>(x)), row(static_cast<int>(y)) {
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
    weight = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  }
  float operator()(const unsigned char* upper, const unsigned char* lower) const {
    return weight[0] * upper[0] + weight[1] * upper[1] + weight[2] * lower[0] +
           weight[3] * lower[1];
  }
  int column, row;
  std::array<float, 4> weight;
};

/// Everything of a patch with `margin` px around it lies where Bilinear can sample.
bool contains(const cv::Mat& image, const Eigen::Vector2f& u, float margin) {
  return u.x() >= margin && u.y() >= margin &&
         u.x() + margin < static_cast<float>(image.cols - 1) &&
         u.y() + margin < static_cast<float>(image.rows - 1);
}

/// The reference patch as the current image should show it, without its mean, and its gradients.
struct Template {
  std::array<float, kMaxWindow * kMaxWindow> grey, gx, gy;
  float variance = 0;  // times the number of pixels
  Eigen::Matrix2f inverse_hessian;

  /// False without a corner in it.
  bool make(const cv::Mat& reference, const Eigen::Vector2f& u_ref, const Eigen::Matrix2f& warp,
            int window) {
    const Eigen::Matrix2f inverse = warp.inverse();
    const int side = window + 2, half = side / 2;
    const float reach =
        static_cast<float>(half) * inverse.cwiseAbs().rowwise().sum().maxCoeff() + 1;
    if (!std::isfinite(reach) || !contains(reference, u_ref, reach)) return false;
    std::array<float, (kMaxWindow + 2) * (kMaxWindow + 2)> wide;
    for (int y = 0, i = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x, ++i) {
        const Eigen::Vector2f at = u_ref + inverse * Eigen::Vector2f(static_cast<float>(x - half),
                                                                     static_cast<float>(y - half));
        const Bilinear sample(at.x(), at.y());
        const unsigned char* upper = reference.ptr(sample.row) + sample.column;
        wide[static_cast<std::size_t>(i)] = sample(upper, upper + reference.step);
      }
    }
    float mean = 0, mean_x = 0, mean_y = 0;
    std::size_t n = 0;
    for (int y = 0; y < window; ++y) {
      for (int x = 0; x < window; ++x, ++n) {
        const float* centre = wide.data() + (y + 1) * side + x + 1;
        grey[n] = *centre;
        gx[n] = 0.5f * (centre[1] - centre[-1]);
        gy[n] = 0.5f * (centre[side] - centre[-side]);
        mean += grey[n];
        mean_x += gx[n];
        mean_y += gy[n];
      }
    }
    const float count = static_cast<float>(n);
    Eigen::Matrix2f hessian = Eigen::Matrix2f::Zero();
    variance = 0;
    for (std::size_t i = 0; i < n; ++i) {
      grey[i] -= mean / count;
      gx[i] -= mean_x / count;  // the mean of the current patch moves with it
      gy[i] -= mean_y / count;
      hessian(0, 0) += gx[i] * gx[i];
      hessian(0, 1) += gx[i] * gy[i];
      hessian(1, 1) += gy[i] * gy[i];
      variance += grey[i] * grey[i];
    }
    hessian(1, 0) = hessian(0, 1);
    const float trace = hessian.trace();
    if (variance < count || hessian.determinant() < kMinCornerness * trace * trace) return false;
    inverse_hessian = hessian.inverse();
    return true;
  }
};

}  // namespace

std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface) {
  const Eigen::Vector3d normal = Eigen::Vector3d::Unit(surface == PatchSurface::kFacing  ? 2
                                                       : surface == PatchSurface::kFloor ? 1
                                                                                         : 0);
  const Eigen::Vector3d p_c = T_c_r * p_r;
  const double distance = normal.dot(p_r);
  if (p_r.z() <= 0 || p_c.z() <= 0 || std::abs(distance) < 0.02 * p_r.norm()) return std::nullopt;
  const Eigen::Vector2d u_r = camera.project(p_r), u_c = camera.project(p_c);
  Eigen::Matrix2d warp;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector3d ray = camera.ray(u_r + kProbe_px * Eigen::Vector2d::Unit(axis));
    const double depth = distance / normal.dot(ray);
    const Eigen::Vector3d q = T_c_r * Eigen::Vector3d(depth * ray);
    if (!(depth > 0) || q.z() <= 0) return std::nullopt;
    warp.col(axis) = (camera.project(q) - u_c) / kProbe_px;
  }
  const double area = std::abs(warp.determinant());
  if (!(area > kMinAreaRatio && area < 1 / kMinAreaRatio)) return std::nullopt;
  return warp;
}

void PatchAlignment::Options::validate() const {
  describe(*this, RangeCheck("alignment/"));
  if (window_px % 2 == 0) throw OptionError("alignment/window_px must be odd");
}

PatchAlignment::PatchAlignment(const Options& options) : options_(options) { options_.validate(); }

std::optional<PatchAlignment::Match> PatchAlignment::align(const cv::Mat& reference,
                                                           const Eigen::Vector2d& u_ref,
                                                           const Eigen::Matrix2d& warp,
                                                           const cv::Mat& current,
                                                           const Eigen::Vector2d& start) const {
  const int window = options_.window_px, half = window / 2;
  Template patch;
  if (!patch.make(reference, u_ref.cast<float>(), warp.cast<float>(), window)) return std::nullopt;

  const Eigen::Vector2f first = start.cast<float>();
  const float max_shift = static_cast<float>(options_.max_shift_px);
  Eigen::Vector2f u = first;
  float correlation = -1;
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    // Some freedom on the way; the end has to be near.
    if (!((u - first).norm() < 2 * max_shift) || !contains(current, u, static_cast<float>(half))) {
      return std::nullopt;
    }
    const Bilinear sample(u.x() - static_cast<float>(half), u.y() - static_cast<float>(half));
    float sum = 0, squares = 0, product = 0;
    Eigen::Vector2f b = Eigen::Vector2f::Zero();
    std::size_t i = 0;
    for (int y = 0; y < window; ++y) {
      const unsigned char* upper = current.ptr(sample.row + y) + sample.column;
      const unsigned char* lower = upper + current.step;
      for (int x = 0; x < window; ++x, ++i) {
        const float grey = sample(upper + x, lower + x);
        sum += grey;
        squares += grey * grey;
        product += grey * patch.grey[i];
        b.x() += patch.gx[i] * (grey - patch.grey[i]);
        b.y() += patch.gy[i] * (grey - patch.grey[i]);
      }
    }
    const float variance = squares - sum * sum / static_cast<float>(i);
    correlation = product / std::sqrt(std::max(1e-3f, variance) * patch.variance);
    const Eigen::Vector2f step = patch.inverse_hessian * b;
    u -= step;
    if (step.norm() < kConverged_px) break;
  }
  if (!((u - first).norm() <= max_shift) || correlation < options_.min_correlation) {
    return std::nullopt;
  }
  return Match{u.cast<double>(), correlation};
}

}  // namespace ground_scale_vo
