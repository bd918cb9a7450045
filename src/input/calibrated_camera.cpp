#include "ground_scale_vo/input/calibrated_camera.hpp"

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/text.hpp"

namespace ground_scale_vo {
namespace {

/// Points per side of the grid on which two rectifications are compared.
constexpr int kComparedPoints = 5;
constexpr double kTolerancePx = 0.1;

cv::Matx33d matrixOf(const CameraCalibration& c) { return {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1}; }

bool areClose(const PinholeCamera& a, const PinholeCamera& b) {
  const auto same = [](double x, double y) { return std::abs(x - y) <= kTolerancePx; };
  return a.width == b.width && a.height == b.height && same(a.fx, b.fx) && same(a.fy, b.fy) &&
         same(a.cx, b.cx) && same(a.cy, b.cy);
}

/// Pixel of the raw image that a pixel of the rectified one shows.
cv::Point2d distortedPixel(const CameraCalibration& camera, const cv::Point2d& rectified) {
  const cv::Matx33d K = matrixOf(camera);
  const cv::Point2d x((rectified.x - camera.cx) / camera.fx, (rectified.y - camera.cy) / camera.fy);
  std::vector<cv::Point2d> pixel;
  if (camera.is_fisheye) {
    cv::fisheye::distortPoints(std::vector<cv::Point2d>{x}, pixel, K, camera.distortion);
  } else {
    cv::projectPoints(std::vector<cv::Point3d>{{x.x, x.y, 1}}, cv::Vec3d(), cv::Vec3d(), K,
                      camera.distortion, pixel);
  }
  return pixel.front();
}

const CameraCalibration& valid(const CameraCalibration& calibration) {
  calibration.validate();
  if (!calibration.hasSize()) throw OptionError("the image size of the calibration is not known");
  return calibration;
}

}  // namespace

Undistortion::Undistortion(const CameraCalibration& camera) : size_(camera.width, camera.height) {
  if (!camera.isDistorted()) return;
  const cv::Matx33d K = matrixOf(camera);
  if (camera.is_fisheye) {
    cv::fisheye::initUndistortRectifyMap(K, camera.distortion, cv::Matx33d::eye(), K, size_,
                                         CV_16SC2, map1_, map2_);
  } else {
    cv::initUndistortRectifyMap(K, camera.distortion, cv::noArray(), K, size_, CV_16SC2, map1_,
                                map2_);
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
  if (calibration_.hasLens()) return;
  given_.distortion.clear();
  given_.is_fisheye = false;
}

cv::Mat CalibratedCamera::given(const cv::Mat& raw) const {
  return isGivenRectified() ? undistortion_.image(raw) : raw;
}

cv::Mat CalibratedCamera::givenMask(const cv::Mat& raw_mask) const {
  return isGivenRectified() ? undistortion_.mask(raw_mask) : raw_mask;
}

bool isSameCalibration(const CameraCalibration& a, const CameraCalibration& b) {
  if (a == b) return true;
  if (!areClose(pinholeOf(a), pinholeOf(b))) return false;
  if (!a.isDistorted() && !b.isDistorted()) return true;
  const double last = kComparedPoints - 1;
  for (int i = 0; i < kComparedPoints * kComparedPoints; ++i) {
    const cv::Point2d rectified((a.width - 1) * (i % kComparedPoints / last),
                                (a.height - 1) * (i / kComparedPoints / last));
    if (!(cv::norm(distortedPixel(a, rectified) - distortedPixel(b, rectified)) <= kTolerancePx)) {
      return false;
    }
  }
  return true;
}

}  // namespace ground_scale_vo
