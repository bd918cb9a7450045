#include "scale/direct/patch.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::direct {
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

}  // namespace

float normalise(float noise, Samples* values, float* texture) {
  *values -= values->mean();
  const float variance = values->square().mean();
  const float deviation = std::sqrt(variance + noise * noise);
  *values /= deviation;
  *texture = variance / (variance + noise * noise);
  return deviation;
}

PatchExtractor::PatchExtractor(const PinholeCamera& camera, double patch_size, double image_noise,
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

void PatchExtractor::extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards,
                             RoadImage* road, std::vector<Patch>* patches) {
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
  for (Patch& patch : *patches) sample(faces_backwards ? once : twice, area.tl(), &patch);
  road->pixels = faces_backwards ? twice : once;
}

/// Creates the patches whose centre lies in the lane, and sets the part of the image to be stored.
void PatchExtractor::selectCells(const LaneRegion& lane, RoadImage* road,
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
cv::Mat PatchExtractor::smoothed(const cv::Mat& image, const cv::Rect& area) const {
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
void PatchExtractor::sample(const cv::Mat& smoothed, const cv::Point& origin, Patch* patch) const {
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

}  // namespace ground_scale_vo::direct
