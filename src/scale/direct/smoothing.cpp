#include "scale/direct/smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"

namespace ground_scale_vo::direct {
namespace {

constexpr double kRadiusSigmas = 2.5;  ///< of the filter; 98.8 % of the Gaussian
constexpr int kTaps = 2 * Smoothing::kMaxRadius + 1;

using Weights = std::array<float, Smoothing::kMaxRadius + 1>;

/// rows: the pixels of kTaps rows. All taps, also those of weight 0, because a loop over a variable
/// number of them is not vectorised.
GSV_VECTOR_LOOP void smoothDown(const std::array<const unsigned char*, kTaps>& rows,
                                const Weights& weights, int columns, float* __restrict result) {
  const auto [a, b, c, d, e, f, g] = rows;
  const auto [w0, w1, w2, w3] = weights;
  for (int x = 0; x < columns; ++x) {
    result[x] = w0 * static_cast<float>(d[x]) + w1 * static_cast<float>(c[x] + e[x]) +
                w2 * static_cast<float>(b[x] + f[x]) + w3 * static_cast<float>(a[x] + g[x]);
  }
}

GSV_VECTOR_LOOP void smoothDown(const std::array<const float*, kTaps>& rows, const Weights& weights,
                                int columns, float* __restrict result) {
  const auto [a, b, c, d, e, f, g] = rows;
  const auto [w0, w1, w2, w3] = weights;
  for (int x = 0; x < columns; ++x) {
    result[x] = w0 * d[x] + w1 * (c[x] + e[x]) + w2 * (b[x] + f[x]) + w3 * (a[x] + g[x]);
  }
}

/// row: starts kMaxRadius before the first column of the result.
GSV_VECTOR_LOOP void smoothAcross(const float* __restrict row, const Weights& weights, int columns,
                                  float* __restrict result) {
  const auto [w0, w1, w2, w3] = weights;
  for (int x = 0; x < columns; ++x) {
    result[x] = w0 * row[x + 3] + w1 * (row[x + 2] + row[x + 4]) + w2 * (row[x + 1] + row[x + 5]) +
                w3 * (row[x] + row[x + 6]);
  }
}

int reflected(int at, int size) { return cv::borderInterpolate(at, size, cv::BORDER_REFLECT_101); }

}  // namespace

Smoothing::Smoothing(double sigma)
    : radius_(std::min(kMaxRadius, static_cast<int>(std::ceil(kRadiusSigmas * sigma)))) {
  const cv::Mat kernel = cv::getGaussianKernel(2 * radius_ + 1, sigma, CV_32F);
  for (int k = 0; k <= radius_; ++k) {
    weights_[static_cast<std::size_t>(k)] = kernel.at<float>(radius_ + k);
  }
}

template <typename Pixel>
void Smoothing::smoothPixels(const cv::Mat& source, const cv::Rect& area, cv::Mat* result) {
  // The columns that exist, of the area and kMaxRadius on both sides.
  const int first = std::max(0, area.x - kMaxRadius);
  const int last = std::min(source.cols, area.br().x + kMaxRadius) - 1;
  row_.resize(static_cast<std::size_t>(area.width + 2 * kMaxRadius));
  float* const row = row_.data() + kMaxRadius - area.x;  // of column 0
  for (int y = 0; y < area.height; ++y) {
    std::array<const Pixel*, kTaps> rows;
    for (int k = 0; k < kTaps; ++k) {
      const int v = reflected(area.y + y + k - kMaxRadius, source.rows);
      rows[static_cast<std::size_t>(k)] = source.ptr<Pixel>(v) + first;
    }
    smoothDown(rows, weights_, last - first + 1, row + first);
    for (int x = area.x - kMaxRadius; x < first; ++x) row[x] = row[reflected(x, source.cols)];
    for (int x = last + 1; x < area.br().x + kMaxRadius; ++x) {
      row[x] = row[reflected(x, source.cols)];
    }
    smoothAcross(row_.data(), weights_, area.width, result->ptr<float>(y));
  }
}

void Smoothing::smooth(const cv::Mat& source, const cv::Rect& area, cv::Mat* result) {
  if (source.depth() == CV_8U) {
    smoothPixels<unsigned char>(source, area, result);
  } else {
    smoothPixels<float>(source, area, result);
  }
}

}  // namespace ground_scale_vo::direct
