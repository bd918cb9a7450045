#include "scale/direct/patch_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/lanes.hpp"
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
  int upper_left[kPatchSamples];
  float a[kPatchSamples], b[kPatchSamples];
  for (int i = 0; i < kPatchSamples; ++i) {
    const auto left = static_cast<int>(u[i]), above = static_cast<int>(v[i]);
    a[i] = u[i] - static_cast<float>(left);
    b[i] = v[i] - static_cast<float>(above);
    upper_left[i] = above * stride + left;
  }
  // Two neighbours are read at once: AVX2's gather instructions read them one by one, and take
  // longer.
  float upper[2 * kPatchSamples], lower[2 * kPatchSamples];
  for (int i = 0; i < kPatchSamples; ++i) {
    std::memcpy(upper + 2 * i, data + upper_left[i], 2 * sizeof(float));
    std::memcpy(lower + 2 * i, data + upper_left[i] + stride, 2 * sizeof(float));
  }
  for (int i = 0; i < kPatchSamples; ++i) {
    const float in_upper = upper[2 * i] + a[i] * (upper[2 * i + 1] - upper[2 * i]);
    const float in_lower = lower[2 * i] + a[i] * (lower[2 * i + 1] - lower[2 * i]);
    values[i] = in_upper + b[i] * (in_lower - in_upper);
  }
}

/// residual: expected - values. Returns the sum of its squares.
GSV_VECTOR_LOOP float subtract(const float* expected, const float* values,
                               float* __restrict residual) {
  Lanes squares{};
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) {
    const Lanes difference = lanes(expected + i) - lanes(values + i);
    lanes(residual + i) = difference;
    squares += difference * difference;
  }
  return total(squares);
}

/// Weighted sums over the samples of a patch, with Cauchy weights.
struct ShiftSums {
  float weights = 0, squares = 0;   ///< of the residual
  float information = 0, step = 0;  ///< J^T J and J^T r of the Jacobian by q
  float ray_x = 0, ray_y = 0;       ///< of the rays, by their information
};

/// scale: 1 over the square of the residual of half the weight.
GSV_VECTOR_LOOP ShiftSums sumShift(const float* residual, const float* jacobian, const float* ray_x,
                                   const float* ray_y, float scale) {
  Lanes weights{}, squares{}, information{}, step{}, x{}, y{};
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) {
    const Lanes r = lanes(residual + i), j = lanes(jacobian + i);
    const Lanes weight = 1 / (1 + r * r * scale);
    const Lanes wj = weight * j, wjj = wj * j;
    weights += weight;
    squares += weight * r * r;
    information += wjj;
    step += wj * r;
    x += wjj * lanes(ray_x + i);
    y += wjj * lanes(ray_y + i);
  }
  return {total(weights), total(squares), total(information), total(step), total(x), total(y)};
}

/// Sums over the samples of a patch from which Match's derivatives follow.
struct Moments {
  Lanes mean{}, squares{};  ///< of the Jacobian by q
  Lanes motion_mean[5] = {}, motion[5] = {};
  Lanes gradient_x{}, gradient_y{}, gradient_squares{};  ///< of the intensity by the position
  Lanes flow_squares{};  ///< of the position by q: the epipolar flow
};

/// A direction, the same for all samples.
struct Vector {
  explicit Vector(const Eigen::Vector3f& v) : x(v.x()), y(v.y()), z(v.z()) {}
  float x, y, z;
};

