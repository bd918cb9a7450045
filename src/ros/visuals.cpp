#include "ground_scale_vo/ros/visuals.hpp"

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
#include "ground_scale_vo/ros/image_message.hpp"

namespace ground_scale_vo {
namespace {

/// [m] distance of the quad's centre ahead of the camera, its length and width.
constexpr double kQuadAhead = 5.0;
constexpr double kQuadLength = 16.0;
constexpr double kQuadWidth = 8.0;
constexpr double kArrowWidth = 0.25;

/// [m] extent of the ground grid ahead and to either side, and its least depth in the camera frame.
constexpr int kGridFrom = 2, kGridTo = 20, kGridSide = 3;
constexpr double kGridMinDepth = 0.5;
const cv::Size kLabelSize(32, 11);  ///< [px] of a distance

/// [px] Image width up to which text and marks have the sizes given in this file. In a wider image,
/// which viewers show reduced, they grow with the width.
constexpr double kUnscaledWidth = 800;

constexpr double kBrightness = 0.7;  // of the background image
constexpr double kOldest = 100;      // [frames] older features have the same colour
constexpr double kYoungest = 0.28;   // position in the colour map, whose start is too dark
const cv::Scalar kOutlierColour(30, 30, 255), kNotFoundColour(200, 130, 255);
const cv::Scalar kMaskColour(150, 40, 110);
const cv::Scalar kMeasuredColour(60, 230, 60), kHeldColour(40, 170, 255),
    kOtherColour(170, 170, 170);
constexpr int kBoxWidth = 462, kBoxHeight = 34;  // [px] of the texts in the upper left corner
const cv::Scalar kLegendText(230, 230, 230), kLegendBackground(25, 25, 25);

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

/// The background: the image darker, its masked pixels tinted.
cv::Mat background(const cv::Mat& grey, const cv::Mat& mask) {
  cv::Mat image;
  grey.convertTo(image, CV_8U, kBrightness);
  cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  if (mask.empty()) return image;
  cv::Mat tinted;
  cv::addWeighted(image, 0.5, cv::Mat(image.size(), image.type(), kMaskColour), 0.5, 0, tinted);
  tinted.copyTo(image, mask == 0);
  return image;
}

double magnification(const cv::Mat& image) { return std::max(1.0, image.cols / kUnscaledWidth); }

/// Length in this image [px] of what has `length` px in an image of at most kUnscaledWidth.
int scaled(const cv::Mat& image, double length) { return cvRound(magnification(image) * length); }

/// Draws the text with its lower left corner at this pixel. size: before magnification.
void write(cv::Mat& image, const std::string& text, const cv::Point& at, double size) {
  cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, magnification(image) * size, kLegendText,
              scaled(image, 1), cv::LINE_AA);
}

void drawDot(cv::Mat& image, const cv::Point& at, const cv::Scalar& colour, bool filled) {
  cv::circle(image, at, scaled(image, 3), colour, filled ? cv::FILLED : scaled(image, 1),
             cv::LINE_AA);
}

void drawCross(cv::Mat& image, const cv::Point& at, RejectReason reason) {
  const bool outlier = reason == RejectReason::kOutlier;
  cv::drawMarker(image, at, outlier ? kOutlierColour : kNotFoundColour, cv::MARKER_TILTED_CROSS,
                 scaled(image, outlier ? 7 : 5), scaled(image, 1));
}

/// The background of the texts in the upper left corner.
void drawBox(cv::Mat& image, int height) {
  cv::rectangle(image, cv::Rect(0, 0, scaled(image, kBoxWidth), scaled(image, height)),
                kLegendBackground, cv::FILLED);
}

/// Legend in the upper left corner: colours of ages, and marks, which a narrow image has below.
void drawLegend(cv::Mat& image) {
  constexpr int kBar = 120, kLeft = 8;
  const auto pixel = [&](double x, double y) {
    return cv::Point(scaled(image, x), scaled(image, y));
  };
  const bool is_narrow = image.cols < kBoxWidth;
  drawBox(image, is_narrow ? 2 * kBoxHeight - 6 : kBoxHeight);
  const cv::Point from = pixel(kLeft, 4), to = pixel(kLeft + kBar, 14);
  for (int x = from.x; x <= to.x; ++x) {
    const double age = std::expm1(std::log1p(kOldest) * (x - from.x) / (to.x - from.x));
    cv::line(image, {x, from.y}, {x, to.y}, ageColour(age), 1);
  }
  for (const int age : {0, 1, 3, 10, 30, 100}) {
    const double x = kLeft + kBar * std::log1p(age) / std::log1p(kOldest);
    cv::line(image, pixel(x, 12), pixel(x, 16), kLegendText, scaled(image, 1));
    const std::string text = std::to_string(age);
    write(image, text, pixel(x - 3.0 * static_cast<double>(text.size()), 29), 0.35);
  }
  int x = kLeft + kBar + 16;
  write(image, "age [frames]", pixel(x - 4, 14), 0.35);
  x = is_narrow ? kLeft + 4 : x + 90;
  const int top = is_narrow ? 28 : 0;
  const auto entry = [&](const char* text, int row, auto draw) {
    const int y = top + 10 + 15 * row;
    draw(pixel(x, y));
    write(image, text, pixel(x + 8, y + 4), 0.35);
  };
  const cv::Scalar colour = ageColour(10);
  entry("has a point", 0, [&](cv::Point at) { drawDot(image, at, colour, true); });
  entry("no point yet", 1, [&](cv::Point at) { drawDot(image, at, colour, false); });
  x += 100;
  entry("outlier, dropped", 0, [&](cv::Point at) { drawCross(image, at, RejectReason::kOutlier); });
  entry("not found", 1, [&](cv::Point at) { drawCross(image, at, RejectReason::kNotFound); });
}

cv::Point toPixel(const Eigen::Vector2f& u) { return {cvRound(u.x()), cvRound(u.y())}; }

/// Frame on the ground below the camera: x in viewing direction, y left, z up.
Eigen::Isometry3d groundAxes(const ScaleEstimate& scale) {
  const Eigen::Vector3d up = scale.n_c;
  const Eigen::Vector3d forward = (Eigen::Vector3d::UnitZ() - up.z() * up).normalized();
  Eigen::Isometry3d T_c_ground = Eigen::Isometry3d::Identity();
  T_c_ground.linear() << forward, up.cross(forward), up;
  T_c_ground.translation() = -scale.scale * scale.height * up;
  return T_c_ground;
}

/// A grid of 1 m on the ground plane, labelled every 5 m.
void drawGroundGrid(cv::Mat& image, const PinholeCamera& camera, const ScaleEstimate& scale) {
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
  const int thin = scaled(image, 1), thick = scaled(image, 2);
  cv::Mat grid = image.clone();
  for (int left = -kGridSide; left <= kGridSide; ++left) {
    cv::line(grid, pixel(from, left), pixel(kGridTo, left), colour, thin, cv::LINE_AA);
  }
  for (int ahead = from; ahead <= kGridTo; ++ahead) {
    cv::line(grid, pixel(ahead, -kGridSide), pixel(ahead, kGridSide), colour,
             ahead % 5 ? thin : thick, cv::LINE_AA);
  }
  cv::addWeighted(image, 0.5, grid, 0.5, 0, image);
  // The nearest first; in a small image there is no room for the others.
  const cv::Size size(scaled(image, kLabelSize.width), scaled(image, kLabelSize.height));
  cv::Rect last_label;
  for (int ahead = from; ahead <= kGridTo; ++ahead) {
    if (ahead % 5 != 0) continue;
    const cv::Point at = pixel(ahead, -kGridSide) + cv::Point(scaled(image, 4), scaled(image, 4));
    const cv::Rect label({at.x, at.y - size.height}, size);
    if (!(label & last_label).empty()) continue;
    write(image, std::to_string(ahead) + " m", at, 0.4);
    last_label = label;
  }
}

std::string percentOf(const ScaleRecovery::Measurement& measured) {
  return measured.height > 0 ? cv::format("%.1f %%", 100 * measured.sigma / measured.height)
                             : std::string("none");
}

/// Writes a line in the box in the upper left corner, smaller in a narrow image.
void writeLine(cv::Mat& image, const std::string& text, int row) {
  constexpr double kSize = 0.38;
  constexpr int kMargin = 8;  // [px]
  const int width = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, kSize, 1, nullptr).width;
  const double fit = static_cast<double>(image.cols - 2 * kMargin) / width;
  write(image, text, {scaled(image, kMargin), scaled(image, 14 + 15 * row)},
        kSize * std::min(fit, 1.0));
}

