#include "ground_scale_vo/ros/visuals.hpp"

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <tuple>
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

RejectedFeature rejected(float u, RejectReason reason) {
  RejectedFeature result;
  result.u = {u, kRow};
  result.reason = reason;
  return result;
}

struct Pixel {
  int blue, green, red;
  bool operator==(const Pixel& o) const {
    return std::tie(blue, green, red) == std::tie(o.blue, o.green, o.red);
  }
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

cv::Mat uniformImage() { return {kImageHeight, kImageWidth, CV_8UC1, cv::Scalar(128)}; }

/// Paints consecutive frames on a uniform image.
class TrackPainting : public testing::Test {
 protected:
  void paint(std::vector<TrackedFeature> features,
             std::vector<RejectedFeature> rejected_features = {}) {
    frame_.features = std::move(features);
    std_msgs::Header header;
    header.frame_id = "camera";
    message_ = painter_.paint(uniformImage(), frame_, rejected_features, header);
    ++frame_.sequence;
  }
  void skipAFrame() { ++frame_.sequence; }

  Pixel at(float u, float v = kRow) const { return pixelOf(*message_, u, v); }

  VoFrame frame_;
  TrackPainter painter_;
  sensor_msgs::Image::Ptr message_;
};

TEST_F(TrackPainting, TintsTheMaskedPixels) {
  cv::Mat mask(kImageHeight, kImageWidth, CV_8UC1, cv::Scalar(255));
  mask.colRange(300, kImageWidth).setTo(0);
  paint({});
  const Pixel unmasked = at(310);
  message_ = painter_.paint(uniformImage(), frame_, {}, {}, mask);
  EXPECT_TRUE(at(299).isGrey());
  EXPECT_FALSE(at(300).isGrey());
  EXPECT_GT(std::abs(at(310).green - unmasked.green), 20);
  message_ = paintRoad(uniformImage(), frame_, {}, {}, mask);
  EXPECT_TRUE(at(299).isGrey());
  EXPECT_FALSE(at(300).isGrey());
}

TEST_F(TrackPainting, GivesAColourImageOfTheSameSize) {
  paint({});
  EXPECT_EQ(message_->encoding, sensor_msgs::image_encodings::BGR8);
  EXPECT_EQ(message_->width, static_cast<unsigned>(kImageWidth));
  EXPECT_EQ(message_->height, static_cast<unsigned>(kImageHeight));
  EXPECT_EQ(message_->header.frame_id, "camera");
  EXPECT_TRUE(at(300).isGrey());
}

TEST_F(TrackPainting, OlderTracksAreBrighterLogarithmically) {
  const std::vector<std::uint32_t> ages = {0, 1, 3, 10, 30, 100};
  std::vector<TrackedFeature> features;
  for (std::size_t k = 0; k < ages.size(); ++k) {
    features.push_back(feature(k, 50.f + 40.f * static_cast<float>(k), ages[k]));
  }
  features.push_back(feature(90, 400, 10));
  features.push_back(feature(91, 440, 5000));
  paint(features);
  for (std::size_t k = 1; k < ages.size(); ++k) {
    EXPECT_GT(at(features[k].u.x()).brightness(), at(features[k - 1].u.x()).brightness() + 8) << k;
  }
  EXPECT_EQ(at(400), at(features[3].u.x())) << "one age, one colour";
  EXPECT_EQ(at(440), at(features[5].u.x())) << "older than the oldest colour";
}

TEST_F(TrackPainting, TracksWithoutAPointAreHollow) {
  paint({feature(1, 100, 10, true), feature(2, 200, 10, false)});
  EXPECT_FALSE(at(100).isGrey());
  EXPECT_TRUE(at(200).isGrey());
  EXPECT_TRUE(at(203).isLike(at(100))) << "the ring has the colour of the age";
}

TEST_F(TrackPainting, RejectedFeaturesAreCrossed) {
  paint({feature(1, 100, 1), feature(2, 200, 100)},
        {rejected(300, RejectReason::kOutlier), rejected(400, RejectReason::kNotFound)});
  const Pixel outlier = at(300), not_found = at(400);
  for (const float side : {-2.f, 2.f}) {
    EXPECT_EQ(at(300 + side, kRow + 2), outlier);
    EXPECT_EQ(at(400 + side, kRow + 2), not_found);
    EXPECT_TRUE(at(300 + side).isGrey());
    EXPECT_TRUE(at(400 + side).isGrey());
  }
  for (const Pixel& cross : {outlier, not_found}) {
    // Unlike the colour of any age.
    EXPECT_GT(cross.red, cross.green + 80);
    EXPECT_GT(cross.red, cross.blue + 40);
  }
  EXPECT_FALSE(outlier == not_found);
}

TEST_F(TrackPainting, LinesLeadToThePreviousImage) {
  paint({feature(1, 100, 1), feature(3, 400, 1, false)});
  paint({feature(1, 120, 2), feature(2, 300, 0), feature(3, 420, 2, false)});
  EXPECT_TRUE(at(110).isLike(at(120)));
  EXPECT_TRUE(at(410).isLike(at(110))) << "without a point";
  EXPECT_TRUE(at(290).isGrey());
  paint({feature(1, 140, 2)});
  EXPECT_TRUE(at(130).isLike(at(140)));
  skipAFrame();
  paint({feature(1, 160, 3)});
  EXPECT_TRUE(at(150).isGrey()) << "the image before was not drawn";
}

TEST_F(TrackPainting, TheLegendShowsTheColours) {
  paint({feature(1, 100, 3)});
  const Pixel colour = at(100);
  bool found = false;
  for (float u = 0; u < 200; ++u) found = found || at(u, 8).isLike(colour);
  EXPECT_TRUE(found);
}

TEST_F(TrackPainting, TheLegendFitsIntoASmallImage) {
  const auto message = painter_.paint(cv::Mat(120, 320, CV_8UC1, cv::Scalar(128)), frame_, {}, {});
  paint({}, {rejected(300, RejectReason::kNotFound)});
  const Pixel not_found = at(300);
  bool found = false;
  for (float v = 0; v < 70; ++v) {
    for (float u = 0; u < 320; ++u) found = found || pixelOf(*message, u, v) == not_found;
  }
  EXPECT_TRUE(found) << "the last entry of the legend";
}

TEST_F(TrackPainting, AnImageOfTwiceTheWidthHasTwiceTheLegendAndMarks) {
  frame_.features = {feature(1, 100, 10), feature(2, 200, 10, false)};
  const std::vector<RejectedFeature> crosses = {rejected(300, RejectReason::kOutlier),
                                                rejected(400, RejectReason::kNotFound)};
  const auto paintWide = [&](int width) {
    TrackPainter painter;
    const cv::Mat grey(width / 4, width, CV_8UC1, cv::Scalar(128));
    return painter.paint(grey, frame_, crosses, {});
  };
  const auto narrow = paintWide(800), wide = paintWide(1600);
  for (float v = 0; v < 40; v += 1) {
    EXPECT_EQ(pixelOf(*wide, 2 * 461.f, 2 * v).brightness() < 50,
              pixelOf(*narrow, 461, v).brightness() < 50)
        << v;
  }
  for (float u = 8; u <= 128; u += 20) {
    EXPECT_TRUE(pixelOf(*wide, 2 * u, 2 * 8).isLike(pixelOf(*narrow, u, 8))) << u;
  }
  EXPECT_TRUE(pixelOf(*wide, 105, kRow).isLike(pixelOf(*narrow, 102, kRow))) << "dot";
  EXPECT_TRUE(pixelOf(*wide, 206, kRow).isLike(pixelOf(*narrow, 203, kRow))) << "ring";
  EXPECT_EQ(pixelOf(*wide, 306, kRow + 6), pixelOf(*narrow, 303, kRow + 3)) << "outlier";
  EXPECT_EQ(pixelOf(*wide, 404, kRow + 4), pixelOf(*narrow, 402, kRow + 2)) << "not found";
}

TEST_F(TrackPainting, MarksAtTheEdgeAreValid) {
  paint({feature(1, 0, 3), feature(2, kImageWidth - 1, 3, false)},
        {rejected(0, RejectReason::kOutlier), rejected(kImageWidth - 1, RejectReason::kNotFound)});
  EXPECT_FALSE(at(0).isGrey());
}

/// A level camera 0.5 VO units above the road; the scale, 3.3, makes that 1.65 m.
class RoadPainting : public testing::Test {
 protected:
  RoadPainting() {
    frame_.camera.width = kImageWidth;
    frame_.camera.height = kImageHeight;
    frame_.camera.fx = frame_.camera.fy = 400;
    frame_.camera.cx = 320;
    frame_.camera.cy = 40;
    output_.scale.n_c = {0, -1, 0};
    output_.scale.height = 0.5;
    output_.scale.scale = 3.3;
    output_.scale.sigma = 0.03;
  }
  void paint(ScaleStatus status) {
    output_.scale.status = status;
    message_ = paintRoad(uniformImage(), frame_, output_, {});
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
  EXPECT_TRUE(onRoad(5.5f, 0.25f).isGrey()) << "between the lines";
  EXPECT_TRUE(onRoad(25.f, 0.5f).isGrey()) << "beyond the grid";
  // Twice the scale makes the road twice as large: the same pixel is then 11 m ahead.
  output_.scale.scale *= 2;
  paint(ScaleStatus::kOk);
  const Pixel line = onRoad(5.5f, 0.25f);
  EXPECT_GT(line.green, line.red + 30);
  EXPECT_TRUE(onRoad(15.f, 0.5f).isGrey()) << "now 30 m ahead, beyond the grid";
}

TEST_F(RoadPainting, TextFitsIntoASmallImage) {
  const auto isText = [this](float u, float v) {
    return pixelOf(*message_, u, v).brightness() > 180;
  };
  frame_.camera.width = 320;
  frame_.camera.height = 100;
  frame_.camera.fx = frame_.camera.fy = 200;
  frame_.camera.cx = 160;
  frame_.camera.cy = 30;
  output_.scale.status = ScaleStatus::kOk;
  output_.feature_based = output_.direct = {0.5, 0.01};
  output_.correlation = 0.9;
  message_ = paintRoad(cv::Mat(100, 320, CV_8UC1, cv::Scalar(128)), frame_, output_, {});
  int text = 0, cut = 0;
  for (float v = 0; v < 34; ++v) {
    for (float u = 0; u < 320; ++u) (u < 314 ? text : cut) += isText(u, v);
  }
  EXPECT_GT(text, 50);
  EXPECT_EQ(cut, 0) << "text up to the right edge";
  // The labels of 15 m (at row 56) and 20 m (at row 50) would overlap.
  int far_label = 0, near_label = 0;
  for (float u = 194; u < 204; ++u) {
    for (float v = 40; v < 52; ++v) far_label += isText(u, v);
  }
  for (float u = 204; u < 225; ++u) {
    for (float v = 44; v < 58; ++v) near_label += isText(u, v);
  }
  EXPECT_EQ(far_label, 0);
  EXPECT_GT(near_label, 0);
}

TEST_F(RoadPainting, TextNamesTheScaleAndBothMeasurements) {
  output_.scale = {};
  output_.scale.status = ScaleStatus::kOk;
  output_.scale.scale = 1.25;
  output_.scale.sigma = 0.025;
  output_.feature_based = {0.5, 0.015};
  output_.direct = {0.5, 0.005};
  output_.correlation = 0.9;
  EXPECT_EQ(scaleText(output_), (std::array<std::string, 2>{
                                    "ok: 1.25 m per VO unit +- 2.0 %",
                                    "this frame: features 3.0 %, direct 1.0 %, correlation 0.90"}));
  output_.scale = {};
  output_.scale.status = ScaleStatus::kUnknown;
  output_.scale.reason = ScaleReason::kNoPlane;
  output_.feature_based = output_.direct = {};
  output_.correlation = 0;
  EXPECT_EQ(
      scaleText(output_),
      (std::array<std::string, 2>{"unknown, no_plane", "this frame: features none, direct none"}));
}

TEST_F(RoadPainting, AnImageOfTwiceTheWidthHasTwiceTheText) {
  output_.scale.status = ScaleStatus::kUnknown;
  const auto lowestText = [this](int width) {
    const cv::Mat grey(width / 4, width, CV_8UC1, cv::Scalar(128));
    message_ = paintRoad(grey, frame_, output_, {});
    int lowest = 0, right = 0;
    for (int v = 0; v < width / 8; ++v) {
      for (int u = 0; u < width; ++u) {
        if (pixelOf(*message_, static_cast<float>(u), static_cast<float>(v)).brightness() < 150) {
          continue;
        }
        lowest = v;
        right = std::max(right, u);
      }
    }
    return std::pair(lowest, right);
  };
  const auto narrow = lowestText(800), wide = lowestText(1600);
  EXPECT_NEAR(wide.first, 2 * narrow.first, 3);
  EXPECT_NEAR(wide.second, 2 * narrow.second, 8);
}

TEST_F(RoadPainting, AHeldScaleHasAnotherColourAndAnUnknownScaleNoGrid) {
  paint(ScaleStatus::kHeld);
  const Pixel held = onRoad(10, 0.5f);
  EXPECT_GT(held.red, held.blue + 50);
  EXPECT_GT(held.red, held.green);
  paint(ScaleStatus::kUnknown);
  EXPECT_TRUE(onRoad(10, 0.5f).isGrey());
}

TEST_F(RoadPainting, GroundPointsAreFilled) {
  frame_.features = {feature(1, 100, 5), feature(2, 200, 5), feature(3, 300, 5, false)};
  for (TrackedFeature& f : frame_.features) f.u.y() = 60;
  output_.ground_feature_ids = {1};
  paint(ScaleStatus::kUnknown);
  const Pixel ground = pixelOf(*message_, 100, 60), other = pixelOf(*message_, 200, 60);
  EXPECT_GT(ground.green, ground.red + 50);
  EXPECT_EQ(other, pixelOf(*message_, 300, 60)) << "hollow";
  EXPECT_FALSE(pixelOf(*message_, 203, 60) == other) << "its ring";
  EXPECT_EQ(pixelOf(*message_, 303, 60), other) << "without a point there is nothing";
}

TEST_F(RoadPainting, APlaneOutsideTheViewIsValid) {
  for (const Eigen::Vector3d& up :
       {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(1, 0, 0)}) {
    output_.scale.n_c = up;
    paint(ScaleStatus::kOk);
    EXPECT_EQ(message_->width, static_cast<unsigned>(kImageWidth));
  }
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
  const Eigen::Isometry3d T_c_quad = fromMsg(markers[0]->pose),
                          T_c_arrow = fromMsg(markers[1]->pose);
  EXPECT_EQ(markers[0]->type, visualization_msgs::Marker::CUBE);
  EXPECT_EQ(markers[1]->type, visualization_msgs::Marker::ARROW);
  for (const auto& marker : markers) {
    EXPECT_EQ(marker->header.frame_id, "camera");
    EXPECT_GT(std::min(marker->scale.y, marker->scale.z), 0);
    EXPECT_GT(marker->color.a, 0);
  }
  // The quad: its z is the normal, its x points ahead, its centre is on the road ahead.
  EXPECT_NEAR((T_c_quad.linear().col(2) - scale.n_c).norm(), 0, 1e-12);
  EXPECT_GT(T_c_quad.linear().col(0).z(), 0.99);
  EXPECT_NEAR(scale.n_c.dot(T_c_quad.translation()), -1.65, 1e-12);
  EXPECT_GT(T_c_quad.translation().z(), 3);
  EXPECT_NEAR(T_c_quad.translation().x(), 0, 1e-12);
  EXPECT_GT(markers[0]->scale.x, markers[0]->scale.y);
  // The arrow: from the road up to the camera.
  const Eigen::Vector3d tip = T_c_arrow * Eigen::Vector3d(markers[1]->scale.x, 0, 0);
  EXPECT_NEAR(tip.norm(), 0, 1e-12);
  EXPECT_NEAR(T_c_arrow.linear().determinant(), 1, 1e-12);
  // A held plane is fainter.
  scale.status = ScaleStatus::kHeld;
  EXPECT_LT(toPlaneMarkers(scale, header)[0]->color.a, markers[0]->color.a);
}

TEST(PointClouds, AreInMetres) {
  VoFrame frame;
  frame.features = {feature(1, 100, 5), feature(2, 200, 5, false)};
  frame.features[0].p_c = {1, 2, 3};
  const auto cloud = toPointCloud(frame, {}, 2);
  ASSERT_EQ(cloud->width, 1u);
  sensor_msgs::PointCloud2ConstIterator<float> x(*cloud, "x"), y(*cloud, "y"), z(*cloud, "z");
  EXPECT_EQ(*x, 2);
  EXPECT_EQ(*y, 4);
  EXPECT_EQ(*z, 6);
}

// In a build with _GLIBCXX_ASSERTIONS, access to the first byte of an empty vector aborts.
TEST(PointClouds, WithoutPointsIsAValidMessage) {
  std_msgs::Header header;
  header.frame_id = "camera";
  const auto none = toPointCloud(std::vector<Eigen::Vector3f>(), header);
  EXPECT_EQ(none->header.frame_id, "camera");
  EXPECT_EQ(none->width, 0u);
  EXPECT_TRUE(none->data.empty());
  EXPECT_TRUE(none->is_dense);
  const auto one = toPointCloud({Eigen::Vector3f(1, 2, 3)}, header);
  EXPECT_EQ(one->width, 1u);
  EXPECT_EQ(none->point_step, one->point_step);
  EXPECT_EQ(none->fields, one->fields);
}

}  // namespace
}  // namespace ground_scale_vo
