#include "scale/patch_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace gsv::direct {
namespace {

/// [focal lengths] Standard deviation of the Gaussian that smooths the images: 0.7 px for KITTI.
constexpr double kBlur = 0.0010;
/// [px] A weaker blur leaves visible errors of the bilinear interpolation between pixels.
constexpr double kMinBlurPx = 0.6;
constexpr double kRadiusSigmas = 2.5;  ///< of the filter; 98.8 % of the Gaussian
/// [focal lengths] Margins around the lane region that are kept for later frames: the patches of a
/// later frame project outside the region after a turn (sides) or a change of pitch (top).
constexpr double kSideMargin = 0.12;
constexpr double kTopMargin = 0.04;

/// Least share of a patch's gradient energy along the epipolar line (as an amplitude). Below it the
/// shift along the line is not observable.
constexpr float kMinGradientAlongLine = 0.2f;
/// [normalised intensity squared] Least variance of a residual: interpolation and quantisation.
constexpr float kMinResidualVariance = 0.01f;
/// [standard deviations] Tuning constant of the Cauchy weights; 2.385 has 95 % efficiency for
/// normal errors, less rejects more.
constexpr float kSampleCauchyConstant = 2;
/// Lower bound of the product of two texture shares, keeps the correlation of uniform patches
/// finite.
constexpr float kMinTextureProduct = 1e-3f;

PinholeCamera reduced(const PinholeCamera& camera, int factor) {
  if (factor == 1) return camera;  // exactly
  PinholeCamera result = camera;
  result.width /= factor;
  result.height /= factor;
  result.fx /= factor;
  result.fy /= factor;
  // The centre of the first pixel is at 0.
  result.cx = (camera.cx + 0.5) / factor - 0.5;
  result.cy = (camera.cy + 0.5) / factor - 0.5;
  return result;
}

cv::Rect extended(const cv::Rect& area, int margin) {
  return {area.x - margin, area.y - margin, area.width + 2 * margin, area.height + 2 * margin};
}

/// Row `row` of H (ray_x, ray_y, 1) for all samples.
Samples transformed(const Eigen::Matrix3f& H, int row, const Patch& patch) {
  return H(row, 0) * patch.ray_x + H(row, 1) * patch.ray_y + H(row, 2);
}

Samples dot(const Eigen::Vector3f& v, const Samples& x, const Samples& y, const Samples& z) {
  return v.x() * x + v.y() * y + v.z() * z;
}

/// For all rays, x_r = R x_c + t for the points x_c of the plane m.
Eigen::Matrix3f homography(const Eigen::Isometry3d& T_r_c, const Eigen::Vector3d& m) {
  const Eigen::Matrix3d H = T_r_c.linear() - T_r_c.translation() * m.transpose();
  return H.cast<float>();
}

/// Pixels u, v of the points H (ray_x, ray_y, 1), counted from the corner of the roi. Returns how
/// many are in front of the camera and can be interpolated in the roi; values that are not finite
/// are outside.
GSV_VECTOR_LOOP int project(const PinholeCamera& camera, const cv::Rect& roi,
                            const Eigen::Matrix3f& H, const float* __restrict ray_x,
                            const float* __restrict ray_y, float* __restrict u,
                            float* __restrict v) {
  const auto fx = static_cast<float>(camera.fx), fy = static_cast<float>(camera.fy),
             cx = static_cast<float>(camera.cx - roi.x), cy = static_cast<float>(camera.cy - roi.y),
             right = static_cast<float>(roi.width - 1), bottom = static_cast<float>(roi.height - 1);
  const float a = H(0, 0), b = H(0, 1), c = H(0, 2), d = H(1, 0), e = H(1, 1), f = H(1, 2),
              g = H(2, 0), h = H(2, 1), k = H(2, 2);
  int inside = 0;
  for (int i = 0; i < kPatchSamples; ++i) {
    const float z = g * ray_x[i] + h * ray_y[i] + k;
    u[i] = fx * (a * ray_x[i] + b * ray_y[i] + c) / z + cx;
    v[i] = fy * (d * ray_x[i] + e * ray_y[i] + f) / z + cy;
    inside += (z > 0) & (u[i] >= 0) & (v[i] >= 0) & (u[i] < right) & (v[i] < bottom);
  }
  return inside;
}

/// Bilinear, at pixels u, v inside.
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

}  // namespace

