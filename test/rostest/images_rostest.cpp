// Both nodelets with invalid input of a camera: each invalid image or camera_info is dropped and
// counted in the diagnostics, and the next valid one is used.

#include <gtest/gtest.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "topic_recorder.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {
namespace {

class Images : public testing::Test {
 protected:
  static constexpr std::uint32_t kWidth = 160, kHeight = 80;
  static constexpr double kPeriod = 0.1;  // of the images [s]

  Images()
      : images_(handle_.advertise<sensor_msgs::Image>("image", 100)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 100)),
        external_frames_(handle_.advertise<VoFrameMsg>("vo/frame", 100)),
        frames_(handle_, "vo/frame"),
        scales_(handle_, "scale"),
        log_(handle_, "/rosout"),
        diagnostics_(handle_, "/diagnostics") {}

  void SetUp() override {
    // roscpp counts subscribers by process; the diagnostics show that both nodelets are loaded.
    ASSERT_TRUE(waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             external_frames_.getNumSubscribers() > 1 && scales_.connected() &&
             diagnostics_.connected();
    }));
    ASSERT_TRUE(waitForValue("mono_vo", "images received", ""));
    ASSERT_TRUE(waitForValue("scale_recovery", "images", ""));
  }

  static sensor_msgs::Image image(double stamp, const std::string& encoding = "mono8",
                                  std::uint32_t pixel_bytes = 1) {
    sensor_msgs::Image image;
    image.header.stamp = ros::Time(stamp);
    image.header.frame_id = "camera";
    image.encoding = encoding;
    image.width = kWidth;
    image.height = kHeight;
    image.step = kWidth * pixel_bytes;
    image.data.assign(image.step * kHeight, 90);
    return image;
  }
  static sensor_msgs::CameraInfo info() {
    PinholeCamera camera;
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 100;
    camera.cx = 80;
    camera.cy = 40;
    return toCameraInfo(camera);
  }

  bool waitForValue(const std::string& nodelet, const std::string& key, const std::string& value) {
    return ground_scale_vo::waitForValue(diagnostics_, key, value, nodelet);
  }
  /// Publishes images until the predicate holds for a summary of mono_vo: without images, an error
  /// about missing ones would take its place.
  bool publishUntilSummary(double* stamp,
                           const std::function<bool(const std::string&)>& predicate) {
    diagnostics_.clear();
    return waitUntil([&] {
      return publishAndWait(image(*stamp += kPeriod)) &&
             anyStatus(diagnostics_.messages(), [&](const auto& status) {
               return status.name.find("mono_vo") != std::string::npos && predicate(status.message);
             });
    });
  }
  bool waitForSummaryWithout(const std::string& text, double* stamp) {
    return publishUntilSummary(
        stamp, [&](const std::string& message) { return message.find(text) == std::string::npos; });
  }
  /// Value of a counter in the nodelet's next diagnostics; 0 if they lack it.
  int counted(const std::string& nodelet, const std::string& key) {
    int count = 0;
    EXPECT_TRUE(waitForStatus(diagnostics_, [&](const auto& status) {
      count = countIn(status, key);
      return status.name.find(nodelet) != std::string::npos;
    }));
    return count;
  }
  /// Publishes a valid image and waits until both nodelets have processed it.
  bool publishAndWait(const sensor_msgs::Image& good) {
    images_.publish(good);
    return frames_.waitForStamp(good.header.stamp) && scales_.waitForStamp(good.header.stamp);
  }
  /// The same for images with stamps far from the last ones: the first image is held until the
  /// second one, with this stamp, confirms the jump of the clock.
  bool startAt(double stamp) {
    images_.publish(image(stamp - kPeriod));
    return publishAndWait(image(stamp));
  }
  /// Publishes a vo/frame with the stamp of an invalid image and waits for its scale. MonoVo
  /// publishes none, so this tests what ScaleRecovery does with that image.
  bool publishFrameOf(const sensor_msgs::Image& bad) {
    VoFrame frame;
    frame.camera = CalibratedCamera(info(), "t", false).camera();
    external_frames_.publish(toMsg(frame, bad.header));
    return scales_.waitForStamp(bad.header.stamp);
  }

  ros::NodeHandle handle_;
  ros::Publisher images_, infos_, external_frames_;
  TopicRecorder<VoFrameMsg> frames_;
  TopicRecorder<ScaleEstimateMsg> scales_;
  TopicRecorder<rosgraph_msgs::Log> log_;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
};