/// Upper left corner.
void drawScale(cv::Mat& image, const ScaleRecovery::Output& output) {
  drawBox(image, kBoxHeight);
  int row = 0;
  for (const std::string& line : scaleText(output)) writeLine(image, line, row++);
}

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
                                            const std::vector<RejectedFeature>& rejected,
                                            const std_msgs::Header& header, const cv::Mat& mask) {
  cv::Mat image = background(grey, mask);
  if (frame.sequence != last_sequence_ + 1) last_.clear();
  std::map<std::uint64_t, Eigen::Vector2f> now;
  for (const TrackedFeature& feature : frame.features) {
    const cv::Scalar colour = ageColour(feature.age);
    const auto before = last_.find(feature.id);
    if (before != last_.end()) {
      cv::line(image, toPixel(before->second), toPixel(feature.u), colour, scaled(image, 1),
               cv::LINE_AA);
    }
    drawDot(image, toPixel(feature.u), colour, feature.has_point);
    now.emplace_hint(now.end(), feature.id, feature.u);
  }
  last_.swap(now);
  last_sequence_ = frame.sequence;
  for (const RejectedFeature& feature : rejected) {
    drawCross(image, toPixel(feature.u), feature.reason);
  }
  drawLegend(image);
  return toMsg(image, sensor_msgs::image_encodings::BGR8, header);
}