float normalise(float noise, Samples* values, float* texture) {
  *values -= values->mean();
  const float variance = values->square().mean();
  const float deviation = std::sqrt(variance + noise * noise);
  *values /= deviation;
  *texture = variance / (variance + noise * noise);
  return deviation;
}

PatchMatcher::PatchMatcher(const PinholeCamera& camera, double patch_size, double image_noise,
                           const cv::Mat& mask)
    : reduction_(std::max(1, static_cast<int>(kBlur * camera.fx / kMinBlurPx))),
      image_noise_(static_cast<float>(image_noise)) {
  camera_ = reduced(camera, reduction_);
  patch_px_ = std::max(kPatchSide, static_cast<int>(std::lround(patch_size * camera_.fx)));
  sigma_ = std::max(kMinBlurPx, kBlur * camera_.fx);
  radius_ = static_cast<int>(std::ceil(kRadiusSigmas * sigma_));
  if (mask.empty()) return;
  const int reach = 2 * radius_ + 1;  // smoothed twice, with a gradient or an interpolation
  const int side = (reduction_ * (2 * reach + 1)) | 1;
  cv::Mat eroded;
  cv::erode(mask, eroded, cv::Mat::ones(side, side, CV_8U));
  cv::resize(eroded, allowed_, {camera_.width, camera_.height}, 0, 0, cv::INTER_NEAREST);
}

void PatchMatcher::extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards,
                           RoadImage* road, std::vector<Patch>* patches) const {
  selectCells(lane, road, patches);
  if (patches->empty()) return;
  const cv::Rect& roi = road->roi;
  const cv::Mat once = smoothed(image, roi);
  // The reference images show this piece of road from farther away, at a lower resolution. The
  // patches compared with them are smoothed a second time: a difference in sharpness would bias
  // their shifts. With a camera that faces backwards the reference images are the nearer ones.
  cv::Rect sampled;
  for (const Patch& patch : *patches) {
    sampled |= cv::Rect(patch.corner, cv::Size(patch_px_, patch_px_));
  }
  const cv::Rect area = faces_backwards ? roi : extended(sampled, 1) & roi;
  cv::Mat twice;
  cv::GaussianBlur(once(area - roi.tl()), twice, {2 * radius_ + 1, 2 * radius_ + 1}, sigma_);
  for (Patch& patch : *patches) samplePatch(faces_backwards ? once : twice, area.tl(), &patch);
  road->pixels = faces_backwards ? twice : once;
}

/// Creates the patches whose centre lies in the lane, and sets the part of the image to be stored.
void PatchMatcher::selectCells(const LaneRegion& lane, RoadImage* road,
                               std::vector<Patch>* patches) const {
  patches->clear();
  road->roi = cv::Rect();
  // Cells at the image border have no gradient there.
  for (int y = patch_px_; y + patch_px_ < camera_.height; y += patch_px_) {
    for (int x = patch_px_; x + patch_px_ < camera_.width; x += patch_px_) {
      const cv::Rect cell(x, y, patch_px_, patch_px_);
      const cv::Point centre = (cell.tl() + cell.br()) / 2;
      if (!lane.contains(camera_.ray({centre.x, centre.y}))) continue;
      if (!allowed_.empty() && cv::countNonZero(allowed_(cell)) < cell.area()) continue;
      patches->emplace_back().corner = cell.tl();
      road->roi |= cell;
    }
  }
  if (patches->empty()) return;
  // At least one pixel, for the gradients of the outermost samples.
  const int side = std::max(1, static_cast<int>(kSideMargin * camera_.fx));
  const int top = std::max(1, static_cast<int>(kTopMargin * camera_.fy));
  road->roi -= cv::Point(side, top);
  road->roi += cv::Size(2 * side, top + patch_px_);
  road->roi &= cv::Rect(0, 0, camera_.width, camera_.height);
}

/// Part of the reduced image, smoothed, CV_32F.
cv::Mat PatchMatcher::smoothed(const cv::Mat& image, const cv::Rect& area) const {
  const cv::Rect wide = extended(area, radius_) & cv::Rect(0, 0, camera_.width, camera_.height);
  cv::Mat part = image(cv::Rect(wide.tl() * reduction_, wide.size() * reduction_));
  if (reduction_ > 1) cv::resize(part, part, wide.size(), 0, 0, cv::INTER_AREA);
  const cv::Mat kernel = cv::getGaussianKernel(2 * radius_ + 1, sigma_, CV_32F);
  cv::Mat result;
  cv::sepFilter2D(part(area - wide.tl()), result, CV_32F, kernel, kernel);
  return result;
}