// Runs first: no camera_info has come yet.
TEST_F(Images, WaitForAUsableCameraInfo) {
  for (int i = 0; i < 10; ++i) images_.publish(image(10 + kPeriod * i));
  infos_.publish(sensor_msgs::CameraInfo());
  EXPECT_TRUE(waitForValue("mono_vo", "dropped: camera_info refused", "1"));
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                             "camera_info on topic /camera_info is all zeros"));
  EXPECT_TRUE(waitForValue("mono_vo", "images received", "10"));
  EXPECT_TRUE(waitForValue("mono_vo", "images dropped, queue full", "7"));  // queue_size is 3
  EXPECT_TRUE(waitForValue("scale_recovery", "dropped: camera_info refused", "1"));
  EXPECT_TRUE(frames_.messages().empty());
  infos_.publish(info());
  ASSERT_TRUE(frames_.waitForStamp(image(10 + 9 * kPeriod).header.stamp));
  EXPECT_EQ(frames_.messages().size(), 3u);  // the newest
}

/// A valid image with one invalid property.
struct BadImage {
  const char* name;
  std::function<void(sensor_msgs::Image*)> spoil;
};

TEST_F(Images, InvalidOnesAreDroppedAndCounted) {
  constexpr auto kMax = std::numeric_limits<std::uint32_t>::max();
  const std::vector<BadImage> bad_images = {
      {"data too short", [](auto* i) { i->data.resize(100); }},
      {"data too long", [](auto* i) { i->data.resize(i->data.size() + 1); }},
      {"no data", [](auto* i) { i->data.clear(); }},
      {"step too small", [](auto* i) { i->step = kWidth - 1; }},
      {"step zero", [](auto* i) { i->step = 0; }},
      {"step larger than data", [](auto* i) { i->step = kWidth + 1; }},
      {"largest step", [](auto* i) { i->step = kMax; }},
      {"odd step of 16 bits",
       [](auto* i) {
         i->encoding = "mono16";
         i->step = 2 * kWidth + 1;
         i->data.resize(i->step * kHeight);
       }},
      {"no width", [](auto* i) { i->width = 0; }},
      {"no height", [](auto* i) { i->height = 0; }},
      {"no size and no data", [](auto* i) { i->width = i->height = i->step = 0, i->data.clear(); }},
      {"largest size", [](auto* i) { i->width = i->height = i->step = kMax; }},
      {"another size",
       [](auto* i) {
         i->width = i->step = 80;
         i->data.resize(80 * kHeight);
       }},
      {"width and height exchanged",
       [](auto* i) {
         i->width = i->step = kHeight;
         i->height = kWidth;
       }},
      {"larger than in camera_info",
       [](auto* i) {
         i->width = i->step = 2 * kWidth;
         i->height = 2 * kHeight;
         i->data.resize(4 * kWidth * kHeight);
       }},
      {"unknown encoding", [](auto* i) { i->encoding = "nonsense"; }},
      {"no encoding", [](auto* i) { i->encoding.clear(); }},
      {"depth for grey",
       [](auto* i) {
         i->encoding = "32FC1";
         i->step = 4 * kWidth;
         i->data.resize(i->step * kHeight);
       }},
      {"colour with data for mono only", [](auto* i) { i->encoding = "bgr8"; }},
  };
  infos_.publish(info());
  double stamp = 100;
  ASSERT_TRUE(startAt(stamp));
  std::uint32_t sequence = frames_.messages().back()->sequence;
  const int without_image = counted("scale_recovery", "frames without an image");
  for (const BadImage& bad_image : bad_images) {
    const sensor_msgs::Image good = image(stamp += kPeriod);
    sensor_msgs::Image bad = image(stamp += kPeriod);
    bad_image.spoil(&bad);
    images_.publish(good);
    images_.publish(bad);
    ASSERT_TRUE(frames_.waitForStamp(good.header.stamp)) << "before " << bad_image.name;
    // Invalid images do not affect the odometry.
    EXPECT_EQ(frames_.messages().back()->sequence, ++sequence) << "before " << bad_image.name;
    ASSERT_TRUE(scales_.waitForStamp(good.header.stamp)) << "before " << bad_image.name;
    ASSERT_TRUE(publishFrameOf(bad)) << bad_image.name;
  }
  ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
  EXPECT_EQ(frames_.messages().back()->sequence, ++sequence);
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::WARN,
                             " images dropped in the last second", false));
  const std::string count = std::to_string(bad_images.size());
  EXPECT_TRUE(waitForValue("mono_vo", "dropped: image refused", count));
  EXPECT_TRUE(waitForValue("scale_recovery", "dropped: image refused", count));
  EXPECT_EQ(counted("scale_recovery", "frames without an image"),
            without_image + static_cast<int>(bad_images.size()));
  EXPECT_EQ(counted("mono_vo", "dropped: image failed"), 0);
  // The warning ends.
  EXPECT_TRUE(publishUntilSummary(
      &stamp, [](const std::string& message) { return message == "initialising"; }));
}

