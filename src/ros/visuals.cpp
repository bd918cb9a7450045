#include "ground_scale_vo/ros/visuals.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Geometry>
#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

/// [m] how far the quad's centre lies before the camera, its length and width.
constexpr double kQuadAhead = 5.0;
constexpr double kQuadLength = 16.0;
constexpr double kQuadWidth = 8.0;
constexpr double kArrowWidth = 0.25;

cv::Point toPixel(const Eigen::Vector2f& u) { return {cvRound(u.x()), cvRound(u.y())}; }

visualization_msgs::Marker::Ptr marker(const std_msgs::Header& header, int id, int type) {
  auto marker = boost::make_shared<visualization_msgs::Marker>();
  marker->header = header;
  marker->ns = "ground_plane";
  marker->id = id;
  marker->type = type;
  marker->action = visualization_msgs::Marker::ADD;
  return marker;
}

}  // namespace

sensor_msgs::Image::Ptr TrackPainter::paint(const cv::Mat& grey, const VoFrame& frame,
                                            const std_msgs::Header& header) {
  const cv::Scalar with_point(80, 220, 80), without_point(0, 200, 255);
  cv::Mat picture;
  cv::cvtColor(grey, picture, cv::COLOR_GRAY2BGR);
  std::map<std::uint64_t, Eigen::Vector2f> now;
  for (const TrackedFeature& feature : frame.features) {
    const cv::Scalar& colour = feature.has_point ? with_point : without_point;
    const auto before = last_.find(feature.id);
    if (before != last_.end()) {
      cv::line(picture, toPixel(before->second), toPixel(feature.u), colour, 1, cv::LINE_AA);
    }
    cv::circle(picture, toPixel(feature.u), 2, colour, cv::FILLED, cv::LINE_AA);
    now.emplace_hint(now.end(), feature.id, feature.u);
  }
  last_.swap(now);
  return cv_bridge::CvImage(header, sensor_msgs::image_encodings::BGR8, picture).toImageMsg();
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header) {
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  sensor_msgs::PointCloud2Iterator<float> x(*cloud, "x"), y(*cloud, "y"), z(*cloud, "z");
  for (const Eigen::Vector3f& point : points) {
    *x = point.x();
    *y = point.y();
    *z = point.z();
    ++x, ++y, ++z;
  }
  cloud->is_dense = true;
  return cloud;
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header) {
  std::vector<Eigen::Vector3f> points;
  for (const TrackedFeature& feature : frame.features) {
    if (feature.has_point) points.push_back(feature.p_c);
  }
  return toPointCloud(points, header);
}

std::vector<visualization_msgs::Marker::Ptr> toPlaneMarkers(const ScaleEstimate& scale,
                                                            const std_msgs::Header& header) {
  const Eigen::Vector3d up = scale.n_c;
  const Eigen::Vector3d foot = -scale.scale * scale.height * up;
  const Eigen::Vector3d forward = (Eigen::Vector3d::UnitZ() - up.z() * up).normalized();

  Eigen::Isometry3d T_c_quad = Eigen::Isometry3d::Identity();
  T_c_quad.linear().col(0) = forward;
  T_c_quad.linear().col(1) = up.cross(forward);
  T_c_quad.linear().col(2) = up;
  T_c_quad.translation() = foot + kQuadAhead * forward;

  const auto quad = marker(header, 0, visualization_msgs::Marker::CUBE);
  quad->pose = toMsg(T_c_quad);
  quad->scale.x = kQuadLength;
  quad->scale.y = kQuadWidth;
  quad->scale.z = 0.01;
  quad->color.r = 0.2f;
  quad->color.g = 0.6f;
  quad->color.b = 1.0f;
  quad->color.a = scale.status == ScaleStatus::kOk ? 0.5f : 0.25f;

  Eigen::Isometry3d T_c_arrow = Eigen::Isometry3d::Identity();
  T_c_arrow.linear().col(0) = up;
  T_c_arrow.linear().col(1) = forward;
  T_c_arrow.linear().col(2) = up.cross(forward);
  T_c_arrow.translation() = foot;

  const auto arrow = marker(header, 1, visualization_msgs::Marker::ARROW);
  arrow->pose = toMsg(T_c_arrow);
  arrow->scale.x = scale.scale * scale.height;
  arrow->scale.y = kArrowWidth;
  arrow->scale.z = kArrowWidth;
  arrow->color.r = 1.0f;
  arrow->color.g = 0.8f;
  arrow->color.b = 0.1f;
  arrow->color.a = 1.0f;
  return {quad, arrow};
}

}  // namespace ground_scale_vo
