#include "ros/visuals.hpp"

#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <unordered_set>

#include "ground_scale_vo/ros/conversions.hpp"
#include "scale/road.hpp"

namespace gsv {
namespace {

/// [m] distance of the quad's centre ahead of the camera, its length and width.
constexpr double kQuadAhead = 5.0, kQuadLength = 16.0, kQuadWidth = 8.0;

/// [m] extent of the ground grid ahead and to either side, and its least depth in the camera frame.
constexpr int kGridFrom = 2, kGridTo = 20, kGridSide = 3;
constexpr double kGridMinDepth = 0.5;

constexpr double kBrightness = 0.7;  // of the background image
constexpr double kOldest = 100;      // [frames] older features have the same colour
constexpr double kYoungest = 0.28;   // position in the colour map, whose start is too dark
const cv::Scalar kOutlierColour(30, 30, 255), kNotFoundColour(200, 130, 255);
const cv::Scalar kMaskColour(150, 40, 110);
const cv::Scalar kMeasuredColour(60, 230, 60), kHeldColour(40, 170, 255),
    kOtherColour(170, 170, 170);
const cv::Scalar kTextColour(230, 230, 230), kTextBackground(25, 25, 25);

/// Colour of an age [frames], logarithmic; older is brighter.
cv::Scalar ageColour(double age) {
  static const cv::Mat colours = [] {
    cv::Mat ramp(1, 256, CV_8UC1), result;
    for (int i = 0; i < ramp.cols; ++i) ramp.at<uchar>(i) = static_cast<uchar>(i);
    cv::applyColorMap(ramp, result, cv::COLORMAP_VIRIDIS);
    return result;
  }();
  const double position = std::min(1.0, std::log1p(age) / std::log1p(kOldest));
  const int index = cvRound(255 * (kYoungest + (1 - kYoungest) * position));
  return colours.at<cv::Vec3b>(index);
}

/// A colour image to draw on. Positions of marks are pixels; sizes, and all of the text in the
/// upper left corner, are pixels of an image of ordinary width: in a wider one, which viewers show
/// reduced, they grow with the width, in one that is narrower than the text they shrink.
class Canvas {
 public:
  /// The image darker, its masked pixels tinted.
  explicit Canvas(const CameraImage& image)
      : zoom_(std::max(image.grey.cols / kUnscaledWidth,
                       std::min(1.0, image.grey.cols / kTextWidth))) {
    image.grey.convertTo(image_, CV_8U, kBrightness);
    cv::cvtColor(image_, image_, cv::COLOR_GRAY2BGR);
    if (image.mask.empty()) return;
    cv::Mat tinted;
    cv::addWeighted(image_, 0.5, cv::Mat(image_.size(), image_.type(), kMaskColour), 0.5, 0,
                    tinted);
    tinted.copyTo(image_, image.mask == 0);
  }

  cv::Mat& image() { return image_; }
  int scaled(double length) const { return std::max(1, cvRound(zoom_ * length)); }

  void dot(const cv::Point& at, const cv::Scalar& colour, bool filled) {
    cv::circle(image_, at, scaled(3), colour, filled ? cv::FILLED : scaled(1), cv::LINE_AA);
  }
  void text(const std::string& text, const cv::Point& at, const cv::Scalar& colour = kTextColour) {
    cv::putText(image_, text, at, cv::FONT_HERSHEY_SIMPLEX, zoom_ * kTextSize, colour, scaled(1),
                cv::LINE_AA);
  }

  /// Writes in the row at the top from x on. Returns the end of the text.
  double writeInRow(double x, const std::string& line, const cv::Scalar& colour = kTextColour) {
    if (x == 0) {
      cv::rectangle(image_, {0, 0, scaled(kTextWidth), scaled(19)}, kTextBackground, cv::FILLED);
    }
    text(line, {scaled(x + kTextMargin), scaled(14)}, colour);
    return x + kTextMargin +
           cv::getTextSize(line, cv::FONT_HERSHEY_SIMPLEX, kTextSize, 1, nullptr).width;
  }