/// Sets the Jacobian by q, and its sums. A: homography; focal lengths [px].
GSV_VECTOR_LOOP Moments differentiate(const Patch& patch, const Reference& reference,
                                      const Eigen::Matrix3f& A, const Eigen::Vector3f& plane,
                                      float fx, float fy, float* __restrict jacobian) {
  const Vector m(plane), t(reference.t), s1(reference.perpendicular[0]),
      s2(reference.perpendicular[1]), row_x(A.row(0)), row_y(A.row(1)), row_z(A.row(2));
  Moments sum;
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) {
    const Lanes ray_x = lanes(patch.ray_x.data() + i), ray_y = lanes(patch.ray_y.data() + i);
    // y = A r of the rays r, and its projection.
    const Lanes y_x = row_x.x * ray_x + row_x.y * ray_y + row_x.z;
    const Lanes y_y = row_y.x * ray_x + row_y.y * ray_y + row_y.z;
    const Lanes z = row_z.x * ray_x + row_z.y * ray_y + row_z.z;
    const Lanes inverse_z = 1 / z;
    const Lanes xn = y_x * inverse_z, yn = y_y * inverse_z;
    // Jacobian of the homography on the image plane, times z, and its inverse transpose on the
    // gradient.
    const Lanes a = row_x.x - xn * row_z.x, b = row_x.y - xn * row_z.y;
    const Lanes c = row_y.x - yn * row_z.x, d = row_y.y - yn * row_z.y;
    const Lanes inverse_determinant = 1 / (a * d - b * c);
    const Lanes gx = lanes(patch.grad_x.data() + i) * fx, gy = lanes(patch.grad_y.data() + i) * fy;
    const Lanes hx = (d * gx - c * gy) * inverse_determinant;
    const Lanes hy = (a * gy - b * gx) * inverse_determinant;
    // Derivative of the intensity by y = R r - t q, then by q, the rotation and the direction of t.
    const Lanes hz = -hx * xn - hy * yn;
    const Lanes q = m.x * ray_x + m.y * ray_y + m.z;
    const Lanes by_q = -(hx * t.x + hy * t.y + hz * t.z);
    const Lanes by_motion[] = {y_y * hz - z * hy, z * hx - y_x * hz, y_x * hy - y_y * hx,
                               -q * (hx * s1.x + hy * s1.y + hz * s1.z),
                               -q * (hx * s2.x + hy * s2.y + hz * s2.z)};
    lanes(jacobian + i) = by_q;
    sum.mean += by_q;
    sum.squares += by_q * by_q;
    for (int k = 0; k < 5; ++k) {
      sum.motion_mean[k] += by_motion[k];
      sum.motion[k] += by_q * by_motion[k];
    }
    const Lanes by_x = hx * z, by_y = hy * z;
    sum.gradient_x += by_x;
    sum.gradient_y += by_y;
    sum.gradient_squares += by_x * by_x + by_y * by_y;
    const Lanes flow_x = (xn * t.z - t.x) * inverse_z, flow_y = (yn * t.z - t.y) * inverse_z;
    sum.flow_squares += flow_x * flow_x + flow_y * flow_y;
  }
  return sum;
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

/// Between the cameras at the exposure of the patch in both images.
PatchMatcher::Warp PatchMatcher::warpOf(const Reference& reference, const Patch& patch,
                                        const Eigen::Vector3f& m) const {
  Warp warp{reference, m, reference.R - reference.t * m.transpose()};
  if (reference.readout_motion_c.isZero(0)) return warp;
  const Vector6d &motion_c = reference.readout_motion_c,
                 &motion_r = reference.image->readout_motion;
  const auto shareOf = [&](const Eigen::Vector3d& p) {
    return camera_.readoutShare(camera_.project(p).y());
  };
  const Eigen::Vector3d ray(patch.ray_x.mean(), patch.ray_y.mean(), 1);
  const double share_c = shareOf(ray);
  const Eigen::Isometry3d T_c_row = motionFrom(share_c * motion_c);
  // The points x of the plane have m . x = -1.
  const Eigen::Vector3d m_c = m.cast<double>();
  const Eigen::Vector3d m_row =
      T_c_row.linear().transpose() * m_c / (1 + m_c.dot(T_c_row.translation()));
  const double inverse_depth = -m_row.dot(ray);
  Eigen::Isometry3d T_r_c = Eigen::Isometry3d::Identity();
  T_r_c.linear() = reference.R.cast<double>();
  T_r_c.translation() = reference.t.cast<double>();
  double share_r = share_c;
  Eigen::Vector3d p_r;           // the centre of the patch, times its inverse depth
  for (int i = 0; i < 3; ++i) {  // the row in the reference image depends on the pose of that row
    const Eigen::Isometry3d T_r_row = motionFrom(share_r * motion_r);
    const Eigen::Isometry3d T_row_row = T_r_row.inverse() * T_r_c * T_c_row;
    warp.reference.setMotion(T_row_row);
    p_r = T_row_row.linear() * ray + inverse_depth * T_row_row.translation();
    if (!(p_r.z() > 0)) return warp;
    share_r = std::clamp(shareOf(p_r), -0.5, 0.5);
  }
  warp.m = m_row.cast<float>();
  warp.A = warp.reference.R - warp.reference.t * warp.m.transpose();
  return warp;
}

