#include "scale/direct/patch_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ground_scale_vo::direct {
namespace {

/// Least share of a patch's gradient energy along the epipolar line (as an amplitude). Below it the
/// shift along the line is not observable.
constexpr float kMinGradientAlongLine = 0.2f;
/// [normalised intensity squared] Least variance of a residual: interpolation and quantisation.
constexpr float kMinResidualVariance = 0.01f;
/// [standard deviations] Tuning constant of the Cauchy weights; 2.385 has 95 % efficiency for
/// normal errors, less rejects more.
constexpr float kCauchyConstant = 2;

/// Sums over the samples of a patch from which Match's derivatives follow.
struct Moments {
  float mean = 0, squares = 0;  ///< of the Jacobian by q
  Vector5f motion_mean = Vector5f::Zero(), motion = Vector5f::Zero();
  Eigen::Vector2f gradient_mean{0, 0};  ///< of the intensity by the position in the image
  float gradient_squares = 0;
  float flow_squares = 0;  ///< of the position by q: the epipolar flow
};

}  // namespace

PatchMatcher::PatchMatcher(const PinholeCamera& camera, double image_noise)
    : camera_(camera), image_noise_(static_cast<float>(image_noise)) {}

bool PatchMatcher::sample(const Reference& reference, const Patch& patch, const Eigen::Vector3f& m,
                          Samples* values) const {
  const RoadImage& image = *reference.image;
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const auto fx = static_cast<float>(camera_.fx), fy = static_cast<float>(camera_.fy);
  const auto cx = static_cast<float>(camera_.cx - image.roi.x);
  const auto cy = static_cast<float>(camera_.cy - image.roi.y);
  const auto right = static_cast<float>(image.roi.width - 1);
  const auto bottom = static_cast<float>(image.roi.height - 1);
  const float* const data = image.storage.ptr<float>();
  const auto stride = static_cast<std::ptrdiff_t>(image.storage.step1());
  const Samples z = A(2, 0) * patch.ray_x + A(2, 1) * patch.ray_y + A(2, 2);
  if (!(z > 0).all()) return false;  // also when not finite
  const Samples u = fx * (A(0, 0) * patch.ray_x + A(0, 1) * patch.ray_y + A(0, 2)) / z + cx;
  const Samples v = fy * (A(1, 0) * patch.ray_x + A(1, 1) * patch.ray_y + A(1, 2)) / z + cy;
  if (!(u >= 0 && v >= 0 && u < right && v < bottom).all()) return false;
  for (int i = 0; i < kPatchSamples; ++i) {
    const auto left = static_cast<int>(u[i]), above = static_cast<int>(v[i]);
    const float a = u[i] - static_cast<float>(left), b = v[i] - static_cast<float>(above);
    const float* p = data + above * stride + left;
    const float upper = p[0] + a * (p[1] - p[0]);
    const float lower = p[stride] + a * (p[stride + 1] - p[stride]);
    (*values)[i] = upper + b * (lower - upper);
  }
  return true;
}

void PatchMatcher::linearise(const Reference& reference, const Patch& patch,
                             const Eigen::Vector3f& m, Match* match) const {
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const auto fx = static_cast<float>(camera_.fx), fy = static_cast<float>(camera_.fy);
  Moments sum;
  for (int i = 0; i < kPatchSamples; ++i) {
    const Eigen::Vector3f ray(patch.ray_x[i], patch.ray_y[i], 1.f);
    const Eigen::Vector3f y = A * ray;
    const float z = y.z(), xn = y.x() / z, yn = y.y() / z;
    // Jacobian of the homography on the image plane, and its inverse transpose on the gradient.
    const float a = (A(0, 0) - xn * A(2, 0)) / z, b = (A(0, 1) - xn * A(2, 1)) / z;
    const float c = (A(1, 0) - yn * A(2, 0)) / z, d = (A(1, 1) - yn * A(2, 1)) / z;
    const float determinant = a * d - b * c;
    const float gx = patch.grad_x[i] * fx, gy = patch.grad_y[i] * fy;
    const float hx = (d * gx - c * gy) / (determinant * z);
    const float hy = (a * gy - b * gx) / (determinant * z);
    // Derivative of the intensity by y = R r - t q, then by q, the rotation and the direction of t.
    const Eigen::Vector3f by_y(hx, hy, -hx * xn - hy * yn);
    const float j = -by_y.dot(reference.t);
    const float q = m.dot(ray);
    Vector5f by_motion;
    const Eigen::Vector3f by_rotation = y.cross(by_y);
    by_motion << by_rotation.x(), by_rotation.y(), by_rotation.z(),
        -q * by_y.dot(reference.perpendicular[0]), -q * by_y.dot(reference.perpendicular[1]);
    match->jacobian[i] = j;
    sum.gradient_mean += Eigen::Vector2f(hx, hy) * z / kPatchSamples;
    sum.gradient_squares += (hx * hx + hy * hy) * z * z;
    sum.flow_squares +=
        (Eigen::Vector2f(xn, yn) * reference.t.z() - reference.t.head<2>()).squaredNorm() /
        (z * z * kPatchSamples);
    sum.mean += j / kPatchSamples;
    sum.squares += j * j;
    sum.motion_mean += by_motion / kPatchSamples;
    sum.motion += j * by_motion;
  }
  match->jacobian -= sum.mean;
  const float information = std::max(sum.squares - kPatchSamples * sum.mean * sum.mean,
                                     std::numeric_limits<float>::min());
  match->observable =
      information > kMinGradientAlongLine * kMinGradientAlongLine * sum.flow_squares *
                        (sum.gradient_squares - kPatchSamples * sum.gradient_mean.squaredNorm());
  match->motion = (sum.motion - kPatchSamples * sum.mean * sum.motion_mean) / information;
}

void PatchMatcher::measure(const Reference& reference, const Patch& patch, const Eigen::Vector3f& m,
                           Match* match) const {
  Samples values;
  match->valid = sample(reference, patch, m, &values);
  if (!match->valid) return;
  match->correlation = correlate(patch, image_noise_, &values);
  const Samples residual = patch.value - values;
  const Samples squares = residual.square();
  const float scale = kPatchSamples / (kCauchyConstant * kCauchyConstant *
                                       std::max(squares.sum(), kMinResidualVariance));
  const Samples weight = 1 / (1 + squares * scale);
  const Samples wj = weight * match->jacobian;
  const Samples wjj = wj * match->jacobian;
  const float information = wjj.sum();
  match->valid = match->observable && information > 0;
  match->shift = (wj * residual).sum() / information;
  match->variance = ((weight * squares).sum() / weight.sum() + kMinResidualVariance) / information;
  match->ray = Eigen::Vector3f((wjj * patch.ray_x).sum() / information,
                               (wjj * patch.ray_y).sum() / information, 1.f);
}

}  // namespace ground_scale_vo::direct
