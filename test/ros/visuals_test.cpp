#include "ros/visuals.hpp"

#include "ground_scale_vo/ros/conversions.hpp"
#include "ros/ros_messages.hpp"
#include "support/test.hpp"

namespace gsv {
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
  double brightness() const { return 0.11 * blue + 0.59 * green + 0.3 * red; }
  bool isGrey() const { return blue == green && green == red; }
};

Pixel pixelOf(const sensor_msgs::Image& message, float u, float v) {
  const std::size_t i =
      static_cast<std::size_t>(v) * message.step + 3 * static_cast<std::size_t>(u);
  return {message.data.at(i), message.data.at(i + 1), message.data.at(i + 2)};
}

const CameraImage kGrey{cv::Mat(kImageHeight, kImageWidth, CV_8UC1, cv::Scalar(128)), {}, {}};

/// Masks all pixels right of u = 550.
CameraImage rightMasked() {
  CameraImage image = kGrey;
  image.mask = cv::Mat(kGrey.grey.size(), CV_8UC1, cv::Scalar(255));
  image.mask.colRange(550, kImageWidth).setTo(0);
  return image;
}

TEST(TrackPainting, MarksShowAgePointRejectionAndMask) {
  VoFrame frame;
  frame.features = {feature(1, 100, 0), feature(2, 150, 5), feature(3, 200, 100),
                    feature(4, 300, 10, false), feature(5, kImageWidth - 1, 3)};
  const std_msgs::Header header = headerAt(ros::Time());
  const auto message =
      paintTracks(rightMasked(), frame, nullptr, {{6, {400.f, kRow}, true}}, header);
  EXPECT_EQ(message->encoding, "bgr8");
  EXPECT_EQ(message->header.frame_id, "camera");
  const auto at = [&](float u) { return pixelOf(*message, u, kRow); };
  for (const float u : {150.f, 200.f}) {
    EXPECT_GT(at(u).brightness(), at(u - 50).brightness() + 8) << "older is brighter, " << u;
  }
  EXPECT_TRUE(at(300).isGrey()) << "hollow without a point";
  EXPECT_FALSE(at(303).isGrey()) << "its ring";
  EXPECT_GT(at(400).red, at(400).green + 40) << "rejected";
  EXPECT_TRUE(at(548).isGrey());
  EXPECT_FALSE(at(551).isGrey()) << "masked";
}

// A level camera 0.5 VO units above the road; the scale, 3.3, makes that 1.65 m.
TEST(RoadPainting, ShowsAGridOfOneMetreUnlessTheScaleIsUnknown) {
  VoFrame frame;
  frame.camera = {kImageWidth, kImageHeight, 400, 400, 320, 40};
  ScaleRecovery::Output output;
  output.scale.n_c = {0, -1, 0};
  output.scale.height = 0.5;
  output.scale.scale = 3.3;
  output.scale.sigma = 0.03;
  output.scale.status = ScaleStatus::kOk;
  auto message = paintRoad(kGrey, frame, output, {});
  /// Pixel that shows the road point `ahead` and `left` of the camera [m].
  const auto onRoad = [&](float ahead, float left) {
    return pixelOf(*message, 320 - 400 * left / ahead, std::round(40 + 400 * 1.65f / ahead));
  };
  for (const float ahead : {5.f, 10.f, 15.f, 20.f}) {
    const Pixel line = onRoad(ahead, 0.5f);
    EXPECT_GT(line.green, line.red + 30) << ahead;
    EXPECT_TRUE(onRoad(ahead, 3.6f).isGrey()) << ahead << " m, beside the grid";
  }
  for (const float ahead : {5.5f, 25.f}) {
    EXPECT_TRUE(onRoad(ahead, 0.5f).isGrey()) << "between the lines or beyond the grid, " << ahead;
  }
  output.scale.scale *= 2;  // the same pixel is now 11 m ahead
  output.scale.status = ScaleStatus::kHeld;
  message = paintRoad(kGrey, frame, output, {});
  const Pixel held = onRoad(5.5f, 0.25f);
  EXPECT_GT(held.red, held.blue + 50) << "amber";
  EXPECT_GT(held.red, held.green);
  output.scale.status = ScaleStatus::kUnknown;
  message = paintRoad(rightMasked(), frame, output, {});
  EXPECT_TRUE(onRoad(5.5f, 0.25f).isGrey());
  EXPECT_FALSE(pixelOf(*message, 551, kRow).isGrey()) << "masked";
}

// A camera that looks down by 0.1 rad, 0.5 VO units (1.65 m) above the road.
TEST(PlaneMarker, LiesOnTheRoadAheadInMetres) {
  ScaleEstimate scale;
  scale.status = ScaleStatus::kOk;
  scale.n_c = {0, -std::cos(0.1), -std::sin(0.1)};
  scale.height = 0.5;
  scale.scale = 3.3;
  const std_msgs::Header header = headerAt(ros::Time());
  const auto quad = toPlaneMarker(scale, header);
  EXPECT_EQ(quad->header.frame_id, "camera");
  // Its z is the normal, its x points ahead, its centre is on the road ahead.
  const Eigen::Isometry3d T_c_quad = fromMsg(quad->pose);
  EXPECT_NEAR((T_c_quad.linear().col(2) - scale.n_c).norm(), 0, 1e-12);
  EXPECT_GT(T_c_quad.linear().col(0).z(), 0.99);
  EXPECT_NEAR(scale.n_c.dot(T_c_quad.translation()), -1.65, 1e-12);
  EXPECT_GT(T_c_quad.translation().z(), 3);
  scale.status = ScaleStatus::kHeld;
  EXPECT_LT(toPlaneMarker(scale, header)->color.a, quad->color.a);
}

}  // namespace
}  // namespace gsv