/// Rays, normalised intensities and gradients of one patch. origin: the pixel of the image at which
/// smoothed begins.
void PatchMatcher::samplePatch(const cv::Mat& smoothed, const cv::Point& origin,
                               Patch* patch) const {
  const auto stride = static_cast<std::ptrdiff_t>(smoothed.step1());
  for (int k = 0; k < kPatchSamples; ++k) {
    const int u = patch->corner.x + (2 * (k % kPatchSide) + 1) * patch_px_ / (2 * kPatchSide);
    const int v = patch->corner.y + (2 * (k / kPatchSide) + 1) * patch_px_ / (2 * kPatchSide);
    const float* pixel = smoothed.ptr<float>(v - origin.y) + (u - origin.x);
    patch->ray_x[k] = static_cast<float>((u - camera_.cx) / camera_.fx);
    patch->ray_y[k] = static_cast<float>((v - camera_.cy) / camera_.fy);
    patch->value[k] = *pixel;
    patch->grad_x[k] = 0.5f * (pixel[1] - pixel[-1]);
    patch->grad_y[k] = 0.5f * (pixel[stride] - pixel[-stride]);
  }
  const float deviation = normalise(image_noise_, &patch->value, &patch->texture);
  patch->grad_x /= deviation;
  patch->grad_y /= deviation;
}

/// The motion between the cameras at the exposure of the patch in both images, and m in the axes of
/// the current one.
std::pair<Eigen::Isometry3d, Eigen::Vector3d> PatchMatcher::atExposure(
    const Reference& reference, const Patch& patch, const Eigen::Vector3d& m) const {
  if (reference.readout_motion_c.isZero(0)) return {reference.T_r_c, m};
  const auto shareOf = [&](const Eigen::Vector3d& p) {
    return std::clamp(camera_.readoutShare(camera_.project(p).y()), -0.5, 0.5);
  };
  const Eigen::Vector3d ray(patch.ray_x.mean(), patch.ray_y.mean(), 1);
  const double share_c = shareOf(ray);
  const Eigen::Isometry3d T_c_row = motionFrom(share_c * reference.readout_motion_c);
  // The points x of the plane have m . x = -1.
  const Eigen::Vector3d m_row =
      T_c_row.linear().transpose() * m / (1 + m.dot(T_c_row.translation()));
  double share_r = share_c;
  Eigen::Isometry3d T_row_row;
  for (int i = 0; i < 3; ++i) {  // the row in the reference image depends on the pose of that row
    const Eigen::Isometry3d T_r_row = motionFrom(share_r * reference.image.readout_motion);
    T_row_row = T_r_row.inverse() * reference.T_r_c * T_c_row;
    // Centre of the patch, times its inverse depth.
    const Eigen::Vector3d p_r = T_row_row.linear() * ray - m_row.dot(ray) * T_row_row.translation();
    if (!(p_r.z() > 0)) break;
    share_r = shareOf(p_r);
  }
  return {T_row_row, m_row};
}

bool PatchMatcher::sample(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m,
                          Samples* values) const {
  const RoadImage& image = reference.image;
  const auto [T_r_c, m_c] = atExposure(reference, patch, m);
  const Eigen::Matrix3f H = homography(T_r_c, m_c);
  Samples u, v;
  const int inside =
      project(camera_, image.roi, H, patch.ray_x.data(), patch.ray_y.data(), u.data(), v.data());
  if (inside < kPatchSamples) return false;
  for (int i = 0; !allowed_.empty() && i < kPatchSamples; ++i) {
    const cv::Point pixel(static_cast<int>(u[i]), static_cast<int>(v[i]));
    if (allowed_.at<unsigned char>(image.roi.tl() + pixel) == 0) return false;
  }
  interpolate(image.pixels.ptr<float>(), static_cast<int>(image.pixels.step1()), u.data(), v.data(),
              values->data());
  return true;
}

