#include "ground_scale_vo/vo/camera.hpp"

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// [px] largest side of an image: far above any camera, so larger values are errors.
constexpr double kMaxPixels = 1e5;

}  // namespace

void PinholeCamera::validate() const {
  requireInRange("camera width [px]", width, 1, kMaxPixels);
  requireInRange("camera height [px]", height, 1, kMaxPixels);
  requireInRange("camera fx [px]", fx, 1, 10 * kMaxPixels);
  requireInRange("camera fy [px]", fy, 1, 10 * kMaxPixels);
  requireInRange("camera cx [px]", cx, -kMaxPixels, kMaxPixels);
  requireInRange("camera cy [px]", cy, -kMaxPixels, kMaxPixels);
}

Rectifier::Rectifier(const PinholeCamera& raw, DistortionModel model,
                     const std::vector<double>& coefficients)
    : camera_(raw) {
  raw.validate();
  for (const double k : coefficients) requireInRange("distortion coefficient", k, -1e3, 1e3);
  if (model == DistortionModel::kNone) return;

  const cv::Matx33d K(raw.fx, 0, raw.cx, 0, raw.fy, raw.cy, 0, 0, 1);
  const cv::Size size(raw.width, raw.height);
  if (model == DistortionModel::kEquidistant) {
    if (coefficients.size() != 4) {
      throw OptionError("equidistant distortion has 4 coefficients, not " +
                        std::to_string(coefficients.size()));
    }
    cv::fisheye::initUndistortRectifyMap(K, coefficients, cv::Matx33d::eye(), K, size, CV_16SC2,
                                         map1_, map2_);
    return;
  }
  const std::size_t n = coefficients.size();
  if (n != 4 && n != 5 && n != 8 && n != 12 && n != 14) {
    throw OptionError(
        "plumb_bob or rational_polynomial distortion has 4, 5, 8, 12 or 14 "
        "coefficients, not " +
        std::to_string(n));
  }
  cv::initUndistortRectifyMap(K, coefficients, cv::Matx33d::eye(), K, size, CV_16SC2, map1_, map2_);
}

cv::Mat Rectifier::rectify(const cv::Mat& raw) const {
  requireImage(raw, camera_);
  if (map1_.empty()) return raw;
  cv::Mat rectified;
  cv::remap(raw, rectified, map1_, map2_, cv::INTER_LINEAR);
  return rectified;
}

void requireImage(const cv::Mat& image, const PinholeCamera& camera) {
  if (image.type() != CV_8UC1) throw OptionError("image is not 8-bit with one channel");
  if (image.cols == camera.width && image.rows == camera.height) return;
  throw OptionError("image is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                    ", the camera " + std::to_string(camera.width) + "x" +
                    std::to_string(camera.height));
}

}  // namespace ground_scale_vo
