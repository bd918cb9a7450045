#include "input/camera_info.hpp"

#include <algorithm>
#include <sstream>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "input/distortion_model.hpp"

namespace gsv {
namespace {

using Points = CameraCalibration::Pixels;

/// Whether K, D or P of camera_info is not set.
template <typename Range>
bool allZero(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

/// Calibration of the whole image without distortion, from K or P, which has 3 or 4 columns; the
/// last column of P, the offset of a stereo camera, is not used. Throws OptionError.
CameraCalibration wholeImage(const CameraInfo& info, const double* matrix, int columns) {
  const auto at = [&](int row, int column) { return matrix[row * columns + column]; };
  // The cast must not overflow; validate() refuses kMaxImageSide + 1.
  const auto side = [](std::uint32_t n) {
    return static_cast<int>(std::min(n, kMaxImageSide + 1));
  };
  CameraCalibration camera{side(info.width), side(info.height), at(0, 0),
                           at(1, 1),         at(0, 2),          at(1, 2)};
  if (camera.width > 0 || camera.height > 0) pinholeOf(camera).validate();
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw OptionError(std::string(columns == 4 ? "P" : "K") +
                      " is not of the form fx 0 cx, 0 fy cy, 0 0 1");
  }
  camera.validate();
  return camera;
}

/// From K and D. Throws OptionError.
CameraCalibration wholeRawImage(const CameraInfo& info) {
  CameraCalibration camera = wholeImage(info, info.K.data(), 3);
  camera.setDistortion(info.distortion_model, info.D);
  // Some drivers leave D of a fisheye camera empty.
  if (info.D.empty()) camera.distortion.assign(camera.model->counts.front(), 0.0);
  camera.validate();
  return camera;
}

/// With ROI and binning. Throws OptionError.
CameraCalibration ofImages(const CameraInfo& info, bool use_P) {
  CameraCalibration camera = use_P ? wholeImage(info, info.P.data(), 4) : wholeRawImage(info);
  if (!camera.hasSize()) return camera;
  const auto& roi = info.roi;
  const bool has_roi = roi.x_offset > 0 || roi.y_offset > 0 || roi.width > 0 || roi.height > 0;
  const cv::Rect2d whole(0, 0, info.width, info.height);
  const cv::Rect2d part =
      has_roi ? cv::Rect2d(roi.x_offset, roi.y_offset, roi.width, roi.height) : whole;
  const std::string image = "the image of " + sizeText(whole.width, whole.height);
  const std::string subject = part == whole ? image
                                            : "the ROI of " + sizeText(part.width, part.height) +
                                                  format(" at (%.0f, %.0f)", part.x, part.y);
  if (part.x + part.width > whole.width || part.y + part.height > whole.height) {
    throw OptionError(subject + " is not inside " + image);
  }
  const auto binning = [](std::uint32_t n) {
    return static_cast<int>(std::clamp(n, 1u, 2 * kMaxImageSide));
  };
  const cv::Size bin(binning(info.binning_x), binning(info.binning_y));
  if (part.width < bin.width || part.height < bin.height) {
    throw OptionError("a binning of " + sizeText(bin.width, bin.height) + " leaves no pixel of " +
                      subject);
  }
  camera.width = static_cast<int>(part.width) / bin.width;
  camera.height = static_cast<int>(part.height) / bin.height;
  camera.fx /= bin.width;
  camera.fy /= bin.height;
  camera.cx = (camera.cx - part.x) / bin.width;
  camera.cy = (camera.cy - part.y) / bin.height;
  camera.is_part = part != whole;
  camera.binning = bin;
  camera.validate();
  return camera;
}

/// Points per side of the grid that is mapped between the raw and the rectified image.
constexpr int kGrid = 9;
/// Least share of the rectified image that shows raw pixels. Rectifications that keep all raw
/// pixels have black corners.
constexpr double kMinFilled = 0.7;
/// Least share of the raw image that the rectified one shows. Rectifications without black corners
/// crop the raw image.
constexpr double kMinShown = 0.5;

Points grid(const cv::Size2d& size) {
  Points points;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    points.emplace_back((i % kGrid + 0.5) / kGrid * size.width,
                        (i / kGrid + 0.5) / kGrid * size.height);
  }
  return points;
}

double shareInside(const Points& points, const cv::Size2d& size) {
  const auto inside = std::count_if(points.begin(), points.end(), [&](const cv::Point2d& point) {
    return point.x >= 0 && point.y >= 0 && point.x < size.width && point.y < size.height;
  });
  return static_cast<double>(inside) / static_cast<double>(points.size());
}

/// Whether P can describe the rectified images of the camera of K, D and R. True if that cannot be
/// computed.
bool isRectificationOf(const CameraInfo& info) {
  if (!(info.P[0] > 0) || !(info.P[5] > 0) || info.P[10] != 1 || info.width == 0) return true;
  const cv::Size2d size(info.width, info.height);
  const cv::Matx33d K(info.K.data()), P(info.P[0], info.P[1], info.P[2], info.P[4], info.P[5],
                                        info.P[6], info.P[8], info.P[9], info.P[10]);
  cv::Matx33d R(info.R.data());
  if (cv::norm(R * R.t() - cv::Matx33d::eye()) > 1e-3) R = cv::Matx33d::eye();
  const cv::Matx33d rectification = P * R * K.inv();  // of undistorted pixels
  Points undistorted, rectified;
  try {
    const CameraCalibration raw = wholeRawImage(info);
    cv::perspectiveTransform(grid(size), undistorted, rectification.inv());
    cv::perspectiveTransform(raw.undistorted(grid(size)), rectified, rectification);
    return shareInside(raw.distorted(undistorted), size) >= kMinFilled &&
           shareInside(rectified, size) >= kMinShown;
  } catch (const OptionError&) {
    return true;
  }
}

/// Whether the last part of the topic, without a trailing /compressed, contains the text.
bool hasPart(const std::string& topic, const std::string& part) {
  const std::string transport = "/compressed";
  const std::size_t end = topic.rfind(transport);
  const std::string name = end + transport.size() == topic.size() ? topic.substr(0, end) : topic;
  return name.substr(name.rfind('/') + 1).find(part) != std::string::npos;
}

}  // namespace

