#include "ground_scale_vo/vo/exposure.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "ground_scale_vo/common/median.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kDark = 8, kBright = 247;  // beyond them a grey level may be cut off
constexpr double kLeastReadable = 0.2;   // share of the pixels that are not, in both images
constexpr double kLeastStep = 1.25, kLargestStep = 5;
constexpr double kClear = 3;  // a step over what three quarters of its parts differ from it

}  // namespace

double exposureStep(const cv::Mat& before, const cv::Mat& now) {
  std::vector<double> ratios;
  ratios.reserve(before.total());
  for (int y = 0; y < before.rows; ++y) {
    const unsigned char *a = before.ptr(y), *b = now.ptr(y);
    for (int x = 0; x < before.cols; ++x) {
      if (a[x] < kDark || b[x] < kDark || a[x] > kBright || b[x] > kBright) continue;
      ratios.push_back(static_cast<double>(b[x]) / a[x]);
    }
  }
  if (ratios.empty() ||
      static_cast<double>(ratios.size()) < kLeastReadable * static_cast<double>(before.total())) {
    return 1;
  }
  const double step = median(&ratios), size = std::abs(std::log(step));
  if (size < std::log(kLeastStep) || size > std::log(kLargestStep)) return 1;
  for (double& ratio : ratios) ratio = std::abs(std::log(ratio / step));
  const auto most = ratios.begin() + static_cast<std::ptrdiff_t>(3 * ratios.size() / 4);
  std::nth_element(ratios.begin(), most, ratios.end());
  return kClear * *most < size ? step : 1;
}

cv::Mat applyGain(const cv::Mat& image, double factor) {
  if (factor == 1) return image;
  cv::Mat result;
  image.convertTo(result, CV_8U, factor);
  return result;
}

}  // namespace ground_scale_vo
