#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/image.hpp"

namespace gsv {

Undistortion::Undistortion(const CameraCalibration& camera, const cv::Mat& mask) {
  camera.validate();
  if (!camera.hasSize()) throw OptionError("the image size of the calibration is not known");
  camera_ = pinholeOf(camera);
  requireMask(mask, camera_);
  const cv::Size size(camera.width, camera.height);
  if (camera.isDistorted()) {
    // The fixed-point maps of cv::initUndistortRectifyMap: whole pixels, and 1/32 of a pixel.
    map1_.create(size, CV_16SC2);
    map2_.create(size, CV_16UC1);
    for (int v = 0; v < size.height; ++v) {
      CameraCalibration::Pixels row;
      for (int u = 0; u < size.width; ++u) row.emplace_back(u, v);
      const CameraCalibration::Pixels distorted = camera.distorted(row);
      for (int u = 0; u < size.width; ++u) {
        const cv::Point_<int> raw(distorted[static_cast<std::size_t>(u)] * cv::INTER_TAB_SIZE);
        const int x = raw.x & (cv::INTER_TAB_SIZE - 1), y = raw.y & (cv::INTER_TAB_SIZE - 1);
        map1_.at<cv::Point_<short>>(v, u) =
            cv::Point(raw.x >> cv::INTER_BITS, raw.y >> cv::INTER_BITS);
        map2_.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(y * cv::INTER_TAB_SIZE + x);
      }
    }
  }
  const cv::Mat whole = mask.empty() ? cv::Mat(size, CV_8U, cv::Scalar(255)) : cv::Mat(mask != 0);
  const cv::Mat content = remapped(whole) == 255;
  if (!mask.empty() || cv::countNonZero(content) < size.area()) mask_ = content;
}

CameraImage Undistortion::image(const cv::Mat& raw) const {
  requireImage(raw, camera_);
  return {remapped(raw), mask_, camera_};
}

cv::Mat Undistortion::remapped(const cv::Mat& raw) const {
  if (map1_.empty()) return raw;
  cv::Mat result;
  cv::remap(raw, result, map1_, map2_, cv::INTER_LINEAR);
  return result;
}

}  // namespace gsv
