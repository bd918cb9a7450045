// Both nodelets with image_transport `compressed`, whose plugin need not be installed: JPEG and PNG
// images are processed, invalid ones are dropped and counted.

#include <gtest/gtest.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "topic_recorder.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {
namespace {

class Compressed : public testing::Test {
 protected:
  static constexpr int kWidth = 160, kHeight = 80;

  void SetUp() override {
    ASSERT_TRUE(waitForValue(diagnostics_, "images received", "", "mono_vo"));
    ASSERT_TRUE(waitForValue(diagnostics_, "images", "", "scale_recovery"));
    ASSERT_TRUE(waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             frames_.connected() && scales_.connected();
    }));
    PinholeCamera camera;
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 100;
    camera.cx = 80;
    camera.cy = 40;
    infos_.publish(toCameraInfo(camera));
  }

  static sensor_msgs::CompressedImage compressed(const std::string& format,
                                                 const std::string& extension, int type) {
    sensor_msgs::CompressedImage image;
    image.header.frame_id = "camera";
    image.format = format;
    cv::imencode(extension, cv::Mat(kHeight, kWidth, type, cv::Scalar::all(90)), image.data);
    return image;
  }
  void publish(sensor_msgs::CompressedImage image) {
    image.header.stamp = ros::Time(stamp_ += 0.1);
    images_.publish(image);
  }
  bool publishAndWait(const sensor_msgs::CompressedImage& image) {
    publish(image);
    return scales_.waitForStamp(ros::Time(stamp_)) && frames_.waitForStamp(ros::Time(stamp_));
  }

  double stamp_ = 100;
  ros::NodeHandle handle_;
  ros::Publisher images_ = handle_.advertise<sensor_msgs::CompressedImage>("image/compressed", 100);
  ros::Publisher infos_ = handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 1, true);
  TopicRecorder<VoFrameMsg> frames_{handle_, "vo/frame"};
  TopicRecorder<ScaleEstimateMsg> scales_{handle_, "scale"};
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_{handle_, "/diagnostics"};
};

TEST_F(Compressed, ImagesAreProcessedAndInvalidOnesDropped) {
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                             "no image received yet on /image/compressed"));
  const sensor_msgs::CompressedImage good =
      compressed("mono8; jpeg compressed mono8", ".jpg", CV_8UC1);
  sensor_msgs::CompressedImage empty = good, truncated = good, noise = good;
  empty.data.clear();
  truncated.data.resize(truncated.data.size() / 2);
  noise.data.assign(100, 7);
  publish(truncated);
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                             "no usable image", false));
  ASSERT_TRUE(publishAndWait(good));
  EXPECT_TRUE(publishAndWait(compressed("rgb8; jpeg compressed bgr8", ".jpg", CV_8UC3)));
  EXPECT_TRUE(publishAndWait(compressed("bayer_rggb8; jpeg compressed", ".jpg", CV_8UC1)));
  EXPECT_TRUE(publishAndWait(compressed("mono16; png compressed", ".png", CV_16UC1)));
  std::uint32_t processed = frames_.messages().back()->sequence;

  for (const auto& bad : {empty, noise}) publish(bad);
  ASSERT_TRUE(publishAndWait(good));
  EXPECT_EQ(frames_.messages().back()->sequence, processed + 1);
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: image refused", "3", "mono_vo"));
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: image refused", "3", "scale_recovery"));
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "used", "scale_recovery"));
}

}  // namespace
}  // namespace ground_scale_vo