TEST_F(Images, EveryEncodingIsProcessed) {
  infos_.publish(info());
  double stamp = 200;
  ASSERT_TRUE(startAt(stamp));
  const int refused = counted("mono_vo", "dropped: image refused");
  const int without_image = counted("scale_recovery", "frames without an image");
  const auto expectProcessed = [&](sensor_msgs::Image good) {
    EXPECT_TRUE(publishAndWait(good))
        << good.encoding << ", big endian: " << int(good.is_bigendian);
    good.header.stamp = ros::Time(stamp += kPeriod);
    good.is_bigendian = 1;
    EXPECT_TRUE(publishAndWait(good)) << good.encoding << " big endian";
    good.header.stamp = ros::Time(stamp += kPeriod);
    good.step += 6;  // padding
    good.data.resize(good.step * kHeight);
    EXPECT_TRUE(publishAndWait(good)) << good.encoding << " with padding";
  };
  for (const std::uint32_t bytes : {1u, 2u}) {
    const std::string bits = bytes == 1 ? "8" : "16";
    for (const char* name : {"mono", "bayer_rggb", "bayer_bggr", "bayer_gbrg", "bayer_grbg"}) {
      expectProcessed(image(stamp += kPeriod, name + bits, bytes));
    }
    for (const char* name : {"bgr", "rgb"}) {
      expectProcessed(image(stamp += kPeriod, name + bits, 3 * bytes));
      expectProcessed(image(stamp += kPeriod, std::string(name) + "a" + bits, 4 * bytes));
    }
    for (const std::uint32_t channels : {1u, 3u, 4u}) {
      expectProcessed(
          image(stamp += kPeriod, bits + "UC" + std::to_string(channels), channels * bytes));
    }
  }
  expectProcessed(image(stamp += kPeriod, "yuv422", 2));
  expectProcessed(image(stamp += kPeriod, "yuv422_yuy2", 2));
  EXPECT_EQ(counted("mono_vo", "dropped: image refused"), refused);
  EXPECT_EQ(counted("scale_recovery", "frames without an image"), without_image);
}

