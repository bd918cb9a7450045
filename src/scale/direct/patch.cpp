#include "scale/direct/patch.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/lanes.hpp"
#include "common/vector_loop.hpp"

namespace ground_scale_vo::direct {
namespace {

constexpr int kMinPatchPx = kPatchSide;  ///< [px] at least one pixel per sample
/// [focal lengths] Standard deviation of the Gaussian that smooths the images: 0.7 px for KITTI.
constexpr double kBlur = 0.0010;
/// [px] A weaker blur leaves visible errors of the bilinear interpolation between pixels.
constexpr double kMinBlurPx = 0.6;
/// [focal lengths] Margins around the lane region that are kept for later frames: the patches of a
/// later frame project outside the region after a turn (sides) or a change of pitch (top).
constexpr double kSideMargin = 0.12;
constexpr double kTopMargin = 0.04;
/// Lower bound of the product of two texture shares, keeps the correlation of uniform patches
/// finite.
constexpr float kMinTextureProduct = 1e-3f;

/// Returns the mean of the squares of the rest.
GSV_VECTOR_LOOP float removeMean(float* values) {
  Lanes sum{}, squares{};
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) sum += lanes(values + i);
  const float mean = total(sum) / kPatchSamples;
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) {
    lanes(values + i) -= mean;
    squares += lanes(values + i) * lanes(values + i);
  }
  return total(squares) / kPatchSamples;
}

GSV_VECTOR_LOOP float meanProduct(const float* a, const float* b) {
  Lanes sum{};
  for (std::size_t i = 0; i < kPatchSamples; i += kLanes) sum += lanes(a + i) * lanes(b + i);
  return total(sum) / kPatchSamples;
}

}  // namespace

PatchGrid::PatchGrid(const PinholeCamera& camera, double patch_size)
    : patch_px(std::max(kMinPatchPx, static_cast<int>(std::lround(patch_size * camera.fx)))),
      columns(camera.width / patch_px),
      rows(camera.height / patch_px) {}

float normalise(float noise, Samples* values, float* texture) {
  const float variance = removeMean(values->data());
  const float deviation = std::sqrt(variance + noise * noise);
  *values /= deviation;
  *texture = variance / (variance + noise * noise);
  return deviation;
}

float correlate(const Patch& patch, float noise, Samples* values) {
  float texture = 0;
  normalise(noise, values, &texture);
  const float product = meanProduct(patch.value.data(), values->data());
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
      smoothing_(std::max(kMinBlurPx, kBlur * camera.fx)),
      image_noise_(static_cast<float>(image_noise)) {
  if (mask.empty()) return;
  const int reach =
      2 * smoothing_.radius() + 1;  // smoothed twice, with a gradient or an interpolation
  const int side = reduction * (2 * reach + 1);
  cv::Mat eroded;
  cv::erode(mask, eroded, cv::Mat::ones(side + 1 - side % 2, side + 1 - side % 2, CV_8U));
  cv::resize(eroded, allowed_, {camera.width, camera.height}, 0, 0, cv::INTER_NEAREST);
}

/// An image of camera_ with the pixels that smoothing the part `area` needs, reduced from the given
/// image. Moves the area by its origin.
cv::Mat PatchExtractor::reducedPart(const cv::Mat& image, cv::Rect* area) const {
  if (reduction_ == 1) return image;
  const int margin = smoothing_.radius();
  cv::Rect wide(area->tl() - cv::Point(margin, margin),
                area->size() + cv::Size(2 * margin, 2 * margin));
  wide &= cv::Rect(0, 0, camera_.width, camera_.height);
  cv::Mat result;
  cv::resize(image(cv::Rect(wide.tl() * reduction_, wide.size() * reduction_)), result, wide.size(),
             0, 0, cv::INTER_AREA);
  *area -= wide.tl();
  return result;
}

void PatchExtractor::extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards,
                             RoadImage* current, std::vector<Patch>* patches) {
  selectCells(lane, current, patches);
  if (patches->empty()) return;
  const cv::Rect& roi = current->roi;
  current->storage.create(roi.size(), CV_32F);
  cv::Mat& smoothed = current->storage;
  cv::Rect in_source = roi;
  const cv::Mat source = reducedPart(image, &in_source);
  smoothing_.smooth(source, in_source, &smoothed);
  // The reference images show this piece of road from farther away, at a lower resolution. The
  // patches compared with them are smoothed a second time: a difference in sharpness would bias
  // their shifts. With a camera that faces backwards the reference images are the nearer ones.
  const cv::Rect twice = faces_backwards ? roi : sampledPart(*patches) & roi;
  twice_smoothed_.create(twice.size(), CV_32F);
  smoothing_.smooth(smoothed, twice - roi.tl(), &twice_smoothed_);
  for (Patch& patch : *patches) {
    sample(faces_backwards ? smoothed : twice_smoothed_, twice.tl(), &patch);
  }
  if (faces_backwards) cv::swap(twice_smoothed_, smoothed);
}

/// Contains the pixels that sample() reads.
cv::Rect PatchExtractor::sampledPart(const std::vector<Patch>& patches) const {
  cv::Rect part;
  for (const Patch& patch : patches) {
    part |= cv::Rect(patch.corner, cv::Size(grid_.patch_px, grid_.patch_px));
  }
  return part - cv::Point(1, 1) + cv::Size(2, 2);
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
/// origin: the pixel of the image at which smoothed begins.
void PatchExtractor::sample(const cv::Mat& smoothed, const cv::Point& origin, Patch* patch) const {
  const auto stride = static_cast<std::ptrdiff_t>(smoothed.step1());
  for (int k = 0; k < kPatchSamples; ++k) {
    const int u = patch->corner.x + (2 * (k % kPatchSide) + 1) * grid_.patch_px / (2 * kPatchSide);
    const int v = patch->corner.y + (2 * (k / kPatchSide) + 1) * grid_.patch_px / (2 * kPatchSide);
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