void PatchMatcher::linearise(const Reference& reference, const Patch& patch,
                             const Eigen::Vector3d& m, Match* match) const {
  const auto [T_r_c, m_c] = atExposure(reference, patch, m);
  const Eigen::Matrix3f H = homography(T_r_c, m_c);
  const Eigen::Vector3f t = T_r_c.translation().cast<float>();
  // The warped rays y, and their projection.
  const Samples y_x = transformed(H, 0, patch), y_y = transformed(H, 1, patch),
                y_z = transformed(H, 2, patch);
  const Samples xn = y_x / y_z, yn = y_y / y_z;
  // Inverse transpose of the homography's Jacobian (times z) on the gradient: the derivative of the
  // intensity by y, which is orthogonal to y.
  const Samples a = H(0, 0) - xn * H(2, 0), b = H(0, 1) - xn * H(2, 1);
  const Samples c = H(1, 0) - yn * H(2, 0), d = H(1, 1) - yn * H(2, 1);
  const Samples determinant = a * d - b * c;
  const Samples gx = patch.grad_x * static_cast<float>(camera_.fx);
  const Samples gy = patch.grad_y * static_cast<float>(camera_.fy);
  const Samples by_x = (d * gx - c * gy) / determinant, by_y = (a * gy - b * gx) / determinant;
  const Samples by_z = -by_x * xn - by_y * yn;
  // With y = R r - t q: by q, by a rotation, and by the direction of t.
  match->jacobian = -dot(t, by_x, by_y, by_z);
  match->jacobian -= match->jacobian.mean();
  const Samples q = dot(m_c.cast<float>(), patch.ray_x, patch.ray_y, Samples::Ones());
  const Eigen::Vector3f side = t.unitOrthogonal();
  const Samples by_motion[] = {y_y * by_z - y_z * by_y, y_z * by_x - y_x * by_z,
                               y_x * by_y - y_y * by_x, -q * dot(side * t.norm(), by_x, by_y, by_z),
                               -q * dot(t.cross(side), by_x, by_y, by_z)};
  const float information =
      std::max(match->jacobian.square().sum(), std::numeric_limits<float>::min());
  for (int k = 0; k < 5; ++k) {
    match->motion[k] = (match->jacobian * by_motion[k]).sum() / information;
  }
  // Gradient by the position in the image.
  const Samples by_u = by_x * y_z, by_v = by_y * y_z;
  // A radial distortion moves the samples in the reference image, and their rays in the current
  // one.
  const Samples radial_r = by_u * xn + by_v * yn;
  const Samples radial_c =
      patch.ray_x * dot(H.col(0), by_x, by_y, by_z) + patch.ray_y * dot(H.col(1), by_x, by_y, by_z);
  const Samples r2_r = xn.square() + yn.square();
  const Samples r2_c = patch.ray_x.square() + patch.ray_y.square();
  match->lens[0] = (match->jacobian * (radial_r * r2_r - radial_c * r2_c)).sum() / information;
  match->lens[1] =
      (match->jacobian * (radial_r * r2_r.square() - radial_c * r2_c.square())).sum() / information;
  // Epipolar flow: the position by q.
  const float gradient_energy =
      (by_u - by_u.mean()).square().sum() + (by_v - by_v.mean()).square().sum();
  const float flow_energy =
      (((xn * t.z() - t.x()) / y_z).square() + ((yn * t.z() - t.y()) / y_z).square()).mean();
  match->observable =
      information > kMinGradientAlongLine * kMinGradientAlongLine * flow_energy * gradient_energy;
}

void PatchMatcher::measure(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m,
                           Match* match) const {
  Samples values;
  match->valid = sample(reference, patch, m, &values);
  if (!match->valid) return;
  match->correlation = correlate(patch, &values);
  const Samples residual = patch.value - values;
  const float variance = std::max(residual.square().sum(), kMinResidualVariance) / kPatchSamples;
  const Samples weight =
      1 / (1 + residual.square() / (kSampleCauchyConstant * kSampleCauchyConstant * variance));
  const Samples weighted_jacobian = weight * match->jacobian;
  const Samples information_by_sample = weighted_jacobian * match->jacobian;
  const float information = information_by_sample.sum();
  match->valid = match->observable && information > 0;
  match->shift = (weighted_jacobian * residual).sum() / information;
  match->variance =
      ((weight * residual.square()).sum() / weight.sum() + kMinResidualVariance) / information;
  match->ray = Eigen::Vector3f((information_by_sample * patch.ray_x).sum() / information,
                               (information_by_sample * patch.ray_y).sum() / information, 1.f);
}

float PatchMatcher::correlate(const Patch& patch, Samples* values) const {
  float texture = 0;
  normalise(image_noise_, values, &texture);
  return (patch.value * *values).mean() /
         std::sqrt(std::max(patch.texture * texture, kMinTextureProduct));
}

}  // namespace gsv::direct
