#include "ground_scale_vo/input/camera_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <tuple>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/image_limits.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kMaxReadoutTime = 0.2;  // [s], that of the option odometry/readout_time
constexpr double kMaxCoefficient = 1e3;

bool isZero(double value) { return value == 0; }

bool isOneOf(const std::string& name, std::initializer_list<const char*> names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

void requireCoefficients(const CameraCalibration& calibration) {
  const std::size_t n = calibration.distortion.size();
  const std::vector<std::size_t> counts = calibration.is_fisheye
                                              ? std::vector<std::size_t>{4}
                                              : std::vector<std::size_t>{0, 4, 5, 8, 12, 14};
  if (std::find(counts.begin(), counts.end(), n) == counts.end()) {
    throw OptionError(calibration.is_fisheye
                          ? "equidistant distortion has 4 coefficients, not " + std::to_string(n)
                          : "plumb_bob or rational_polynomial distortion has 4, 5, 8, 12 or 14 "
                            "coefficients, not " +
                                std::to_string(n));
  }
  for (const double k : calibration.distortion) {
    requireInRange("distortion coefficient", k, -kMaxCoefficient, kMaxCoefficient);
  }
}

}  // namespace

bool CameraCalibration::isDistorted() const {
  return is_fisheye || !std::all_of(distortion.begin(), distortion.end(), isZero);
}

void CameraCalibration::validate() const {
  CameraCalibration sized = *this;
  if (!hasSize() && width == 0 && height == 0) sized.width = sized.height = 1;
  pinholeOf(sized).validate();
  requireInRange("fy / fx", fy / fx, 0.1, 10);
  requireInRange("readout_time [s]", readout_time, 0, kMaxReadoutTime);
  requireCoefficients(*this);
  if (!hasSize() || is_part) return;
  requireInRange("width * height [px]", 1.0 * width * height, 1, kMaxImagePixels);
  requireInRange("fx [image widths]", fx / width, 0.02, 500);
  requireInRange("cx [image widths]", cx / width, -10, 10);
  requireInRange("cy [image heights]", cy / height, -10, 10);
}

CameraCalibration CameraCalibration::ofPart(const cv::Rect2d& roi, const cv::Size& bin) const {
  const bool is_whole = roi.x == 0 && roi.y == 0 && roi.width == width && roi.height == height;
  const std::string image = "the image of " + sizeText(width, height);
  const std::string subject = is_whole ? image
                                       : "the ROI of " + sizeText(roi.width, roi.height) + " at (" +
                                             std::to_string(static_cast<long long>(roi.x)) + ", " +
                                             std::to_string(static_cast<long long>(roi.y)) + ")";
  if (roi.x + roi.width > width || roi.y + roi.height > height) {
    throw OptionError(subject + " is not inside " + image);
  }
  if (roi.width < bin.width || roi.height < bin.height) {
    throw OptionError("a binning of " + sizeText(bin.width, bin.height) + " leaves no pixel of " +
                      subject);
  }
  CameraCalibration part = *this;
  part.width = static_cast<int>(roi.width) / bin.width;
  part.height = static_cast<int>(roi.height) / bin.height;
  part.fx = fx / bin.width;
  part.fy = fy / bin.height;
  part.cx = (cx - roi.x) / bin.width;
  part.cy = (cy - roi.y) / bin.height;
  part.is_part = is_part || !is_whole;
  part.binning = bin;
  return part;
}

std::string CameraCalibration::describe() const {
  std::ostringstream text;
  text.precision(10);
  if (hasSize()) text << sizeText(width, height) << ", ";
  text << "fx " << fx << ", fy " << fy << ", cx " << cx << ", cy " << cy << ", ";
  if (!isDistorted()) {
    text << "no distortion";
    return text.str();
  }
  text << (is_fisheye               ? "equidistant"
           : distortion.size() <= 5 ? "plumb_bob"
                                    : "rational_polynomial")
       << ", D (";
  for (std::size_t i = 0; i < distortion.size(); ++i) text << (i > 0 ? ", " : "") << distortion[i];
  text << ")";
  return text.str();
}

bool operator==(const CameraCalibration& a, const CameraCalibration& b) {
  const auto values = [](const CameraCalibration& c) {
    return std::tie(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion, c.estimated,
                    c.readout_time, c.is_fisheye, c.is_part, c.binning.width, c.binning.height);
  };
  return values(a) == values(b);
}

CameraCalibration calibrationOf(const PinholeCamera& c) {
  CameraCalibration calibration{c.width, c.height, c.fx, c.fy, c.cx, c.cy};
  calibration.estimated = c.lens_is_estimated;
  return calibration;
}

PinholeCamera pinholeOf(const CameraCalibration& c) {
  return {c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.estimated};
}

CameraCalibration ofFieldOfView(double degrees, const cv::Size& size) {
  requireInRange("the field of view [degrees]", degrees, 10, 150);
  const double f = 0.5 * size.width / std::tan(0.5 * kRadiansPerDegree * degrees);
  return {size.width, size.height, f, f, 0.5 * (size.width - 1), 0.5 * (size.height - 1)};
}

bool isFisheyeModel(const std::string& name) {
  return isOneOf(name, {"equidistant", "fisheye", "kannala_brandt", "KANNALA_BRANDT"});
}

void setDistortionModel(const std::string& name, CameraCalibration* calibration) {
  calibration->is_fisheye = isFisheyeModel(name);
  if (calibration->is_fisheye || isOneOf(name, {"plumb_bob", "rational_polynomial", "radtan"})) {
    return;
  }
  if (isOneOf(name, {"", "none"}) && !calibration->isDistorted()) {
    return calibration->distortion.clear();
  }
  throw OptionError("the distortion model is \"" + name +
                    "\"; supported are plumb_bob, rational_polynomial and equidistant");
}

}  // namespace ground_scale_vo
