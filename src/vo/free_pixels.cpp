#include "vo/free_pixels.hpp"

#include <cstddef>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"

namespace ground_scale_vo {
namespace {

/// [px] The rows of the template are widened to a multiple of it: one or two vector registers.
constexpr int kBlock = 16;

/// Sets the pixels to 0 where the template, of whole blocks, is 0. step: between rows of pixels.
GSV_VECTOR_LOOP void keepBoth(const unsigned char* __restrict disc, int blocks, int rows,
                              std::size_t step, unsigned char* __restrict pixels) {
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < blocks * kBlock; ++x) pixels[x] &= disc[x];
    disc += blocks * kBlock;
    pixels += step;
  }
}

}  // namespace

FreePixels::FreePixels(const cv::Size& size, const cv::Mat& allowed, int radius) : radius_(radius) {
  const int side = 2 * radius + 1, width = (side + kBlock - 1) / kBlock * kBlock;
  disc_ = cv::Mat(side, width, CV_8UC1, cv::Scalar(255));
  cv::circle(disc_, {radius, radius}, radius, 0, cv::FILLED);
  // A disc around a centre `radius` outside the image still touches it.
  const int margin = 2 * radius;
  padded_.create(size.height + 2 * margin, size.width + 2 * margin + width - side, CV_8UC1);
  mask_ = padded_(cv::Rect({margin, margin}, size));
  if (allowed.empty()) {
    std::memset(padded_.data, 255, padded_.total());
  } else {
    allowed.copyTo(mask_);
  }
}

void FreePixels::removeDisc(const cv::Point& centre) {
  if (centre.x < -radius_ || centre.x >= mask_.cols + radius_ || centre.y < -radius_ ||
      centre.y >= mask_.rows + radius_) {
    return;
  }
  const cv::Point corner = centre + cv::Point(radius_, radius_);  // in padded_: -radius + margin
  keepBoth(disc_.ptr(), disc_.cols / kBlock, disc_.rows, padded_.step,
           padded_.ptr(corner.y) + corner.x);
}

}  // namespace ground_scale_vo