CameraCalibration readCameraInfo(const CameraInfo& info, const std::string& topic,
                                 bool image_is_rectified) {
  const std::string subject = "camera_info on topic " + topic;
  if (!areFinite(info.K, info.P, info.D, info.R)) {
    throw DataError(subject + " has numbers that are not finite");
  }
  const bool has_K = !allZero(info.K), has_P = !allZero(info.P);
  if (!has_K && !has_P) {
    throw DataError(
        subject +
        " is all zeros: the camera is not calibrated; estimate its lens from a drive by "
        "`ground_scale_vo calibrate --fov DEGREES`, and use the result as the camera file");
  }
  if (image_is_rectified && !has_P) {
    throw DataError(subject + " has no P, which image_is_rectified requires");
  }
  try {
    return ofImages(info, image_is_rectified || !has_K);
  } catch (const OptionError& error) {
    throw DataError(subject + " cannot be used: " + error.what());
  }
}

RectificationContradiction rectificationContradiction(const CameraInfo& info,
                                                      bool image_is_rectified,
                                                      const std::string& image_topic) {
  if (allZero(info.K) || allZero(info.P)) return {};
  const bool is_distorted = !allZero(info.D);
  bool is_certain = false;
  std::ostringstream reason;
  if (!image_is_rectified && !isRectificationOf(info)) {
    is_certain = wholeRawImage(info).model->is_brown_conrady;
    reason << "P of camera_info (fx " << info.P[0] << ") cannot describe images of " << info.width
           << " x " << info.height << " that are rectified with K (fx " << info.K[0] << ") and D";
  } else if (!image_is_rectified && is_distorted && hasPart(image_topic, "rect")) {
    reason << "topic " << image_topic
           << " is named like rectified images, from which D of camera_info would be removed again";
  } else if (image_is_rectified && is_distorted && info.P[0] == info.K[0] &&
             info.P[2] == info.K[2] && info.P[6] == info.K[5]) {
    reason << "P of camera_info equals K (fx " << info.K[0]
           << ") although D is not zero, as for raw images";
  } else if (image_is_rectified && is_distorted && hasPart(image_topic, "raw") &&
             isRectificationOf(info)) {
    reason << "topic " << image_topic
           << " is named like raw images, and D of camera_info is not zero";
  }
  return {reason.str(), is_certain};
}

}  // namespace gsv
