#include "ground_scale_vo/input/calibration_check.hpp"

#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"

namespace ground_scale_vo {
namespace {

/// Principal points of cameras lie within 15 % of the centre, those of rectified stereo images
/// within 30 %.
constexpr double kMinOtherSize = 1.35;  ///< ratio of two sizes that are told apart
constexpr double kSameFactor = 1.12;    ///< of both coordinates
constexpr double kOffCentre = 0.3;      ///< [half images]

bool isOtherFactor(double factor) {
  return factor > kMinOtherSize || (factor > 0 && factor < 1 / kMinOtherSize);
}

[[noreturn]] void refuseSize(const CameraCalibration& c, const std::string& source,
                             const cv::Size& images) {
  const double kx = 1.0 * c.width / images.width, ky = 1.0 * c.height / images.height;
  std::string hint;
  if (c.width == images.height && c.height == images.width) {
    hint = ": calibrate with images that are turned alike";
  } else if (kx == ky && kx == std::floor(kx) && kx > 1) {
    hint = format(": are the images binned by %.0f? Scale the calibration, or set the binning in "
                  "camera_info", kx);
  }
  throw DataError("the images are " + sizeText(images.width, images.height) + ", but " + source +
                  " describes " + sizeText(c.width, c.height) + hint);
}

}  // namespace

std::string checkCalibration(const CameraCalibration& c, const std::string& source,
                             const cv::Size& images) {
  if (c.hasSize() && (c.width != images.width || c.height != images.height)) {
    refuseSize(c, source, images);
  }
  const double x = (c.cx + 0.5) / (0.5 * images.width), y = (c.cy + 0.5) / (0.5 * images.height);
  const double difference = x > 0 && y > 0 ? std::max(x / y, y / x) : INFINITY;
  if (!c.is_part && isOtherFactor(x) && isOtherFactor(y) && difference < kSameFactor) {
    throw DataError(source + " is of another image size: its principal point (" +
                    format("%.4g, %.4g", c.cx, c.cy) + ") is the centre of images of about " +
                    sizeText(x * images.width, y * images.height) + ", the images are " +
                    sizeText(images.width, images.height));
  }
  if (c.is_part || (std::abs(x - 1) <= kOffCentre && std::abs(y - 1) <= kOffCentre)) return {};
  return "the principal point (" + format("%.4g, %.4g", c.cx, c.cy) + ") of " + source +
         " is far from the centre of the images of " + sizeText(images.width, images.height) +
         ": are they cropped?";
}

}  // namespace ground_scale_vo
