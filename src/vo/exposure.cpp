#include "ground_scale_vo/vo/exposure.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// Grey levels beyond these may be clipped.
constexpr int kMinGrey = 8, kMaxGrey = 247;
/// Minimum fraction of the pixels that are unclipped in both images.
constexpr double kMinUnclipped = 0.2;
/// [ratio of grey levels] a smaller step is within the noise of the image content; a larger one
/// clips most pixels.
constexpr double kMinStep = 1.25, kMaxStep = 5;
/// The logarithm of the step must be this many times the third quartile of the pixels' deviations
/// from it, so that image motion is not taken for a change of exposure.
constexpr double kMinSignificance = 3;

}  // namespace

double exposureStep(const cv::Mat& previous, const cv::Mat& current) {
  std::vector<double> ratios;
  ratios.reserve(previous.total());
  for (int y = 0; y < previous.rows; ++y) {
    const unsigned char *a = previous.ptr(y), *b = current.ptr(y);
    for (int x = 0; x < previous.cols; ++x) {
      if (a[x] < kMinGrey || b[x] < kMinGrey || a[x] > kMaxGrey || b[x] > kMaxGrey) continue;
      ratios.push_back(static_cast<double>(b[x]) / a[x]);
    }
  }
  if (ratios.empty() ||
      static_cast<double>(ratios.size()) < kMinUnclipped * static_cast<double>(previous.total())) {
    return 1;
  }
  // Nearly always the median is no step; counting takes less time than finding it.
  const auto brighter =
      std::count_if(ratios.begin(), ratios.end(), [](double ratio) { return ratio >= kMinStep; });
  const auto darker = std::count_if(ratios.begin(), ratios.end(),
                                    [](double ratio) { return ratio <= 1 / kMinStep; });
  if (2 * static_cast<std::size_t>(std::max(brighter, darker)) < ratios.size()) return 1;
  const double step = median(&ratios), size = std::abs(std::log(step));
  if (size < std::log(kMinStep) || size > std::log(kMaxStep)) return 1;
  for (double& ratio : ratios) ratio = std::abs(std::log(ratio / step));
  const auto quartile = ratios.begin() + static_cast<std::ptrdiff_t>(3 * ratios.size() / 4);
  std::nth_element(ratios.begin(), quartile, ratios.end());
  return kMinSignificance * *quartile < size ? step : 1;
}

cv::Mat applyGain(const cv::Mat& image, double factor) {
  if (factor == 1) return image;
  cv::Mat result;
  image.convertTo(result, CV_8U, factor);
  return result;
}

}  // namespace ground_scale_vo