TEST_F(Images, AnInvalidCameraInfoKeepsThePreviousOne) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  using Info = sensor_msgs::CameraInfo;
  const std::vector<std::function<void(Info*)>> spoils = {
      [](Info* i) { *i = Info(); },
      [](Info* i) { i->K.fill(0), i->P.fill(0); },
      [](Info* i) { i->K[0] = kNan; },
      [](Info* i) { i->P[0] = kNan; },
      [](Info* i) { i->D[0] = kNan; },
      [](Info* i) { i->R[0] = kNan; },
      [](Info* i) { i->K[0] = -100; },
      [](Info* i) { i->K[4] = 0; },
      [](Info* i) { i->K[0] = i->K[4] = 1e5; },
      [](Info* i) { i->K[2] = 1e4; },
      [](Info* i) { i->distortion_model = "unknown"; },
      [](Info* i) {
        i->D = {0.1, 0.2, 0.3};
      },
      [](Info* i) { i->distortion_model = "equidistant"; },
      [](Info* i) { i->width = 0; },
      // 10^10 pixels: the undistortion maps would need 60 GB.
      [](Info* i) { i->width = i->height = 100000, i->K[0] = i->K[4] = 5e4, i->D[0] = 0.1; },
      [](Info* i) { i->roi.x_offset = 1000, i->roi.width = i->roi.height = 10; },
      [](Info* i) { i->binning_x = 1000; },
  };
  infos_.publish(info());
  ASSERT_TRUE(startAt(300));
  const std::uint32_t sequence = frames_.messages().back()->sequence;
  const int refused = counted("mono_vo", "dropped: camera_info refused");
  for (const auto& spoil : spoils) {
    Info bad = info();
    spoil(&bad);
    infos_.publish(bad);
  }
  const std::string count = std::to_string(refused + static_cast<int>(spoils.size()));
  EXPECT_TRUE(waitForValue("mono_vo", "dropped: camera_info refused", count));
  EXPECT_TRUE(waitForValue("scale_recovery", "dropped: camera_info refused", count));
  ASSERT_TRUE(publishAndWait(image(300 + kPeriod)));
  EXPECT_EQ(frames_.messages().back()->sequence, sequence + 1);
  EXPECT_EQ(frames_.messages().back()->fx, 100);
}

TEST_F(Images, AnotherCalibrationResetsTheOdometry) {
  struct Camera {
    const char* model;
    std::vector<double> D;
    std::uint32_t width;  ///< of the full resolution
    std::uint32_t binning;
  };
  double stamp = 400, f = 110;  // [s], [px]
  for (const Camera& camera :
       {Camera{"plumb_bob", {0, 0, 0, 0, 0}, kWidth, 1},
        Camera{"plumb_bob", {-0.3, 0.1, 0, 0}, kWidth, 0},
        Camera{"rational_polynomial", std::vector<double>(8, 0.01), kWidth, 0},
        Camera{"equidistant", {0, 0, 0, 0}, kWidth, 0}, Camera{"", {}, kWidth, 0},
        Camera{"plumb_bob", {-0.3, 0.1, 0, 0, 0}, 2 * kWidth, 2}, Camera{"", {}, 100, 0},
        Camera{"", {}, kWidth, 0}}) {
    sensor_msgs::CameraInfo other = info();
    f += 2;
    other.K[0] = other.K[4] = f * std::max(camera.binning, 1u);
    other.distortion_model = camera.model;
    other.D = camera.D;
    other.width = camera.width;
    other.binning_x = other.binning_y = camera.binning;
    other.height = kHeight * std::max(camera.binning, 1u);
    infos_.publish(other);
    sensor_msgs::Image good = image(stamp);
    good.width = good.step = camera.width / std::max(camera.binning, 1u);
    good.data.resize(good.step * kHeight);
    // camera_info and image come over different connections: send images until the new camera_info
    // is in use. Images of another size are refused until then.
    ASSERT_TRUE(waitUntil([&] {
      good.header.stamp = ros::Time(stamp += kPeriod);
      images_.publish(good);
      return frames_.waitForStamp(good.header.stamp, 0.5) && frames_.messages().back()->fx == f;
    })) << camera.model;
    EXPECT_EQ(frames_.messages().back()->width, good.width);
    good.header.stamp = ros::Time(stamp += kPeriod);
    ASSERT_TRUE(publishAndWait(good));
    // The first image of this camera reset the odometry; a slow machine may have processed more
    // since.
    std::uint32_t of_this_camera = 0;
    for (const auto& frame : frames_.messages()) {
      if (frame->fx != f) continue;
      EXPECT_EQ(frame->sequence, of_this_camera++) << camera.model;
    }
    EXPECT_GE(of_this_camera, 2u) << camera.model;
  }
  EXPECT_TRUE(log_.wait([](const auto& lines) {
    return std::any_of(lines.begin(), lines.end(), [](const auto& line) {
      return line->msg.find("/camera_info changed from 100 x 80, fx 124,") != std::string::npos &&
             line->msg.find(" to 160 x 80, fx 126,") != std::string::npos;
    });
  }));
}