 private:
  static constexpr double kUnscaledWidth = 800, kTextWidth = 462, kTextSize = 0.36, kTextMargin = 8;

  double zoom_;
  cv::Mat image_;
};

/// Ages in their colours, and what the crosses are.
void drawLegend(Canvas& canvas) {
  double x = canvas.writeInRow(0, "age [frames]");
  for (const int age : {0, 1, 3, 10, 30, 100}) {
    x = canvas.writeInRow(x, std::to_string(age), ageColour(age));
  }
  x = canvas.writeInRow(x, "outlier", kOutlierColour);
  canvas.writeInRow(x, "not found", kNotFoundColour);
}

cv::Point toPixel(const Eigen::Vector2f& u) { return {cvRound(u.x()), cvRound(u.y())}; }

/// Frame on the ground below the camera: x in viewing direction, y left, z up.
Eigen::Isometry3d groundAxes(const ScaleEstimate& scale) {
  Eigen::Isometry3d T_c_ground = Eigen::Isometry3d::Identity();
  T_c_ground.linear() = roadAxes(scale.n_c);
  T_c_ground.translation() = -scale.scale * scale.height * scale.n_c;
  return T_c_ground;
}

/// A grid of 1 m on the ground plane, labelled every 5 m.
void drawGroundGrid(Canvas& canvas, const PinholeCamera& camera, const ScaleEstimate& scale) {
  const Eigen::Isometry3d T_c_ground = groundAxes(scale);
  const auto pixel = [&](double ahead, double left) {
    const Eigen::Vector2d u = camera.project(T_c_ground * Eigen::Vector3d(ahead, left, 0));
    // Clamp so that an int holds pixels far outside the image.
    return cv::Point(cvRound(std::clamp(u.x(), -1e4, 1e4)), cvRound(std::clamp(u.y(), -1e4, 1e4)));
  };
  // Start where the plane is in front of the camera, which may look up or down.
  int from = kGridFrom;
  while (from < kGridTo && (T_c_ground * Eigen::Vector3d(from, 0, 0)).z() < kGridMinDepth) ++from;
  const cv::Scalar colour = scale.status == ScaleStatus::kOk ? kMeasuredColour : kHeldColour;
  cv::Mat grid = canvas.image().clone();
  for (int left = -kGridSide; left <= kGridSide; ++left) {
    cv::line(grid, pixel(from, left), pixel(kGridTo, left), colour, canvas.scaled(1), cv::LINE_AA);
  }
  for (int ahead = from; ahead <= kGridTo; ++ahead) {
    cv::line(grid, pixel(ahead, -kGridSide), pixel(ahead, kGridSide), colour,
             canvas.scaled(ahead % 5 ? 1 : 2), cv::LINE_AA);
  }
  cv::addWeighted(canvas.image(), 0.5, grid, 0.5, 0, canvas.image());
  for (int ahead = 5; ahead <= kGridTo; ahead += 5) {
    if (ahead < from) continue;
    canvas.text(std::to_string(ahead) + " m",
                pixel(ahead, -kGridSide) + cv::Point(canvas.scaled(4), canvas.scaled(4)));
  }
}

void drawScale(Canvas& canvas, const ScaleEstimate& scale) {
  std::string text = toString(scale.status);
  if (scale.source == ScaleSource::kSpeed) text += " by speeds";
  if (scale.source == ScaleSource::kBoth) text += " by road and speeds";
  if (scale.measurement != MeasurementStatus::kMeasured)
    text += std::string(", ") + toString(scale.measurement);
  if (scale.status != ScaleStatus::kUnknown) {
    text +=
        cv::format(": %.4g m per VO unit +- %.1f %%", scale.scale, 100 * scale.sigma / scale.scale);
  }
  canvas.writeInRow(0, text);
}

}  // namespace

sensor_msgs::Image::Ptr paintTracks(const CameraImage& image, const VoFrame& frame,
                                    const VoFrame* previous,
                                    const std::vector<RejectedFeature>& rejected,
                                    const std_msgs::Header& header) {
  Canvas canvas(image);
  const std::vector<TrackedFeature> none;
  const std::vector<TrackedFeature>& old = previous ? previous->features : none;
  auto before = old.begin();  // both are in the order of their ids
  for (const TrackedFeature& feature : frame.features) {
    const cv::Scalar colour = ageColour(feature.age);
    while (before != old.end() && before->id < feature.id) ++before;
    if (before != old.end() && before->id == feature.id) {
      cv::line(canvas.image(), toPixel(before->u), toPixel(feature.u), colour, canvas.scaled(1),
               cv::LINE_AA);
    }
    canvas.dot(toPixel(feature.u), colour, feature.has_point);
  }
  for (const RejectedFeature& feature : rejected) {
    const bool is_outlier = feature.is_outlier;
    cv::drawMarker(canvas.image(), toPixel(feature.u),
                   is_outlier ? kOutlierColour : kNotFoundColour, cv::MARKER_TILTED_CROSS,
                   canvas.scaled(is_outlier ? 7 : 5), canvas.scaled(1));
  }
  drawLegend(canvas);
  return toMsg(canvas.image(), sensor_msgs::image_encodings::BGR8, header);
}

sensor_msgs::Image::Ptr paintRoad(const CameraImage& image, const VoFrame& frame,
                                  const ScaleRecovery::Output& output,
                                  const std_msgs::Header& header) {
  Canvas canvas(image);
  if (hasGroundPlane(output.scale)) drawGroundGrid(canvas, frame.camera, output.scale);
  const std::unordered_set<std::uint64_t> ground(output.ground_feature_ids.begin(),
                                                 output.ground_feature_ids.end());
  for (const TrackedFeature& feature : frame.features) {
    if (!feature.has_point) continue;
    const bool on_ground = ground.count(feature.id) > 0;
    canvas.dot(toPixel(feature.u), on_ground ? kMeasuredColour : kOtherColour, on_ground);
  }
  drawScale(canvas, output.scale);
  return toMsg(canvas.image(), sensor_msgs::image_encodings::BGR8, header);
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header, double scale) {
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  cloud->is_dense = true;
  if (points.empty()) return cloud;  // an iterator would refer to the first byte of no data
  sensor_msgs::PointCloud2Iterator<float> x(*cloud, "x");
  for (const Eigen::Vector3f& point : points) {
    for (int k = 0; k < 3; ++k) x[k] = static_cast<float>(scale) * point[k];
    ++x;
  }
  return cloud;
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header,
                                           double scale) {
  std::vector<Eigen::Vector3f> points;
  for (const TrackedFeature& feature : frame.features) {
    if (feature.has_point) points.push_back(feature.p_c);
  }
  return toPointCloud(points, header, scale);
}

bool hasGroundPlane(const ScaleEstimate& scale) {
  return scale.status != ScaleStatus::kUnknown && scale.height > 0 && !scale.n_c.isZero();
}

visualization_msgs::Marker::Ptr toPlaneMarker(const ScaleEstimate& scale,
                                              const std_msgs::Header& header) {
  auto quad = boost::make_shared<visualization_msgs::Marker>();
  quad->header = header;
  quad->ns = "ground_plane";
  quad->type = visualization_msgs::Marker::CUBE;
  quad->action = visualization_msgs::Marker::ADD;
  quad->pose =
      gsv::toMsg(groundAxes(scale) * Eigen::Translation3d(kQuadAhead * Eigen::Vector3d::UnitX()));
  quad->scale.x = kQuadLength;
  quad->scale.y = kQuadWidth;
  quad->scale.z = 0.01;
  quad->color.r = 0.2f;
  quad->color.g = 0.6f;
  quad->color.b = 1.0f;
  quad->color.a = scale.status == ScaleStatus::kOk ? 0.5f : 0.25f;
  return quad;
}

}  // namespace gsv