std::array<std::string, 2> scaleText(const ScaleRecovery::Output& output) {
  const ScaleEstimate& scale = output.scale;
  std::string first = toString(scale.status);
  if (scale.measurement != MeasurementStatus::kMeasured)
    first += std::string(", ") + toString(scale.measurement);
  if (scale.status != ScaleStatus::kUnknown) {
    first +=
        cv::format(": %.4g m per VO unit +- %.1f %%", scale.scale, 100 * scale.sigma / scale.scale);
  }
  std::string second = "this frame: features " + percentOf(output.feature_based) + ", direct " +
                       percentOf(output.direct);
  if (output.correlation > 0) second += cv::format(", correlation %.2f", output.correlation);
  return {first, second};
}

sensor_msgs::Image::Ptr paintRoad(const cv::Mat& grey, const VoFrame& frame,
                                  const ScaleRecovery::Output& output,
                                  const std_msgs::Header& header, const cv::Mat& mask) {
  cv::Mat image = background(grey, mask);
  if (output.scale.status != ScaleStatus::kUnknown) {
    drawGroundGrid(image, frame.camera, output.scale);
  }
  const std::unordered_set<std::uint64_t> ground(output.ground_feature_ids.begin(),
                                                 output.ground_feature_ids.end());
  for (const TrackedFeature& feature : frame.features) {
    if (!feature.has_point) continue;
    const bool on_ground = ground.count(feature.id) > 0;
    drawDot(image, toPixel(feature.u), on_ground ? kMeasuredColour : kOtherColour, on_ground);
  }
  drawScale(image, output);
  return toMsg(image, sensor_msgs::image_encodings::BGR8, header);
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header) {
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  cloud->is_dense = true;
  if (points.empty()) return cloud;  // an iterator would refer to the first byte of no data
  sensor_msgs::PointCloud2Iterator<float> x(*cloud, "x"), y(*cloud, "y"), z(*cloud, "z");
  for (const Eigen::Vector3f& point : points) {
    *x = point.x();
    *y = point.y();
    *z = point.z();
    ++x, ++y, ++z;
  }
  return cloud;
}

sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header,
                                           double scale) {
  std::vector<Eigen::Vector3f> points;
  for (const TrackedFeature& feature : frame.features) {
    if (feature.has_point) points.push_back(static_cast<float>(scale) * feature.p_c);
  }
  return toPointCloud(points, header);
}

std::vector<visualization_msgs::Marker::Ptr> toPlaneMarkers(const ScaleEstimate& scale,
                                                            const std_msgs::Header& header) {
  const Eigen::Isometry3d T_c_ground = groundAxes(scale);
  const Eigen::Isometry3d T_c_quad =
      T_c_ground * Eigen::Translation3d(kQuadAhead * Eigen::Vector3d::UnitX());

  const auto quad = marker(header, 0, visualization_msgs::Marker::CUBE);
  quad->pose = ground_scale_vo::toMsg(T_c_quad);
  quad->scale.x = kQuadLength;
  quad->scale.y = kQuadWidth;
  quad->scale.z = 0.01;
  quad->color.r = 0.2f;
  quad->color.g = 0.6f;
  quad->color.b = 1.0f;
  quad->color.a = scale.status == ScaleStatus::kOk ? 0.5f : 0.25f;

  Eigen::Isometry3d T_c_arrow = T_c_ground;  // arrow markers point along x
  T_c_arrow.linear() << T_c_ground.linear().col(2), T_c_ground.linear().col(0),
      T_c_ground.linear().col(1);

  const auto arrow = marker(header, 1, visualization_msgs::Marker::ARROW);
  arrow->pose = ground_scale_vo::toMsg(T_c_arrow);
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
