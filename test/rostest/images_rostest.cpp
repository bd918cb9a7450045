// Both nodelets with invalid input of a camera: each invalid image or camera_info is dropped and
// counted in the diagnostics, and the next valid one is used. The same with compressed images.

#include <sensor_msgs/CompressedImage.h>

#include <opencv2/imgcodecs.hpp>

#include "manager_test.hpp"

namespace gsv {
namespace {

/// One pair of nodelets for all tests.
class Images : public ManagerTest {
 protected:
  using Image = sensor_msgs::Image;
  using Info = sensor_msgs::CameraInfo;
  static constexpr std::uint32_t kWidth = 160, kHeight = 80;
  static constexpr double kPeriod = 0.1;  // of the images [s]

  static Info cameraInfo() {
    return toCameraInfo(PinholeCamera{kWidth, kHeight, 100, 100, 80, 40});
  }

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
  static Image image() {
    return *toMsg(cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(90)), "mono8",
                  headerAt(ros::Time(stamp_ += kPeriod)));
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
  EXPECT_EQ(topics_->frames.count(), 0u);
  topics_->publishInfo(cameraInfo());
  ASSERT_TRUE(topics_->frames.waitForStamp(last.header.stamp));
  EXPECT_EQ(topics_->frames.count(), 3u);  // the newest

  // An invalid one keeps the previous one.
  Info invalid = cameraInfo();
  invalid.distortion_model = "unknown";
  topics_->publishInfo(invalid);
  EXPECT_TRUE(diagnostics_.waitForValues("mono_vo", {{"dropped: camera_info refused", "2"}}));
  ASSERT_TRUE(publishAndWait(image()));
  EXPECT_EQ(topics_->frames.last()->sequence, 3u);
  EXPECT_EQ(topics_->frames.last()->fx, 100);
}

TEST_F(Images, InvalidOnesAreDroppedAndCounted) {
  ASSERT_TRUE(use(cameraInfo()));
  ASSERT_TRUE(publishAndWait(image()));
  std::uint32_t sequence = topics_->frames.last()->sequence;
  for (int i = 0; i < 3; ++i) {
    Image bad = image();
    if (i == 0) bad.data.resize(100);
    if (i == 1) bad.height /= 2;
    if (i == 2) bad.encoding = "nonsense";
    topics_->publishImage(bad);
    ASSERT_TRUE(publishAndWait(image()));
    EXPECT_EQ(topics_->frames.last()->sequence, ++sequence) << i;  // it is not affected
  }
  EXPECT_TRUE(diagnostics_.waitForSummary("mono_vo", Status::WARN,
                                          " images dropped in the last second", false));
  EXPECT_TRUE(diagnostics_.waitForValues("mono_vo", {{"dropped: image refused", "3"}}));
  EXPECT_TRUE(publishUntilInitialising()) << "the warning does not end";
}

// With another distortion and another image size.
TEST_F(Images, AnotherCalibrationResetsTheOdometry) {
  const std::uint32_t width = 100;
  Info other = cameraInfo();
  other.K[0] = other.K[4] = 112;
  other.D = {-0.3, 0.1, 0, 0};
  other.width = width;
  ASSERT_TRUE(use(other, [](Image* image) {
    image->width = image->step = width;
    image->data.resize(width * kHeight);
  }));
  EXPECT_EQ(topics_->frames.last()->width, width);
  // The first image of this camera reset the odometry; a slow machine may have processed more
  // since.
  std::uint32_t of_this_camera = 0;
  for (const auto& frame : topics_->frames.messages()) {
    if (frame->fx == other.K[0]) {
      EXPECT_EQ(frame->sequence, of_this_camera++);
    }
  }
}

// On a busy machine images are ahead of camera_info, which come on another connection.
TEST_F(Images, AnImageWaitsForTheCameraInfoOfItsStamp) {
  NodeletTopics topics("/paired");
  ros::param::set("/paired/mono_vo/queue_size", 3);
  ASSERT_TRUE(manager_.load("MonoVo", "/paired/mono_vo"));
  ASSERT_TRUE(topics.waitForMonoVo());
  const auto publish_image = [&](std::uint32_t width) {
    Image next = image();
    next.width = next.step = width;
    next.data.resize(width * kHeight);
    topics.publishImage(next);
    return next.header.stamp;
  };
  const auto publish_info = [&](std::uint32_t width, const ros::Time& stamp) {
    Info info = cameraInfo();
    info.width = width;
    info.header.stamp = stamp;
    topics.publishInfo(info);
  };
  const ros::Time first = publish_image(kWidth);
  publish_info(kWidth, first);
  ASSERT_TRUE(topics.frames.waitForStamp(first));

  const std::uint32_t narrow = 120;
  const ros::Time second = publish_image(narrow), third = publish_image(narrow);
  publish_info(narrow, second);
  publish_info(narrow, third);
  ASSERT_TRUE(topics.frames.waitForStamp(third));
  EXPECT_EQ(topics.frames.count(), 3u);

  const ros::Time last = publish_image(narrow);
  EXPECT_TRUE(topics.frames.waitForStamp(last)) << "waits for a camera_info that is lost";
  EXPECT_TRUE(manager_.unload("/paired/mono_vo"));
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
           status.message.find("\"other_camera\"") != std::string::npos &&
           numberIn(status, "dropped: image of another camera") > 0;
  }));
  EXPECT_TRUE(publishUntilInitialising()) << "the end of one camera does not end the error";
}

