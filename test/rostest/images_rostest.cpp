// Both nodelets with invalid input of a camera: each invalid image or camera_info is dropped and
// counted in the diagnostics, and the next valid one is used. The same with compressed images.

#include <gtest/gtest.h>
#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "manager_test.hpp"

namespace ground_scale_vo {
namespace {

/// One pair of nodelets for all tests.
class Images : public ManagerTest {
 protected:
  using Image = sensor_msgs::Image;
  using Info = sensor_msgs::CameraInfo;
  static constexpr std::uint32_t kWidth = 160, kHeight = 80;
  static constexpr double kPeriod = 0.1;  // of the images [s]

  static Info cameraInfo() { return toCameraInfo({kWidth, kHeight, 100, 100, 80, 40}); }

  static void TearDownTestSuite() {
    const ManagerClient manager("/manager");
    manager.unload("/mono_vo");
    manager.unload("/scale_recovery");
    topics_.reset();
  }
  void SetUp() override {
    ManagerTest::SetUp();
    if (!topics_) {
      topics_ = std::make_unique<NodeletTopics>("");
      ros::param::set("/mono_vo/queue_size", 3);
      ros::param::set("/scale_recovery/camera_height", 1.65);
      ASSERT_TRUE(manager_.load("MonoVo", "/mono_vo"));
      ASSERT_TRUE(manager_.load("ScaleRecovery", "/scale_recovery"));
    }
    ASSERT_TRUE(topics_->waitUntilConnected());
    ASSERT_TRUE(waitUntil([this] { return diagnostics_.connected(); }));
  }
  void TearDown() override {}

  /// The next image.
  Image image(const std::string& encoding = "mono8", std::uint32_t pixel_bytes = 1) {
    Image image;
    image.header.stamp = ros::Time(stamp_ += kPeriod);
    image.header.frame_id = "camera";
    image.encoding = encoding;
    image.width = kWidth;
    image.height = kHeight;
    image.step = kWidth * pixel_bytes;
    image.data.assign(image.step * kHeight, 90);
    return image;
  }
  /// Publishes a valid image and waits until both nodelets have processed it.
  bool publishAndWait(const Image& good) {
    topics_->publishImage(good);
    return topics_->waitForStamp(good.header.stamp);
  }
  /// Publishes images until this camera_info, which comes over another connection, is in use.
  bool use(const Info& info, const std::function<void(Image*)>& change = {}) {
    topics_->publishInfo(info);
    return waitUntil([&] {
      Image next = image();
      if (change) change(&next);
      topics_->publishImage(next);
      return topics_->frames.waitForStamp(next.header.stamp, 0.5) &&
             topics_->frames.last()->fx == info.K[0];
    });
  }
  /// Publishes images until the predicate holds for a summary of mono_vo: without images, an error
  /// about missing ones would take its place.
  bool publishUntilSummary(const std::function<bool(const Status&)>& predicate) {
    diagnostics_.clear();
    return waitUntil([&] {
      if (!publishAndWait(image())) return false;
      const auto reports = diagnostics_.messages();
      return std::any_of(reports.begin(), reports.end(), [&](const auto& report) {
        const Status& status = report->status.front();
        return status.name.find("mono_vo:") == 0 && predicate(status);
      });
    });
  }
  bool publishUntilInitialising() {
    return publishUntilSummary(
        [](const Status& status) { return status.message == "initialising"; });
  }

