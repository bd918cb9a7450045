#include "ground_scale_vo/input/camera.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "input/distortion_model.hpp"

namespace gsv {
namespace {

constexpr double kMaxSide = kMaxImageSide;  // [px]
constexpr double kMaxReadoutTime = 0.2;     // [s], that of the option odometry/readout_time

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

/// [image widths] A fisheye of 360 degrees has 0.16.
constexpr double kMinFocalLength = 0.1;
/// Standard deviation of k1, where it is not given: of a lens that was estimated from drives, and
/// of a published calibration.
constexpr double kEstimatedK1Sigma = 0.003, kPublishedK1Sigma = 0.02;

/// Numbers of coefficients without a name from which on they are those of plumb_bob: four may be
/// those of a fisheye lens.
constexpr std::size_t kMinUnnamed = 5;

/// [half images] Principal points of cameras without a stated image size lie this close to the
/// centre: KITTI 0.075, EuRoC 0.04, TUM 0.07, Cityscapes 0.07, nuScenes 0.09. Images of another
/// crop or aspect differ by 0.1 (16:9 of 16:10) and more.
constexpr double kCentred = 0.1;

/// Points per side of the grid on which two rectifications are compared.
constexpr int kComparedPoints = 5;
constexpr double kTolerancePx = 0.1;

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

void require(const cv::Mat& image, const PinholeCamera& camera, const std::string& name) {
  if (image.type() != CV_8UC1) throw OptionError(name + " is not 8-bit with one channel");
  if (image.cols == camera.width && image.rows == camera.height) return;
  throw OptionError(name + " is " + sizeText(image.cols, image.rows) + ", the camera " +
                    sizeText(camera.width, camera.height));
}

}  // namespace

double PinholeCamera::k1Sigma() const {
  if (k1_sigma > 0) return k1_sigma;
  return lens_is_estimated ? kEstimatedK1Sigma : kPublishedK1Sigma;
}

void PinholeCamera::validate() const {
  requireInRange("camera width [px]", width, 1, kMaxSide);
  requireInRange("camera height [px]", height, 1, kMaxSide);
  requireInRange("camera fx [px]", fx, 1, 10 * kMaxSide);
  requireInRange("camera fy [px]", fy, 1, 10 * kMaxSide);
  requireInRange("camera cx [px]", cx, -kMaxSide, kMaxSide);
  requireInRange("camera cy [px]", cy, -kMaxSide, kMaxSide);
  requireInRange("camera k1_sigma", k1_sigma, 0, 1);
}

bool isSameCamera(const PinholeCamera& a, const PinholeCamera& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
         a.cx == b.cx && a.cy == b.cy && a.lens_is_estimated == b.lens_is_estimated &&
         a.k1_sigma == b.k1_sigma;
}

void requireImage(const cv::Mat& image, const PinholeCamera& camera) {
  require(image, camera, "image");
}

void requireMask(const cv::Mat& mask, const PinholeCamera& camera, const std::string& name) {
  if (mask.empty()) return;
  require(mask, camera, name);
  if (cv::countNonZero(mask) == 0) {
    throw OptionError(name +
                      " hides the whole image: it is 0 where the images never show the scene");
  }
}

bool CameraCalibration::isDistorted() const {
  return model->counts.front() > 0 ||
         std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0; });
}

bool CameraCalibration::isPlumbBob() const {
  return model->is_brown_conrady && distortion.size() <= 5;
}

void CameraCalibration::setDistortion(const std::string& name,
                                      const std::vector<double>& coefficients) {
  const CameraCalibration undistorted;
  model = undistorted.model;
  distortion = coefficients;
  if (isDistorted() || !(name.empty() || name == "none")) {
    const std::string what = "the distortion model is \"" + name + "\"; ";
    const bool is_brown = name.empty() && coefficients.size() >= kMinUnnamed;
    model = &modelNamed(is_brown ? "plumb_bob" : name, &DistortionModel::names, what);
  }
  if (isDistorted()) return;
  model = undistorted.model;
  distortion.clear();
}

CameraCalibration::Pixels CameraCalibration::distorted(const Pixels& pixels) const {
  Pixels result;
  for (const cv::Point2d& u : pixels) {
    const Eigen::Vector2d x((u.x - cx) / fx, (u.y - cy) / fy);
    const Eigen::Vector2d d = model->distort(x, distortion, nullptr);
    result.emplace_back(fx * d.x() + cx, fy * d.y() + cy);
  }
  return result;
}

CameraCalibration::Pixels CameraCalibration::undistorted(const Pixels& pixels) const {
  Pixels points, result;
  for (const cv::Point2d& u : pixels) points.emplace_back((u.x - cx) / fx, (u.y - cy) / fy);
  model->undistort(points, distortion, &result);
  for (cv::Point2d& u : result) u = {fx * u.x + cx, fy * u.y + cy};
  return result;
}

void CameraCalibration::validate() const {
  CameraCalibration sized = *this;
  if (!hasSize() && width == 0 && height == 0) sized.width = sized.height = 1;
  pinholeOf(sized).validate();
  requireInRange("fy / fx", fy / fx, 0.1, 10);
  requireInRange("readout_time [s]", readout_time, 0, kMaxReadoutTime);
  model->validate(distortion);
  if (!hasSize() || is_part) return;
  requireInRange("width * height [px]", 1.0 * width * height, 1, kMaxImagePixels);
  requireInRange("fx [image widths]", fx / width, kMinFocalLength, 500);
  requireInRange("cx [image widths]", cx / width, -10, 10);
  requireInRange("cy [image heights]", cy / height, -10, 10);
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
  text << model->names.front() << ", D (";
  for (std::size_t i = 0; i < distortion.size(); ++i) text << (i > 0 ? ", " : "") << distortion[i];
  text << ")";
  return text.str();
}

bool isSameCalibration(const CameraCalibration& a, const CameraCalibration& b) {
  const auto same = [](double x, double y) { return std::abs(x - y) <= kTolerancePx; };
  if (a.width != b.width || a.height != b.height || !same(a.fx, b.fx) || !same(a.fy, b.fy) ||
      !same(a.cx, b.cx) || !same(a.cy, b.cy)) {
    return false;
  }
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

CameraCalibration withoutDistortion(const PinholeCamera& c) {
  CameraCalibration calibration{c.width, c.height, c.fx, c.fy, c.cx, c.cy};
  calibration.estimated = c.lens_is_estimated;
  calibration.k1_sigma = c.k1_sigma;
  return calibration;
}

PinholeCamera pinholeOf(const CameraCalibration& c) {
  return {c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.estimated, c.k1_sigma};
}

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
  if (!c.hasSize() && !(std::abs(x - 1) <= kCentred && std::abs(y - 1) <= kCentred)) {
    throw DataError(source + " states no image size, and its principal point " +
                    format("(%.4g, %.4g)", c.cx, c.cy) + " is not near the centre of images of " +
                    sizeText(images.width, images.height) +
                    ": if it is of images of this size, state that: width and height of "
                    "camera_info, image_width and image_height or Camera.width and Camera.height "
                    "in YAML, a line \"S0: WIDTH HEIGHT\" in calib.txt");
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

}  // namespace gsv