bool PatchMatcher::sample(const Reference& reference, const Patch& patch, const Eigen::Vector3f& m,
                          Samples* values) const {
  const RoadImage& image = *reference.image;
  const Warp warp = warpOf(reference, patch, m);
  const RoiCamera camera{static_cast<float>(camera_.fx),
                         static_cast<float>(camera_.fy),
                         static_cast<float>(camera_.cx - image.roi.x),
                         static_cast<float>(camera_.cy - image.roi.y),
                         static_cast<float>(image.roi.width - 1),
                         static_cast<float>(image.roi.height - 1)};
  Samples u, v;
  const int inside =
      project(camera, warp.A, patch.ray_x.data(), patch.ray_y.data(), u.data(), v.data());
  if (inside < kPatchSamples || !isAllowed(image, u, v)) return false;
  interpolate(image.storage.ptr<float>(), static_cast<int>(image.storage.step1()), u.data(),
              v.data(), values->data());
  return true;
}

void PatchMatcher::linearise(const Reference& reference, const Patch& patch,
                             const Eigen::Vector3f& m, Match* match) const {
  const Warp warp = warpOf(reference, patch, m);
  const Moments sum =
      differentiate(patch, warp.reference, warp.A, warp.m, static_cast<float>(camera_.fx),
                    static_cast<float>(camera_.fy), match->jacobian.data());
  const float mean = total(sum.mean) / kPatchSamples;
  match->jacobian -= mean;
  const float information =
      std::max(total(sum.squares) - kPatchSamples * mean * mean, std::numeric_limits<float>::min());
  const float gradient_x = total(sum.gradient_x), gradient_y = total(sum.gradient_y);
  const float gradient_energy = total(sum.gradient_squares) -
                                (gradient_x * gradient_x + gradient_y * gradient_y) / kPatchSamples;
  match->observable = information > kMinGradientAlongLine * kMinGradientAlongLine *
                                        total(sum.flow_squares) / kPatchSamples * gradient_energy;
  for (int k = 0; k < 5; ++k) {
    match->motion[k] = (total(sum.motion[k]) - mean * total(sum.motion_mean[k])) / information;
  }
}

void PatchMatcher::measure(const Reference& reference, const Patch& patch, const Eigen::Vector3f& m,
                           Match* match) const {
  Samples values;
  match->valid = sample(reference, patch, m, &values);
  if (!match->valid) return;
  match->correlation = correlate(patch, image_noise_, &values);
  Samples residual;
  const float squares = subtract(patch.value.data(), values.data(), residual.data());
  const float scale = kPatchSamples / (kSampleCauchyConstant * kSampleCauchyConstant *
                                       std::max(squares, kMinResidualVariance));
  const ShiftSums sum = sumShift(residual.data(), match->jacobian.data(), patch.ray_x.data(),
                                 patch.ray_y.data(), scale);
  match->valid = match->observable && sum.information > 0;
  match->shift = sum.step / sum.information;
  match->variance = (sum.squares / sum.weights + kMinResidualVariance) / sum.information;
  match->ray = Eigen::Vector3f(sum.ray_x / sum.information, sum.ray_y / sum.information, 1.f);
}

}  // namespace ground_scale_vo::direct
