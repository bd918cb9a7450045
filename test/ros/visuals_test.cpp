#include "ground_scale_vo/ros/visuals.hpp"

#include <gtest/gtest.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kImageWidth = 640, kImageHeight = 200;
constexpr float kRow = 120;  // of all features; below the legend

TrackedFeature feature(std::uint64_t id, float u, std::uint32_t age, bool has_point = true) {
  TrackedFeature result;
  result.id = id;
  result.age = age;
  result.u = {u, kRow};
  result.has_point = has_point;
  return result;
}

struct Pixel {
  int blue, green, red;
  /// Equal but for the anti-aliasing of a line.
  bool isLike(const Pixel& o) const {
    return std::abs(blue - o.blue) + std::abs(green - o.green) + std::abs(red - o.red) < 40;
  }
  double brightness() const { return 0.11 * blue + 0.59 * green + 0.3 * red; }
  bool isGrey() const { return blue == green && green == red; }
};

Pixel pixelOf(const sensor_msgs::Image& message, float u, float v) {
  const std::size_t i =
      static_cast<std::size_t>(v) * message.step + 3 * static_cast<std::size_t>(u);
  return {message.data.at(i), message.data.at(i + 1), message.data.at(i + 2)};
}

cv::Mat uniformGrey(int width = kImageWidth, int height = kImageHeight) {
  return {height, width, CV_8UC1, cv::Scalar(128)};
}

/// Right of u = 300 masked.
cv::Mat rightMasked() {
  cv::Mat mask(kImageHeight, kImageWidth, CV_8UC1, cv::Scalar(255));
  mask.colRange(300, kImageWidth).setTo(0);
  return mask;
}

/// Paints consecutive frames on a uniform image.
class TrackPainting : public testing::Test {
 protected:
  void paint(std::vector<TrackedFeature> features, const cv::Mat& grey = uniformGrey(),
             const cv::Mat& mask = {}) {
    frame_.features = std::move(features);
    std_msgs::Header header;
    header.frame_id = "camera";
    message_ = painter_.paint(grey, frame_, rejected_, header, mask);
    ++frame_.sequence;
  }

  Pixel at(float u, float v = kRow) const { return pixelOf(*message_, u, v); }

  VoFrame frame_;
  std::vector<RejectedFeature> rejected_;
  TrackPainter painter_;
  sensor_msgs::Image::Ptr message_;
};

TEST_F(TrackPainting, GivesAColourImageWithTintedMask) {
  paint({}, uniformGrey(), rightMasked());
  EXPECT_EQ(message_->encoding, "bgr8");
  EXPECT_EQ(message_->header.frame_id, "camera");
  EXPECT_TRUE(at(299).isGrey());
  EXPECT_FALSE(at(300).isGrey());
  // Viewers show a large image reduced, so the marks grow with it; at the edge they are cut.
  paint({feature(1, 0, 3), feature(2, 100, 3)}, uniformGrey(1600, 400));
  EXPECT_FALSE(at(105).isGrey());
}

TEST_F(TrackPainting, MarksShowAgePointAndRejection) {
  rejected_ = {{1, {400.f, kRow}, RejectReason::kOutlier},
               {2, {500.f, kRow}, RejectReason::kNotFound}};
  paint({feature(0, 50, 0), feature(1, 100, 3), feature(2, 150, 10), feature(3, 200, 100),
         feature(4, 250, 5000), feature(5, 300, 10, false)});
  for (const float u : {100.f, 150.f, 200.f}) {
    EXPECT_GT(at(u).brightness(), at(u - 50).brightness() + 8) << "older is brighter, " << u;
  }
  EXPECT_TRUE(at(250).isLike(at(200))) << "older than the oldest colour";
  EXPECT_TRUE(at(300).isGrey()) << "hollow without a point";
  EXPECT_TRUE(at(303).isLike(at(150))) << "the ring has the colour of the age";
  for (const float u : {400.f, 500.f}) {
    EXPECT_GT(at(u).red, at(u).green + 40) << "unlike the colour of any age";
    EXPECT_TRUE(at(u + 2, kRow + 2).isLike(at(u)) && at(u - 2, kRow + 2).isLike(at(u))) << "cross";
  }
  EXPECT_FALSE(at(400).isLike(at(500)));
}

/// A level camera 0.5 VO units above the road; the scale, 3.3, makes that 1.65 m.
class RoadPainting : public testing::Test {
 protected:
  RoadPainting() {
    frame_.camera = {kImageWidth, kImageHeight, 400, 400, 320, 40};
    output_.scale.n_c = {0, -1, 0};
    output_.scale.height = 0.5;
    output_.scale.scale = 3.3;
    output_.scale.sigma = 0.03;
  }
  void paint(ScaleStatus status, const cv::Mat& grey = uniformGrey(), const cv::Mat& mask = {}) {
    output_.scale.status = status;
    message_ = paintRoad(grey, frame_, output_, {}, mask);
  }
  /// Pixel that shows the road point `ahead` and `left` of the camera [m].
  Pixel onRoad(float ahead, float left) const {
    return pixelOf(*message_, 320 - 400 * left / ahead, std::round(40 + 400 * 1.65f / ahead));
  }

