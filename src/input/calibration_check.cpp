#include "ground_scale_vo/input/calibration_check.hpp"

#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"

namespace ground_scale_vo {
namespace {

/// Principal points of cameras lie within 15 % of the centre, those of rectified stereo images
/// within 30 %. One factor in both coordinates is that of another size.
constexpr double kMinOtherSize = 1.15;  ///< ratio of two sizes that are told apart
constexpr double kSameFactor = 1.06;    ///< of both coordinates
constexpr double kLargeFactor = 1.35;   ///< from which both coordinates may differ by
constexpr double kSameLargeFactor = 1.12;
constexpr double kMaxAspect = 1.1;  ///< fy / fx of square pixels
constexpr double kOffCentre = 0.3;  ///< [half images]
/// [degrees] A principal point near the upper left corner is that of smaller images only if their
/// field of view is then that of a camera on a vehicle; else the images are cropped.
constexpr double kMinFieldOfView = 30;

/// x, y: the principal point over the centre of the image.
bool isOfOtherSize(const CameraCalibration& c, double x, double y) {
  if (!(x > 0 && y > 0) || c.is_part) return false;
  const double larger = std::min(x, y), smaller = 1 / std::max(x, y);
  const bool is_large = larger > kLargeFactor || smaller > kLargeFactor;
  if (std::max(x / y, y / x) > (is_large ? kSameLargeFactor : kSameFactor)) return false;
  const double fov = 2 * std::atan(c.cx / c.fx);  // of images whose centre is the principal point
  return larger > kMinOtherSize ||
         (smaller > kMinOtherSize && fov > kRadiansPerDegree * kMinFieldOfView);
}

[[noreturn]] void refuseSize(const CameraCalibration& c, const std::string& source,
                             const cv::Size& images) {
  const int factor = static_cast<int>(std::lround(1.0 * c.width / images.width));
  const auto isAbout = [factor](int whole, int part) {
    return std::abs(whole - factor * part) < factor;  // what is left over is cut off
  };
  std::string hint;
  if (c.width == images.height && c.height == images.width) {
    hint = ": calibrate with images that are turned alike";
  } else if (c.binning.width > 1 || c.binning.height > 1) {
    hint = " with its binning of " + sizeText(c.binning.width, c.binning.height) +
           ": if the calibration is of the binned images, set the binning to 1";
  } else if (factor > 1 && isAbout(c.width, images.width) && isAbout(c.height, images.height)) {
    hint = format(
        ": are the images binned by %d? Scale the calibration, or set the binning in "
        "camera_info",
        factor);
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
  if (isOfOtherSize(c, x, y)) {
    throw DataError(source + " is of another image size: its principal point (" +
                    format("%.4g, %.4g", c.cx, c.cy) + ") is the centre of images of about " +
                    sizeText(x * images.width, y * images.height) + ", the images are " +
                    sizeText(images.width, images.height));
  }
  const double aspect = std::max(c.fy / c.fx, c.fx / c.fy);
  if (aspect > kMaxAspect) {
    return "fx and fy of " + source + format(" (%.4g, %.4g) differ", c.fx, c.fy) +
           ": are the images scaled in one direction?";
  }
  if (c.is_part || (std::abs(x - 1) <= kOffCentre && std::abs(y - 1) <= kOffCentre)) return {};
  return "the principal point (" + format("%.4g, %.4g", c.cx, c.cy) + ") of " + source +
         " is far from the centre of the images of " + sizeText(images.width, images.height) +
         ": are they cropped?";
}

}  // namespace ground_scale_vo
