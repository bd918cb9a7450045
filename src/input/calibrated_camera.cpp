#include "ground_scale_vo/input/calibrated_camera.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/text.hpp"

namespace ground_scale_vo {
namespace {

/// Points per side of the grid on which two rectifications are compared.
constexpr int kComparedPoints = 5;
constexpr double kTolerancePx = 0.1;

bool areClose(const PinholeCamera& a, const PinholeCamera& b) {
  const auto same = [](double x, double y) { return std::abs(x - y) <= kTolerancePx; };
  return a.width == b.width && a.height == b.height && same(a.fx, b.fx) && same(a.fy, b.fy) &&
         same(a.cx, b.cx) && same(a.cy, b.cy);
}

const CameraCalibration& valid(const CameraCalibration& calibration) {
  calibration.validate();
  if (!calibration.hasSize()) throw OptionError("the image size of the calibration is not known");
  return calibration;
}

}  // namespace

Undistortion::Undistortion(const CameraCalibration& camera) : size_(camera.width, camera.height) {
  if (!camera.isDistorted()) return;
  // The fixed-point maps of cv::initUndistortRectifyMap: whole pixels, and 1/32 of a pixel.
  map1_.create(size_, CV_16SC2);
  map2_.create(size_, CV_16UC1);
  for (int v = 0; v < size_.height; ++v) {
    CameraCalibration::Pixels row;
    for (int u = 0; u < size_.width; ++u) row.emplace_back(u, v);
    const CameraCalibration::Pixels distorted = camera.distorted(row);
    for (int u = 0; u < size_.width; ++u) {
      const cv::Point_<int> raw(distorted[static_cast<std::size_t>(u)] * cv::INTER_TAB_SIZE);
      const int x = raw.x & (cv::INTER_TAB_SIZE - 1), y = raw.y & (cv::INTER_TAB_SIZE - 1);
      map1_.at<cv::Point_<short>>(v, u) =
          cv::Point(raw.x >> cv::INTER_BITS, raw.y >> cv::INTER_BITS);
      map2_.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(y * cv::INTER_TAB_SIZE + x);
    }
  }
  const cv::Mat mask = image(cv::Mat(size_, CV_8U, cv::Scalar(255))) == 255;
  if (cv::countNonZero(mask) < size_.area()) mask_ = mask;
}

cv::Mat Undistortion::mask(const cv::Mat& given) const {
  if (given.empty()) return mask_;
  const cv::Mat undistorted = image(given != 0) == 255;
  return mask_.empty() ? undistorted : cv::Mat(undistorted & mask_);
}

cv::Mat Undistortion::image(const cv::Mat& image) const {
  if (image.size() != size_) {
    throw DataError("the images are " + sizeText(image.cols, image.rows) +
                    ", the calibration is of " + sizeText(size_.width, size_.height));
  }
  if (map1_.empty()) return image;
  cv::Mat result;
  cv::remap(image, result, map1_, map2_, cv::INTER_LINEAR);
  return result;
}

CalibratedCamera::CalibratedCamera(const CameraCalibration& calibration)
    : calibration_(valid(calibration)), given_(calibration_), undistortion_(calibration_) {
  if (!calibration_.hasLens()) given_.setDistortion("none", {});
}

cv::Mat CalibratedCamera::given(const cv::Mat& raw) const {
  return isGivenRectified() ? undistortion_.image(raw) : raw;
}

cv::Mat CalibratedCamera::givenMask(const cv::Mat& raw_mask) const {
  return isGivenRectified() ? undistortion_.mask(raw_mask) : raw_mask;
}

bool isSameCalibration(const CameraCalibration& a, const CameraCalibration& b) {
  if (!areClose(pinholeOf(a), pinholeOf(b))) return false;
  CameraCalibration::Pixels grid;
  const double last = kComparedPoints - 1;
  for (int i = 0; i < kComparedPoints * kComparedPoints; ++i) {
    grid.emplace_back((a.width - 1) * (i % kComparedPoints / last),
                      (a.height - 1) * (i / kComparedPoints / last));
  }
  const auto in_a = a.distorted(grid), in_b = b.distorted(grid);
  return std::equal(in_a.begin(), in_a.end(), in_b.begin(), [](const auto& u_a, const auto& u_b) {
    return cv::norm(u_a - u_b) <= kTolerancePx;
  });
}

}  // namespace ground_scale_vo
