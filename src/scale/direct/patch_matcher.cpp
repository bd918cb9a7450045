#include "scale/direct/patch_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/vector_loop.hpp"

namespace ground_scale_vo::direct {
namespace {

/// Least share of a patch's gradient energy along the epipolar line (as an amplitude). Below it the
/// shift along the line is not observable.
constexpr float kMinGradientAlongLine = 0.2f;
/// [normalised intensity squared] Least variance of a residual: interpolation and quantisation.
constexpr float kMinResidualVariance = 0.01f;
/// [standard deviations] Tuning constant of the Cauchy weights; 2.385 has 95 % efficiency for
/// normal errors, less rejects more.
constexpr float kSampleCauchyConstant = 2;

/// Sums over the samples of a patch from which Match's derivatives follow.
struct Moments {
  float mean = 0, squares = 0;  ///< of the Jacobian by q
  Vector5f motion_mean = Vector5f::Zero(), motion = Vector5f::Zero();
  Eigen::Vector2f gradient_mean{0, 0};  ///< of the intensity by the position in the image
  float gradient_squares = 0;
  float flow_squares = 0;  ///< of the position by q: the epipolar flow
};

/// The stored part of an image: pinhole camera and limits [px of the part].
struct RoiCamera {
  float fx, fy, cx, cy, right, bottom;
};

/// Pixels u, v of the points A (ray_x, ray_y, 1). Returns how many are in front of the camera and
/// in [0, right) x [0, bottom); values that are not finite are outside.
GSV_VECTOR_LOOP int project(const RoiCamera& camera, const Eigen::Matrix3f& A,
                            const float* __restrict ray_x, const float* __restrict ray_y,
                            float* __restrict u, float* __restrict v) {
  const auto [fx, fy, cx, cy, right, bottom] = camera;
  const float a = A(0, 0), b = A(0, 1), c = A(0, 2), d = A(1, 0), e = A(1, 1), f = A(1, 2),
              g = A(2, 0), h = A(2, 1), k = A(2, 2);
  int inside = 0;
  for (int i = 0; i < kPatchSamples; ++i) {
    const float z = g * ray_x[i] + h * ray_y[i] + k;
    u[i] = fx * (a * ray_x[i] + b * ray_y[i] + c) / z + cx;
    v[i] = fy * (d * ray_x[i] + e * ray_y[i] + f) / z + cy;
    inside += (z > 0) & (u[i] >= 0) & (v[i] >= 0) & (u[i] < right) & (v[i] < bottom);
  }
  return inside;
}

/// Bilinear, at pixels inside.
GSV_VECTOR_LOOP void interpolate(const float* __restrict data, int stride,
                                 const float* __restrict u, const float* __restrict v,
                                 float* __restrict values) {
  for (int i = 0; i < kPatchSamples; ++i) {
    const auto left = static_cast<int>(u[i]), above = static_cast<int>(v[i]);
    const float a = u[i] - static_cast<float>(left), b = v[i] - static_cast<float>(above);
    const int upper = above * stride + left, lower = upper + stride;
    const float in_upper = data[upper] + a * (data[upper + 1] - data[upper]);
    const float in_lower = data[lower] + a * (data[lower + 1] - data[lower]);
    values[i] = in_upper + b * (in_lower - in_upper);
  }
}

}  // namespace

PatchMatcher::PatchMatcher(const PinholeCamera& camera, double image_noise, const cv::Mat& allowed)
    : camera_(camera), image_noise_(static_cast<float>(image_noise)), allowed_(allowed) {}

/// u, v: of the samples [px of the roi].
bool PatchMatcher::isAllowed(const RoadImage& image, const Samples& u, const Samples& v) const {
  if (allowed_.empty()) return true;
  const cv::Mat allowed = allowed_(image.roi);
  for (int i = 0; i < kPatchSamples; ++i) {
    if (allowed.at<unsigned char>(static_cast<int>(v[i]), static_cast<int>(u[i])) == 0) {
      return false;
    }
  }
  return true;
}

bool PatchMatcher::sample(const Reference& reference, const Patch& patch, const Eigen::Vector3f& m,
                          Samples* values) const {
  const RoadImage& image = *reference.image;
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const RoiCamera camera{static_cast<float>(camera_.fx),
                         static_cast<float>(camera_.fy),
                         static_cast<float>(camera_.cx - image.roi.x),
                         static_cast<float>(camera_.cy - image.roi.y),
                         static_cast<float>(image.roi.width - 1),
                         static_cast<float>(image.roi.height - 1)};
  Samples u, v;
  const int inside = project(camera, A, patch.ray_x.data(), patch.ray_y.data(), u.data(), v.data());
  if (inside < kPatchSamples || !isAllowed(image, u, v)) return false;
  interpolate(image.storage.ptr<float>(), static_cast<int>(image.storage.step1()), u.data(),
              v.data(), values->data());
  return true;
}

void PatchMatcher::linearise(const Reference& reference, const Patch& patch,
                             const Eigen::Vector3f& m, Match* match) const {
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const auto fx = static_cast<float>(camera_.fx), fy = static_cast<float>(camera_.fy);
  const Samples& ray_x = patch.ray_x;
  const Samples& ray_y = patch.ray_y;
  // y = A r of the rays r, and its projection.
  const Samples y_x = A(0, 0) * ray_x + (A(0, 1) * ray_y + A(0, 2));
  const Samples y_y = A(1, 0) * ray_x + (A(1, 1) * ray_y + A(1, 2));
  const Samples z = A(2, 0) * ray_x + (A(2, 1) * ray_y + A(2, 2));
  const Samples xn = y_x / z, yn = y_y / z;
  // Jacobian of the homography on the image plane, and its inverse transpose on the gradient.
  const Samples a = (A(0, 0) - xn * A(2, 0)) / z, b = (A(0, 1) - xn * A(2, 1)) / z;
  const Samples c = (A(1, 0) - yn * A(2, 0)) / z, d = (A(1, 1) - yn * A(2, 1)) / z;
  const Samples determinant = a * d - b * c;
  const Samples gx = patch.grad_x * fx, gy = patch.grad_y * fy;
  const Samples hx = (d * gx - c * gy) / (determinant * z);
  const Samples hy = (a * gy - b * gx) / (determinant * z);
  // Derivative of the intensity by y = R r - t q, then by q, the rotation and the direction of t.
  const Samples hz = -hx * xn - hy * yn;
  const auto along = [&](const Eigen::Vector3f& direction) -> Samples {
    return hx * direction.x() + (hy * direction.y() + hz * direction.z());
  };
  const Samples q = m.x() * ray_x + (m.y() * ray_y + m.z());
  match->jacobian = -along(reference.t);
  const Samples by_motion[] = {y_y * hz - z * hy, z * hx - y_x * hz, y_x * hy - y_y * hx,
                               -q * along(reference.perpendicular[0]),
                               -q * along(reference.perpendicular[1])};
  const Samples gradient_x = hx * z / kPatchSamples, gradient_y = hy * z / kPatchSamples;
  const Samples gradient_squares = (hx * hx + hy * hy) * z * z;
  const Samples flow_squares = ((xn * reference.t.z() - reference.t.x()).square() +
                                (yn * reference.t.z() - reference.t.y()).square()) /
                               (z * z * kPatchSamples);

  Moments sum;
  for (int i = 0; i < kPatchSamples; ++i) {
    const float j = match->jacobian[i];
    sum.gradient_mean += Eigen::Vector2f(gradient_x[i], gradient_y[i]);
    sum.gradient_squares += gradient_squares[i];
    sum.flow_squares += flow_squares[i];
    sum.mean += j / kPatchSamples;
    sum.squares += j * j;
    for (int k = 0; k < 5; ++k) {
      sum.motion_mean[k] += by_motion[k][i] / kPatchSamples;
      sum.motion[k] += j * by_motion[k][i];
    }
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
  const float scale = kPatchSamples / (kSampleCauchyConstant * kSampleCauchyConstant *
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
