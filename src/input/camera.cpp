#include "ground_scale_vo/input/camera.hpp"

#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/text.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kMaxSide = kMaxImageSide;  // [px]

void require(const cv::Mat& image, const PinholeCamera& camera, const std::string& name) {
  if (image.type() != CV_8UC1) throw OptionError(name + " is not 8-bit with one channel");
  if (image.cols == camera.width && image.rows == camera.height) return;
  throw OptionError(name + " is " + sizeText(image.cols, image.rows) + ", the camera " +
                    sizeText(camera.width, camera.height));
}

}  // namespace

void PinholeCamera::validate() const {
  requireInRange("camera width [px]", width, 1, kMaxSide);
  requireInRange("camera height [px]", height, 1, kMaxSide);
  requireInRange("camera fx [px]", fx, 1, 10 * kMaxSide);
  requireInRange("camera fy [px]", fy, 1, 10 * kMaxSide);
  requireInRange("camera cx [px]", cx, -kMaxSide, kMaxSide);
  requireInRange("camera cy [px]", cy, -kMaxSide, kMaxSide);
}

bool isSameCamera(const PinholeCamera& a, const PinholeCamera& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
         a.cx == b.cx && a.cy == b.cy && a.lens_is_estimated == b.lens_is_estimated;
}

void requireImage(const cv::Mat& image, const PinholeCamera& camera) {
  require(image, camera, "image");
}

void requireMask(const cv::Mat& mask, const PinholeCamera& camera, const std::string& name) {
  if (!mask.empty()) require(mask, camera, name);
}

}  // namespace ground_scale_vo