// Two publishers of camera_info that differ in the last digits.
TEST_F(Images, ACameraInfoThatVariesByLessThanATenthOfAPixelIsTheSameCamera) {
  infos_.publish(info());
  double stamp = 600;
  ASSERT_TRUE(startAt(stamp));
  ASSERT_TRUE(waitUntil([&] {
    return publishAndWait(image(stamp += kPeriod)) && frames_.messages().back()->fx == info().K[0];
  }));
  const std::uint32_t sequence = frames_.messages().back()->sequence;
  for (std::uint32_t i = 1; i <= 20; ++i) {
    sensor_msgs::CameraInfo nearly = info();
    nearly.K[0] += i % 2 == 0 ? 0.05 : 1e-9;
    nearly.D[0] += i % 2 == 0 ? 1e-6 : 0;
    infos_.publish(nearly);
    ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
    EXPECT_EQ(frames_.messages().back()->sequence, sequence + i);
    EXPECT_EQ(frames_.messages().back()->fx, info().K[0]);
  }
}

// The images of the first one are used.
TEST_F(Images, TwoCamerasOnOneTopicAreAnError) {
  infos_.publish(info());
  double stamp = 700;
  ASSERT_TRUE(startAt(stamp));
  for (const std::uint32_t width : {kWidth, kWidth / 2}) {
    frames_.clear();
    for (int i = 0; i < 10; ++i) {
      sensor_msgs::Image other = image(stamp += kPeriod);
      if (width == kWidth) other.header.frame_id = "other_camera";
      other.width = other.step = width;
      other.data.resize(width * kHeight);
      images_.publish(other);
      ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
    }
    const auto frames = frames_.messages();
    EXPECT_LE(frames.size(), 11u);  // one of the other camera, until the first one returns
    EXPECT_EQ(frames.back()->header.frame_id, "camera");
    const std::string size = " x " + std::to_string(kHeight);
    EXPECT_TRUE(waitForSummary(
        diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
        "two cameras publish on /image: the images alternate between frame_id \"camera\", " +
            std::to_string(kWidth) + size + ", which are used, and frame_id \"" +
            (width == kWidth ? "other_camera" : "camera") + "\", " + std::to_string(width) + size,
        false));
    EXPECT_TRUE(waitForValue("mono_vo", "dropped: image of another camera", ""));
    // Images of one camera alone end the error.
    for (int i = 0; i < 100; ++i) ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
    EXPECT_TRUE(waitForSummaryWithout("two cameras", &stamp));
  }
}

TEST_F(Images, ImagesWithoutAStampAreAWarning) {
  infos_.publish(info());
  double stamp = 760;
  ASSERT_TRUE(startAt(stamp));
  diagnostics_.clear();
  images_.publish(image(0));
  ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::WARN,
                             "1 images dropped in the last second", false));
}

TEST_F(Images, RefusingAllIsAnError) {
  infos_.publish(info());
  double stamp = 780;
  ASSERT_TRUE(startAt(stamp));
  diagnostics_.clear();
  EXPECT_TRUE(waitUntil([&] {
    sensor_msgs::Image bad = image(stamp += 0.001);
    bad.data.pop_back();
    images_.publish(bad);
    return anyStatus(diagnostics_.messages(), [](const auto& status) {
      return status.level == diagnostic_msgs::DiagnosticStatus::ERROR &&
             status.message.find("no usable image for ") == 0;
    });
  }));
  EXPECT_TRUE(publishUntilSummary(
      &stamp, [](const std::string& message) { return message == "initialising"; }));
}