  static inline std::unique_ptr<NodeletTopics> topics_;
  static inline double stamp_ = 10;
};

// Runs first: no camera_info has come yet.
TEST_F(Images, WaitForAUsableCameraInfo) {
  Image last;
  for (int i = 0; i < 10; ++i) {
    last = image();
    topics_->publishImage(last);
  }
  topics_->publishInfo(Info());
  EXPECT_TRUE(diagnostics_.waitForStatus("mono_vo", [](const Status& status) {
    return status.level == Status::ERROR &&
           status.message.find("camera_info on topic /camera_info is all zeros") !=
               std::string::npos &&
           valueIn(status, "images received") == "10" &&
           valueIn(status, "images dropped, queue full") == "7" &&
           valueIn(status, "dropped: camera_info refused") == "1";
  }));
  EXPECT_TRUE(
      diagnostics_.waitForValues("scale_recovery", {{"dropped: camera_info refused", "1"}}));
  EXPECT_EQ(topics_->frames.count(), 0u);
  topics_->publishInfo(cameraInfo());
  ASSERT_TRUE(topics_->frames.waitForStamp(last.header.stamp));
  EXPECT_EQ(topics_->frames.count(), 3u);  // the newest

  // An invalid one keeps the previous one. The last one describes 10^10 pixels: the undistortion
  // maps would need 60 GB.
  std::vector<Info> invalid(3, cameraInfo());
  invalid[0].K[0] = std::numeric_limits<double>::quiet_NaN();
  invalid[1].distortion_model = "unknown";
  invalid[2].width = invalid[2].height = 100000;
  invalid[2].K[0] = invalid[2].K[4] = 5e4;
  invalid[2].D[0] = 0.1;
  for (const Info& info : invalid) topics_->publishInfo(info);
  for (const char* nodelet : {"mono_vo", "scale_recovery"}) {
    EXPECT_TRUE(diagnostics_.waitForValues(nodelet, {{"dropped: camera_info refused", "4"}}));
  }
  ASSERT_TRUE(publishAndWait(image()));
  EXPECT_EQ(topics_->frames.last()->sequence, 3u);
  EXPECT_EQ(topics_->frames.last()->fx, 100);
}

// Each after a valid image of another encoding.
TEST_F(Images, InvalidOnesAreDroppedAndCounted) {
  const struct {
    const char* name;
    std::function<void(Image*)> spoil;
  } kBadImages[] = {
      {"data too short", [](Image* i) { i->data.resize(100); }},
      {"no data", [](Image* i) { i->data.clear(); }},
      {"step zero", [](Image* i) { i->step = 0; }},
      {"largest size",
       [](Image* i) {
         i->width = i->height = i->step = std::numeric_limits<std::uint32_t>::max();
       }},
      {"another size",
       [](Image* i) {
         i->width = i->step = 80;
         i->data.resize(80 * kHeight);
       }},
      {"unknown encoding", [](Image* i) { i->encoding = "nonsense"; }},
      {"colour with data for mono only", [](Image* i) { i->encoding = "bgr8"; }},
  };
  const std::pair<const char*, std::uint32_t> kEncodings[] = {
      {"mono8", 1},       {"mono16", 2}, {"bgr8", 3}, {"rgba8", 4},
      {"bayer_rggb8", 1}, {"yuv422", 2}, {"16UC1", 2}};
  ASSERT_TRUE(use(cameraInfo()));
  ASSERT_TRUE(publishAndWait(image()));
  // MonoVo publishes no frames of invalid images. These show what ScaleRecovery does with them.
  ros::Publisher frames = handle_.advertise<VoFrameMsg>("vo/frame", 100);
  ASSERT_TRUE(waitUntil([&] { return frames.getNumSubscribers() > 1; }));
  VoFrame frame;
  frame.camera = CalibratedCamera(cameraInfo(), "t", false).camera();
  std::uint32_t sequence = topics_->frames.last()->sequence;
  const double without_image =
      numberIn(diagnostics_.next("scale_recovery"), "frames without an image");
  std::size_t count = 0;
  for (const auto& bad_image : kBadImages) {
    SCOPED_TRACE(bad_image.name);
    const auto& [encoding, bytes] = kEncodings[count++];
    Image good = image(encoding, bytes);
    good.step += 6;  // padding
    good.data.resize(good.step * kHeight, 90);
    Image bad = image();
    bad_image.spoil(&bad);
    topics_->publishImage(good);
    topics_->publishImage(bad);
    ASSERT_TRUE(topics_->waitForStamp(good.header.stamp)) << encoding;
    // Invalid images do not affect the odometry.
    EXPECT_EQ(topics_->frames.last()->sequence, ++sequence);
    frames.publish(toMsg(frame, bad.header));
    ASSERT_TRUE(topics_->scales.waitForStamp(bad.header.stamp));
  }
  ASSERT_TRUE(publishAndWait(image()));
  EXPECT_EQ(topics_->frames.last()->sequence, ++sequence);
  EXPECT_TRUE(diagnostics_.waitForSummary("mono_vo", Status::WARN,
                                          " images dropped in the last second", false));
  EXPECT_TRUE(diagnostics_.waitForStatus("mono_vo", [&](const Status& status) {
    return numberIn(status, "dropped: image refused") == static_cast<double>(count) &&
           numberIn(status, "dropped: image failed") == 0;
  }));
  EXPECT_TRUE(diagnostics_.waitForStatus("scale_recovery", [&](const Status& status) {
    return numberIn(status, "dropped: image refused") == static_cast<double>(count) &&
           numberIn(status, "frames without an image") ==
               without_image + static_cast<double>(count);
  }));
  EXPECT_TRUE(publishUntilInitialising()) << "the warning does not end";
}

TEST_F(Images, AnotherCalibrationResetsTheOdometry) {
  const struct {
    const char* model;
    std::vector<double> D;
    std::uint32_t width;
  } kCameras[] = {{"plumb_bob", {-0.3, 0.1, 0, 0}, kWidth},
                  {"equidistant", {0, 0, 0, 0}, kWidth},
                  {"", {}, 100}};
  double f = 110;  // [px]
  for (const auto& camera : kCameras) {
    SCOPED_TRACE(f);
    Info other = cameraInfo();
    f += 2;
    other.K[0] = other.K[4] = f;
    other.distortion_model = camera.model;
    other.D = camera.D;
    other.width = camera.width;
    const auto resize = [&](Image* image) {
      image->width = image->step = camera.width;
      image->data.resize(image->step * kHeight);
    };
    ASSERT_TRUE(use(other, resize));
    Image good = image();
    resize(&good);
    ASSERT_TRUE(publishAndWait(good));
    EXPECT_EQ(topics_->frames.last()->width, good.width);
    // The first image of this camera reset the odometry; a slow machine may have processed more
    // since.
    std::uint32_t of_this_camera = 0;
    for (const auto& frame : topics_->frames.messages()) {
      if (frame->fx == f) {
        EXPECT_EQ(frame->sequence, of_this_camera++);
      }
    }
    EXPECT_GE(of_this_camera, 2u);
  }
}

// The images and the calibration of the first one are used.
TEST_F(Images, TwoCamerasOnOneTopicAreAnError) {
  ASSERT_TRUE(use(cameraInfo()));
  ASSERT_TRUE(publishAndWait(image()));
  topics_->frames.clear();
  for (int i = 0; i < 10; ++i) {
    Image other = image();
    other.header.frame_id = "other_camera";
    topics_->publishImage(other);
    ASSERT_TRUE(publishAndWait(image()));
  }
  // One of the other camera, until the first one returns.
  EXPECT_LE(topics_->frames.count(), 11u);
  EXPECT_EQ(topics_->frames.last()->header.frame_id, "camera");
  EXPECT_TRUE(diagnostics_.waitForStatus("mono_vo", [](const Status& status) {
    return status.level == Status::ERROR &&
           status.message.find("two cameras publish on /image") == 0 &&
           status.message.find("frame_id \"other_camera\"") != std::string::npos &&
           numberIn(status, "dropped: image of another camera") > 0;
  }));
  EXPECT_TRUE(publishUntilInitialising()) << "the end of one camera does not end the error";

  for (int i = 0; i < 5; ++i) {
    Info other = cameraInfo();
    other.K[0] += 5;
    topics_->publishInfo(other);
    topics_->publishInfo(cameraInfo());
    ASSERT_TRUE(publishAndWait(image()));
  }
  EXPECT_TRUE(
      diagnostics_.waitForSummary("mono_vo", Status::ERROR, "two cameras publish on /camera_info"));
  for (int i = 0; i < 100; ++i) topics_->publishInfo(cameraInfo());
  EXPECT_TRUE(publishUntilInitialising());
}

// As in a raw bag of kitti2bag: K describes the raw camera, P the rectified images. A driver
// repeats camera_info with every image.
TEST_F(Images, AContradictionOfTheRectificationFlagIsReportedAndLoggedOnce) {
  const std::string text = "image_is_rectified is false, but P of camera_info (fx 60)";
  Info rectified = cameraInfo();
  rectified.P[0] = rectified.P[5] = 60;
  ASSERT_TRUE(use(rectified));
  for (int i = 0; i < 5; ++i) topics_->publishInfo(rectified);
  EXPECT_TRUE(publishUntilSummary([&](const Status& status) {
    return status.level == Status::WARN && status.message.find(text) != std::string::npos;
  }));
  ASSERT_TRUE(waitForLine("/mono_vo: " + text));
  EXPECT_EQ(lines("/mono_vo: " + text), 1);
  topics_->publishInfo(cameraInfo());
  EXPECT_TRUE(publishUntilInitialising());
}

// The plugin of image_transport need not be installed.
TEST_F(Images, CompressedOnesAreProcessedAndInvalidOnesDropped) {
  const ros::Publisher images =
      handle_.advertise<sensor_msgs::CompressedImage>("/jpeg/image/compressed", 100);
  NodeletTopics topics("/jpeg");
  ros::param::set("/jpeg/scale_recovery/camera_height", 1.65);
  for (const std::string nodelet : {"/jpeg/mono_vo", "/jpeg/scale_recovery"}) {
    ros::param::set(nodelet + "/image_transport", "compressed");
    ASSERT_TRUE(manager_.load(nodelet == "/jpeg/mono_vo" ? "MonoVo" : "ScaleRecovery", nodelet));
  }
  ASSERT_TRUE(waitUntil([&] {
    return images.getNumSubscribers() > 0 && topics.frames.connected() && topics.scales.connected();
  }));
  topics.publishInfo(cameraInfo());
  EXPECT_TRUE(diagnostics_.waitForSummary("jpeg/mono_vo", Status::ERROR,
                                          "no image received yet on /jpeg/image/compressed"));
  const auto compressed = [](const std::string& format, const std::string& extension, int type) {
    sensor_msgs::CompressedImage image;
    image.header.frame_id = "camera";
    image.format = format;
    cv::imencode(extension, cv::Mat(kHeight, kWidth, type, cv::Scalar::all(90)), image.data);
    return image;
  };
  const auto publish = [&](sensor_msgs::CompressedImage image) {
    image.header.stamp = ros::Time(stamp_ += kPeriod);
    images.publish(image);
  };
  const auto publishAndWait = [&](const sensor_msgs::CompressedImage& image) {
    publish(image);
    return topics.waitForStamp(ros::Time(stamp_));
  };
  const auto good = compressed("mono8; jpeg compressed mono8", ".jpg", CV_8UC1);
  sensor_msgs::CompressedImage truncated = good, empty = good;
  truncated.data.resize(truncated.data.size() / 2);
  empty.data.clear();
  publish(truncated);
  EXPECT_TRUE(diagnostics_.waitForSummary("jpeg/mono_vo", Status::ERROR, "no usable image", false));
  ASSERT_TRUE(publishAndWait(good));
  EXPECT_TRUE(publishAndWait(compressed("rgb8; jpeg compressed bgr8", ".jpg", CV_8UC3)));
  EXPECT_TRUE(publishAndWait(compressed("mono16; png compressed", ".png", CV_16UC1)));
  publish(empty);
  ASSERT_TRUE(publishAndWait(good));
  EXPECT_EQ(topics.frames.last()->sequence, 3u);
  EXPECT_TRUE(diagnostics_.waitForValues("jpeg/mono_vo", {{"dropped: image refused", "2"}}));
  EXPECT_TRUE(diagnostics_.waitForValues("jpeg/scale_recovery",
                                         {{"dropped: image refused", "2"}, {"images", "used"}}));
  EXPECT_TRUE(manager_.unload("/jpeg/mono_vo") && manager_.unload("/jpeg/scale_recovery"));
}

}  // namespace
}  // namespace ground_scale_vo