  VoFrame frame_;
  ScaleRecovery::Output output_;
  sensor_msgs::Image::Ptr message_;
};

TEST_F(RoadPainting, TheGridLiesOnTheRoadInMetres) {
  paint(ScaleStatus::kOk);
  for (const float ahead : {5.f, 10.f, 15.f, 20.f}) {
    const Pixel line = onRoad(ahead, 0.5f);
    EXPECT_GT(line.green, line.red + 30) << ahead;
    EXPECT_TRUE(onRoad(ahead, 3.6f).isGrey()) << ahead << " m, beside the grid";
  }
  EXPECT_TRUE(onRoad(5.5f, 0.5f).isGrey()) << "between the lines";
  EXPECT_TRUE(onRoad(25.f, 0.5f).isGrey()) << "beyond the grid";
  // Twice the scale makes the road twice as large: the same pixel is then 11 m ahead.
  EXPECT_TRUE(onRoad(5.5f, 0.25f).isGrey()) << "between the lines";
  output_.scale.scale *= 2;
  paint(ScaleStatus::kOk);
  const Pixel line = onRoad(5.5f, 0.25f);
  EXPECT_GT(line.green, line.red + 30);
  EXPECT_TRUE(onRoad(15.f, 0.5f).isGrey()) << "now 30 m ahead, beyond the grid";
}

TEST_F(RoadPainting, AHeldScaleHasAnotherColourAndAnUnknownScaleNoGrid) {
  paint(ScaleStatus::kHeld);
  const Pixel held = onRoad(10, 0.5f);
  EXPECT_GT(held.red, held.blue + 50);
  EXPECT_GT(held.red, held.green);
  paint(ScaleStatus::kUnknown, uniformGrey(), rightMasked());
  EXPECT_TRUE(onRoad(10, 0.8f).isGrey());
  EXPECT_FALSE(onRoad(10, -0.8f).isGrey()) << "masked";
}

// A camera that looks down by 0.1 rad, 0.5 VO units (1.65 m) above the road.
TEST(PlaneMarkers, LieOnTheRoadAheadInMetres) {
  ScaleEstimate scale;
  scale.status = ScaleStatus::kOk;
  scale.n_c = {0, -std::cos(0.1), -std::sin(0.1)};
  scale.height = 0.5;
  scale.scale = 3.3;
  std_msgs::Header header;
  header.frame_id = "camera";
  const auto markers = toPlaneMarkers(scale, header);
  ASSERT_EQ(markers.size(), 2u);
  EXPECT_NE(markers[0]->id, markers[1]->id);
  for (const auto& marker : markers) {
    EXPECT_EQ(marker->header.frame_id, "camera");
    EXPECT_GT(marker->color.a, 0);
  }
  // The quad: its z is the normal, its x points ahead, its centre is on the road ahead.
  const Eigen::Isometry3d T_c_quad = fromMsg(markers[0]->pose);
  EXPECT_NEAR((T_c_quad.linear().col(2) - scale.n_c).norm(), 0, 1e-12);
  EXPECT_GT(T_c_quad.linear().col(0).z(), 0.99);
  EXPECT_NEAR(scale.n_c.dot(T_c_quad.translation()), -1.65, 1e-12);
  EXPECT_GT(T_c_quad.translation().z(), 3);
  // The arrow: from the road up to the camera.
  const Eigen::Isometry3d T_c_arrow = fromMsg(markers[1]->pose);
  EXPECT_NEAR((T_c_arrow * Eigen::Vector3d(markers[1]->scale.x, 0, 0)).norm(), 0, 1e-12);
  EXPECT_NEAR(T_c_arrow.linear().determinant(), 1, 1e-12);
  scale.status = ScaleStatus::kHeld;
  EXPECT_LT(toPlaneMarkers(scale, header)[0]->color.a, markers[0]->color.a);
}

TEST(PointCloud, HoldsThePointsInMetres) {
  std_msgs::Header header;
  header.frame_id = "camera";
  VoFrame frame;
  const auto none = toPointCloud(frame, header, 2);
  frame.features = {feature(1, 100, 5), feature(2, 200, 5, false)};
  frame.features[0].p_c = {1, 2, 3};
  const auto cloud = toPointCloud(frame, header, 2);
  ASSERT_EQ(cloud->width, 1u);
  sensor_msgs::PointCloud2ConstIterator<float> x(*cloud, "x"), y(*cloud, "y"), z(*cloud, "z");
  EXPECT_EQ(*x, 2);
  EXPECT_EQ(*y, 4);
  EXPECT_EQ(*z, 6);
  EXPECT_EQ(none->width, 0u);
  EXPECT_TRUE(none->data.empty());
  EXPECT_EQ(none->fields, cloud->fields) << "also valid without points";
}

}  // namespace
}  // namespace ground_scale_vo
