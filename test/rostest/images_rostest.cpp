// MonoVo and what a camera can do wrong: each bad image or camera_info is left out and counted in
// the diagnostics, and the next good one is used.

#include <gtest/gtest.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>

#include "diagnosed.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "inbox.hpp"

namespace ground_scale_vo {
namespace {

class Images : public testing::Test {
 protected:
  Images()
      : images_(handle_.advertise<sensor_msgs::Image>("image", 100)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 100)),
        frames_(handle_, "vo/frame"),
        diagnostics_(handle_, "/diagnostics") {}

  void SetUp() override {
    ASSERT_TRUE(waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             frames_.connected() && diagnostics_.connected();
    }));
  }

  static sensor_msgs::Image image(double stamp) {
    sensor_msgs::Image image;
    image.header.stamp = ros::Time(stamp);
    image.header.frame_id = "camera";
    image.encoding = "mono8";
    image.width = image.step = 160;
    image.height = 80;
    image.data.assign(160 * 80, 90);
    return image;
  }
  static sensor_msgs::CameraInfo info() {
    PinholeCamera camera;
    camera.width = 160;
    camera.height = 80;
    camera.fx = camera.fy = 100;
    camera.cx = 80;
    camera.cy = 40;
    return toCameraInfo(camera);
  }

  bool diagnosed(const std::string& key, const std::string& value) {
    return ground_scale_vo::diagnosed(diagnostics_, key, value);
  }
  /// Publishes and waits for the frame of this stamp.
  bool comesOut(const sensor_msgs::Image& good) {
    images_.publish(good);
    return frames_.waitForStamp(good.header.stamp);
  }

  ros::NodeHandle handle_;
  ros::Publisher images_, infos_;
  Inbox<VoFrameMsg> frames_;
  Inbox<diagnostic_msgs::DiagnosticArray> diagnostics_;
};

// Runs first: no camera_info has come yet.
TEST_F(Images, WaitForAUsableCameraInfo) {
  for (int i = 0; i < 10; ++i) images_.publish(image(10 + i));
  infos_.publish(sensor_msgs::CameraInfo());
  EXPECT_TRUE(diagnosed("dropped: camera_info refused", "1"));
  EXPECT_TRUE(diagnosed("images received", "10"));
  EXPECT_TRUE(diagnosed("images overtaken by newer ones", "7"));  // queue_size is 3
  EXPECT_TRUE(frames_.messages().empty());
  infos_.publish(info());
  ASSERT_TRUE(frames_.waitForStamp(ros::Time(19)));
  EXPECT_EQ(frames_.messages().size(), 3u);  // newest wins
}

TEST_F(Images, BadOnesAreLeftOutAndCounted) {
  infos_.publish(info());
  ASSERT_TRUE(comesOut(image(100)));
  frames_.clear();

  sensor_msgs::Image bad = image(101);
  bad.data.resize(100);
  images_.publish(bad);
  bad = image(101);
  bad.encoding = "nonsense";
  images_.publish(bad);
  ASSERT_TRUE(comesOut(image(102)));
  bad = image(103);
  bad.width = bad.step = 80;
  bad.data.resize(80 * 80);
  images_.publish(bad);
  ASSERT_TRUE(comesOut(image(104)));
  EXPECT_TRUE(diagnosed("dropped: image refused", "3"));

  // Each beside a good one: more than three at once may overtake each other.
  images_.publish(image(104));  // repeated
  ASSERT_TRUE(comesOut(image(105)));
  images_.publish(image(104.5));  // a little backward
  ASSERT_TRUE(comesOut(image(106)));
  images_.publish(image(0));  // no stamp at all
  ASSERT_TRUE(comesOut(image(107)));
  EXPECT_TRUE(diagnosed("dropped: image stamp", "3"));

  EXPECT_EQ(frames_.messages().size(), 5u);
  for (std::size_t i = 1; i < 5; ++i) {
    EXPECT_EQ(frames_.messages()[i]->sequence, frames_.messages()[i - 1]->sequence + 1);
  }
}

TEST_F(Images, AClockThatJumpsBackStartsAnew) {
  infos_.publish(info());
  ASSERT_TRUE(comesOut(image(200)));
  ASSERT_TRUE(comesOut(image(201)));
  ASSERT_TRUE(comesOut(image(150)));
  EXPECT_EQ(frames_.messages().back()->sequence, 0u);
}

TEST_F(Images, AnotherCalibrationStartsAnew) {
  infos_.publish(info());
  ASSERT_TRUE(comesOut(image(300)));
  ASSERT_TRUE(comesOut(image(301)));
  sensor_msgs::CameraInfo other = info();
  other.K[0] = other.K[4] = 120;
  infos_.publish(other);
  // camera_info and image come by different ways: send images until the new one is in use.
  double stamp = 302;
  ASSERT_TRUE(waitUntil(
      [&] { return comesOut(image(stamp += 1)) && frames_.messages().back()->fx == 120; }));
  EXPECT_EQ(frames_.messages().back()->sequence, 0u);
  infos_.publish(info());
}

}  // namespace
}  // namespace ground_scale_vo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "images_rostest");
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