TEST_F(Images, TwoCalibrationsOnOneTopicAreAnError) {
  infos_.publish(info());
  double stamp = 800;
  ASSERT_TRUE(startAt(stamp));
  ASSERT_TRUE(waitUntil([&] {
    return publishAndWait(image(stamp += kPeriod)) && frames_.messages().back()->fx == info().K[0];
  }));
  for (int i = 0; i < 5; ++i) {
    sensor_msgs::CameraInfo other = info();
    other.K[0] += 5;
    infos_.publish(other);
    infos_.publish(info());
    ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
  }
  EXPECT_TRUE(waitForSummary(diagnostics_, "mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                             "two cameras publish on /camera_info"));
  for (int i = 0; i < 100; ++i) infos_.publish(info());
  EXPECT_TRUE(waitForSummaryWithout("two cameras", &stamp));
}

// As in a raw bag of kitti2bag: K describes the raw camera, P the rectified images.
TEST_F(Images, AContradictionOfTheRectificationFlagIsReported) {
  sensor_msgs::CameraInfo rectified = info();
  rectified.P[0] = rectified.P[5] = 60;
  infos_.publish(rectified);
  EXPECT_EQ(info().K, rectified.K);  // the calibration in use is the same
  double stamp = 900;
  ASSERT_TRUE(startAt(stamp));
  EXPECT_TRUE(waitForStatus(diagnostics_, [](const auto& status) {
    return status.name.find("mono_vo") != std::string::npos &&
           status.level == diagnostic_msgs::DiagnosticStatus::WARN &&
           status.message.find("image_is_rectified is false, but P of camera_info (fx 60)") !=
               std::string::npos &&
           status.message.find(": if the images are rectified, set it to true") !=
               std::string::npos;
  }));
  infos_.publish(info());
  EXPECT_TRUE(waitForSummaryWithout("image_is_rectified", &stamp));
}

// A driver repeats camera_info with every image.
TEST_F(Images, AContradictionOfTheRectificationFlagIsLoggedOnce) {
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  const auto publish = [this](int fx_of_P) {
    sensor_msgs::CameraInfo rectified = info();
    rectified.P[0] = rectified.P[5] = fx_of_P;
    infos_.publish(rectified);
  };
  const auto warnings = [](const auto& lines, int fx_of_P) {
    const std::string text = "/mono_vo: image_is_rectified is false, but P of camera_info (fx " +
                             std::to_string(fx_of_P) + ")";
    return std::count_if(lines.begin(), lines.end(),
                         [&](const auto& line) { return line->msg.find(text) == 0; });
  };
  int fx_of_P = 40;
  ASSERT_TRUE(waitUntil([&] {  // until this test is connected to the log of the manager
    publish(++fx_of_P);
    return log.wait([&](const auto& lines) { return warnings(lines, fx_of_P) > 0; }, 0.5);
  }));
  for (int i = 0; i < 5; ++i) publish(30);
  publish(20);
  ASSERT_TRUE(log.wait([&](const auto& lines) { return warnings(lines, 20) > 0; }));
  EXPECT_EQ(warnings(log.messages(), 30), 1);
}

// Without a new camera_info, images of another size are refused until the old size is back.
TEST_F(Images, AnotherSizeAloneIsRefused) {
  infos_.publish(info());
  double stamp = 500;
  ASSERT_TRUE(waitUntil([&] {
    const sensor_msgs::Image good = image(stamp += kPeriod);
    images_.publish(good);
    return frames_.waitForStamp(good.header.stamp, 0.5) &&
           frames_.messages().back()->fx == info().K[0];
  }));
  const std::uint32_t sequence = frames_.messages().back()->sequence;
  const int refused = counted("mono_vo", "dropped: image refused");
  for (int i = 0; i < 3; ++i) {
    sensor_msgs::Image small = image(stamp += kPeriod);
    small.width = small.step = 100;
    small.data.resize(100 * kHeight);
    images_.publish(small);
  }
  EXPECT_TRUE(waitForValue("mono_vo", "dropped: image refused", std::to_string(refused + 3)));
  ASSERT_TRUE(publishAndWait(image(stamp += kPeriod)));
  EXPECT_EQ(frames_.messages().back()->sequence, sequence + 1);
}

}  // namespace
}  // namespace ground_scale_vo