// The odometry is not reset with every image.
TEST_F(Images, ACalibrationThatKeepsChangingIsAnError) {
  ASSERT_TRUE(use(cameraInfo()));
  const std::string error = "camera_info on topic /camera_info keeps changing";
  const std::ptrdiff_t resets = lines("the odometry is reset: camera_info");
  for (int i = 1; i <= 20; ++i) {
    Info drifting = cameraInfo();
    drifting.K[0] += 0.3 * i;
    topics_->publishInfo(drifting);
    ASSERT_TRUE(publishAndWait(image()));
  }
  EXPECT_GT(topics_->frames.last()->sequence, 10u);
  EXPECT_LE(lines("the odometry is reset: camera_info"), resets + 2);
  EXPECT_TRUE(diagnostics_.waitForSummary("mono_vo", Status::ERROR, error));
  EXPECT_TRUE(waitForLine("/mono_vo: " + error));
  for (int i = 0; i < 100; ++i) topics_->publishInfo(cameraInfo());
  EXPECT_TRUE(publishUntilInitialising()) << "the end of the changes does not end the error";
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
  ros::param::set("/jpeg/mono_vo/image_transport", "compressed");
  ASSERT_TRUE(manager_.load("MonoVo", "/jpeg/mono_vo"));
  ASSERT_TRUE(
      waitUntil([&] { return images.getNumSubscribers() > 0 && topics.frames.connected(); }));
  topics.publishInfo(cameraInfo());
  EXPECT_TRUE(diagnostics_.waitForSummary("jpeg/mono_vo", Status::ERROR,
                                          "no image received yet on /jpeg/image/compressed"));
  const auto publish = [&](sensor_msgs::CompressedImage image) {
    image.header.stamp = ros::Time(stamp_ += kPeriod);
    images.publish(image);
  };
  sensor_msgs::CompressedImage good;
  good.header.frame_id = "camera";
  good.format = "mono8; jpeg compressed mono8";
  cv::imencode(".jpg", cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar::all(90)), good.data);
  sensor_msgs::CompressedImage truncated = good;
  truncated.data.resize(truncated.data.size() / 2);
  publish(truncated);
  EXPECT_TRUE(diagnostics_.waitForSummary("jpeg/mono_vo", Status::ERROR, "no usable image", false));
  publish(good);
  EXPECT_TRUE(topics.frames.waitForStamp(ros::Time(stamp_)));
  EXPECT_TRUE(diagnostics_.waitForValues("jpeg/mono_vo", {{"dropped: image refused", "1"}}));
  EXPECT_TRUE(manager_.unload("/jpeg/mono_vo"));
}

}  // namespace
}  // namespace gsv
