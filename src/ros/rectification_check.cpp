#include "ground_scale_vo/ros/rectification_check.hpp"

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <sstream>
#include <vector>

#include "ros/camera_info_values.hpp"

namespace ground_scale_vo {
namespace {

using Points = std::vector<cv::Point2d>;

/// Points per side of the grid that is mapped between the raw and the rectified image.
constexpr int kGrid = 9;
/// Least share of the rectified image that shows raw pixels. Rectifications that keep all raw
/// pixels have black corners.
constexpr double kMinFilled = 0.7;
/// Least share of the raw image that the rectified one shows. Rectifications without black corners
/// crop the raw image.
constexpr double kMinShown = 0.5;

/// Maps pixels between the raw image and the rectified one that R and P describe.
class Rectification {
 public:
  explicit Rectification(const sensor_msgs::CameraInfo& info)
      : is_fisheye_(isFisheye(info.distortion_model)),
        K_(info.K.data()),
        R_(info.R.data()),
        P_(info.P[0], info.P[1], info.P[2], info.P[4], info.P[5], info.P[6], info.P[8], info.P[9],
           info.P[10]),
        D_(info.D) {
    if (cv::norm(R_ * R_.t() - cv::Matx33d::eye()) > 1e-3) R_ = cv::Matx33d::eye();
    if (D_.empty()) D_.assign(4, 0.0);
  }

  Points rectify(const Points& raw) const {
    Points rectified;
    if (is_fisheye_) {
      cv::fisheye::undistortPoints(raw, rectified, K_, D_, R_, P_);
    } else {
      cv::undistortPoints(raw, rectified, K_, D_, R_, P_);
    }
    return rectified;
  }

  Points unrectify(const Points& rectified) const {
    const cv::Matx33d to_ray = R_.t() * P_.inv();
    std::vector<cv::Point3d> rays;
    for (const cv::Point2d& pixel : rectified) {
      rays.emplace_back(to_ray * cv::Vec3d(pixel.x, pixel.y, 1));
    }
    const cv::Vec3d zero(0, 0, 0);
    Points raw;
    if (is_fisheye_) {
      cv::fisheye::projectPoints(rays, raw, zero, zero, K_, D_);
    } else {
      cv::projectPoints(rays, zero, zero, K_, D_, raw);
    }
    return raw;
  }

 private:
  bool is_fisheye_;
  cv::Matx33d K_, R_, P_;
  std::vector<double> D_;
};

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
bool isRectificationOf(const sensor_msgs::CameraInfo& info) {
  if (!(info.P[0] > 0) || !(info.P[5] > 0) || info.P[10] != 1) return true;
  const cv::Size2d size(info.width, info.height);
  try {
    const Rectification rectification(info);
    return shareInside(rectification.unrectify(grid(size)), size) >= kMinFilled &&
           shareInside(rectification.rectify(grid(size)), size) >= kMinShown;
  } catch (const cv::Exception&) {
    return true;
  }
}

/// Whether the last part of the topic, without a trailing /compressed, contains the text.
bool hasPart(std::string topic, const std::string& part) {
  const std::string transport = "/compressed";
  if (topic.size() > transport.size() &&
      topic.compare(topic.size() - transport.size(), transport.size(), transport) == 0) {
    topic.resize(topic.size() - transport.size());
  }
  return topic.substr(topic.rfind('/') + 1).find(part) != std::string::npos;
}

}  // namespace

RectificationContradiction rectificationContradiction(const sensor_msgs::CameraInfo& info,
                                                      bool image_is_rectified,
                                                      const std::string& image_topic) {
  if (allZero(info.K) || allZero(info.P)) return {};
  const bool is_distorted = !allZero(info.D);
  bool is_certain = false;
  std::ostringstream reason;
  if (!image_is_rectified && !isRectificationOf(info)) {
    is_certain = !isFisheye(info.distortion_model);
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

}  // namespace ground_scale_vo
