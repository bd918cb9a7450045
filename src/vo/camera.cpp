#include "ground_scale_vo/vo/camera.hpp"

#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// [px] largest side of an image: far above any camera, so larger values are errors.
constexpr double kMaxPixels = 1e5;

void require(const cv::Mat& image, const PinholeCamera& camera, const std::string& name) {
  if (image.type() != CV_8UC1) throw OptionError(name + " is not 8-bit with one channel");
  if (image.cols == camera.width && image.rows == camera.height) return;
  throw OptionError(name + " is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                    ", the camera " + std::to_string(camera.width) + "x" +
                    std::to_string(camera.height));
}

}  // namespace

void PinholeCamera::validate() const {
  requireInRange("camera width [px]", width, 1, kMaxPixels);
  requireInRange("camera height [px]", height, 1, kMaxPixels);
  requireInRange("camera fx [px]", fx, 1, 10 * kMaxPixels);
  requireInRange("camera fy [px]", fy, 1, 10 * kMaxPixels);
  requireInRange("camera cx [px]", cx, -kMaxPixels, kMaxPixels);
  requireInRange("camera cy [px]", cy, -kMaxPixels, kMaxPixels);
}

void requireImage(const cv::Mat& image, const PinholeCamera& camera) {
  require(image, camera, "image");
}

void requireMask(const cv::Mat& mask, const PinholeCamera& camera, const std::string& name) {
  if (!mask.empty()) require(mask, camera, name);
}

}  // namespace ground_scale_vo
