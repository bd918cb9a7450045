#include "scale/direct/patch.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::direct {
namespace {

constexpr int kMinPatchPx = kPatchSide;  ///< [px] at least one pixel per sample
/// [focal lengths] Standard deviation of the Gaussian that smooths the images: 0.7 px for KITTI.
constexpr double kBlur = 0.0010;
/// [px] A weaker blur leaves visible errors of the bilinear interpolation between pixels.
constexpr double kMinBlurPx = 0.6;
constexpr double kKernelRadius = 2.5;  ///< [sigma] of the blur; 98.8 % of the Gaussian
/// [focal lengths] Margins around the lane region that are kept for later frames: the patches of a
/// later frame project outside the region after a turn (sides) or a change of pitch (top).
constexpr double kSideMargin = 0.12;
constexpr double kTopMargin = 0.04;
/// Lower bound of the product of two texture shares, keeps the correlation of uniform patches
/// finite.
constexpr float kMinTextureProduct = 1e-3f;

}  // namespace

PatchGrid::PatchGrid(const PinholeCamera& camera, double patch_size)
    : patch_px(std::max(kMinPatchPx, static_cast<int>(std::lround(patch_size * camera.fx)))),
      columns(camera.width / patch_px),
      rows(camera.height / patch_px) {}

float normalise(float noise, Samples* values, float* texture) {
  *values -= values->mean();
  const float variance = values->square().mean();
  const float deviation = std::sqrt(variance + noise * noise);
  *values /= deviation;
  *texture = variance / (variance + noise * noise);
  return deviation;
}

float correlate(const Patch& patch, float noise, Samples* values) {
  float texture = 0;
  normalise(noise, values, &texture);
  const float product = (patch.value * *values).mean();
  return product / std::sqrt(std::max(patch.texture * texture, kMinTextureProduct));
}

int imageReduction(const PinholeCamera& camera) {
  return std::max(1, static_cast<int>(kBlur * camera.fx / kMinBlurPx));
}

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

PatchExtractor::PatchExtractor(const PinholeCamera& camera, int reduction, const PatchGrid& grid,
                               double image_noise, const cv::Mat& mask)
    : camera_(camera),
      reduction_(reduction),
      grid_(grid),
      image_noise_(static_cast<float>(image_noise)) {
  const double blur_px = std::max(kMinBlurPx, kBlur * camera.fx);
  const int radius = static_cast<int>(std::ceil(kKernelRadius * blur_px));
  kernel_ = cv::getGaussianKernel(2 * radius + 1, blur_px, CV_32F);
  twice_smoothed_.create(camera.height, camera.width, CV_32F);
  if (mask.empty()) return;
  const int reach = 2 * radius + 1;  // smoothed twice, with a gradient or an interpolation
  const int side = reduction * (2 * reach + 1);
  cv::Mat eroded;
  cv::erode(mask, eroded, cv::Mat::ones(side + 1 - side % 2, side + 1 - side % 2, CV_8U));
  cv::resize(eroded, allowed_, {camera.width, camera.height}, 0, 0, cv::INTER_NEAREST);
}

/// The part roi [px of camera_] of an image, reduced. It is part of a larger matrix, so that
/// filters see the pixels around it.
cv::Mat PatchExtractor::reducedPart(const cv::Mat& image, const cv::Rect& roi) const {
  if (reduction_ == 1) return image(roi);
  const int margin = kernel_.rows / 2;
  cv::Rect wide(roi.tl() - cv::Point(margin, margin),
                roi.size() + cv::Size(2 * margin, 2 * margin));
  wide &= cv::Rect(0, 0, camera_.width, camera_.height);
  cv::Mat result;
  cv::resize(image(cv::Rect(wide.tl() * reduction_, wide.size() * reduction_)), result, wide.size(),
             0, 0, cv::INTER_AREA);
  return result({roi.tl() - wide.tl(), roi.size()});
}

void PatchExtractor::extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards,
                             RoadImage* current, std::vector<Patch>* patches) {
  selectCells(lane, current, patches);
  if (patches->empty()) return;
  const cv::Rect& roi = current->roi;
  cv::Mat smoothed = current->storage(cv::Rect({0, 0}, roi.size()));
  cv::sepFilter2D(reducedPart(image, roi), smoothed, CV_32F, kernel_, kernel_);
  // The reference images show this piece of road from farther away, at a lower resolution. The
  // patches compared with them are smoothed a second time: a difference in sharpness would bias
  // their shifts. With a camera that faces backwards the reference images are the nearer ones.
  cv::Mat twice_smoothed = twice_smoothed_(cv::Rect({0, 0}, roi.size()));
  cv::sepFilter2D(smoothed, twice_smoothed, CV_32F, kernel_, kernel_, {-1, -1}, 0,
                  cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
  for (Patch& patch : *patches) sample(faces_backwards ? smoothed : twice_smoothed, roi, &patch);
  if (faces_backwards) twice_smoothed.copyTo(smoothed);
}

bool PatchExtractor::touchesMask(const cv::Rect& cell) const {
  return !allowed_.empty() && cv::countNonZero(allowed_(cell)) < cell.area();
}

/// Creates the patches whose centre lies in the lane, and sets the image's region of interest.
void PatchExtractor::selectCells(const LaneRegion& lane, RoadImage* current,
                                 std::vector<Patch>* patches) const {
  patches->clear();
  current->roi = cv::Rect();
  // Cells at the image border have no gradient there.
  for (int row = 1; row < grid_.rows; ++row) {
    for (int column = 1; column < grid_.columns; ++column) {
      const cv::Rect cell = grid_.cell(row, column);
      if (cell.br().x >= camera_.width || cell.br().y >= camera_.height) continue;
      const cv::Point centre = (cell.tl() + cell.br()) / 2;
      if (!lane.contains(camera_.ray({centre.x, centre.y})) || touchesMask(cell)) continue;
      Patch& patch = patches->emplace_back();
      patch.cell = grid_.index(row, column);
      patch.corner = cell.tl();
      current->roi |= cell;
    }
  }
  if (patches->empty()) return;
  // At least one pixel, for the gradients of the outermost samples.
  const int side = std::max(1, static_cast<int>(kSideMargin * camera_.fx));
  const int top = std::max(1, static_cast<int>(kTopMargin * camera_.fy));
  current->roi -= cv::Point(side, top);
  current->roi += cv::Size(2 * side, top + grid_.patch_px);
  current->roi &= cv::Rect(0, 0, camera_.width, camera_.height);
}

/// Rays, normalised intensities and gradients of one patch.
void PatchExtractor::sample(const cv::Mat& smoothed, const cv::Rect& roi, Patch* patch) const {
  const auto stride = static_cast<std::ptrdiff_t>(smoothed.step1());
  for (int k = 0; k < kPatchSamples; ++k) {
    const int u = patch->corner.x + (2 * (k % kPatchSide) + 1) * grid_.patch_px / (2 * kPatchSide);
    const int v = patch->corner.y + (2 * (k / kPatchSide) + 1) * grid_.patch_px / (2 * kPatchSide);
    const float* pixel = smoothed.ptr<float>(v - roi.y) + (u - roi.x);
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
