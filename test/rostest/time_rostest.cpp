// Both nodelets under use_sim_time: a clock that starts late, a looped bag, single wrong stamps, a
// pause of hours.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Core>
#include <algorithm>
#include <boost/make_shared.hpp>
#include <limits>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "topic_recorder.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::int64_t kSecond = 1000000000;     // [ns]
constexpr std::int64_t kStart = 1000 * kSecond;  // stamp of the first image [ns]

class Time : public testing::Test {
 protected:
  static constexpr std::size_t kFrames = 50;

  static void SetUpTestSuite() {
    SyntheticDrive::Options options;
    options.frames = kFrames;
    options.stop_s = 0;
    const SyntheticDrive drive(options);
    camera_ = drive.camera();
    for (std::size_t i = 0; i < kFrames; ++i) {
      grey_images_.push_back(drive.image(i));
      stamps_ns_.push_back(drive.frame(i).stamp_ns);
    }
  }

  Time()
      : clock_(handle_.advertise<rosgraph_msgs::Clock>("/clock", 10)),
        images_(handle_.advertise<sensor_msgs::Image>("image", 10)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 10)),
        external_frames_(handle_.advertise<VoFrameMsg>("vo/frame", 10)),
        frames_(handle_, "vo/frame"),
        scales_(handle_, "scale"),
        odometry_(handle_, "odometry"),
        tf_(handle_, "/tf"),
        diagnostics_(handle_, "/diagnostics") {}

  void SetUp() override {
    ASSERT_TRUE(waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             external_frames_.getNumSubscribers() > 1 && scales_.connected() &&
             odometry_.connected() && tf_.connected() && diagnostics_.connected();
    }));
    ASSERT_TRUE(waitForValue(diagnostics_, "images received", "", "mono_vo"));
    infos_.publish(toCameraInfo(camera_));
  }

  static std_msgs::Header header(std::int64_t stamp_ns) {
    std_msgs::Header header;
    header.stamp = fromNanoseconds(stamp_ns);
    header.frame_id = "camera";
    return header;
  }
  /// Publishes image i of the drive with this stamp and waits for the results.
  bool publishAndWait(std::size_t i, std::int64_t stamp_ns) {
    publish(i, stamp_ns);
    return frames_.waitForStamp(fromNanoseconds(stamp_ns)) &&
           scales_.waitForStamp(fromNanoseconds(stamp_ns));
  }
  void publish(std::size_t i, std::int64_t stamp_ns) {
    images_.publish(
        cv_bridge::CvImage(header(stamp_ns), sensor_msgs::image_encodings::MONO8, grey_images_[i])
            .toImageMsg());
  }
  /// The first images from start_ns on. The first one is held until the next one confirms its
  /// stamp.
  void playFirst(std::size_t count, std::int64_t start_ns) {
    publish(0, start_ns);
    for (std::size_t i = 1; i < count; ++i) {
      ASSERT_TRUE(publishAndWait(i, start_ns + stamps_ns_[i])) << i;
    }
  }
  /// All images from start_ns on. with_clock: publishes /clock too.
  void play(std::int64_t start_ns, bool with_clock) {
    for (std::size_t i = 0; i < kFrames; ++i) {
      if (with_clock) setClock(start_ns + stamps_ns_[i]);
      if (i == 0) {  // held until the next image confirms that the clock has jumped
        publish(i, start_ns);
      } else {
        ASSERT_TRUE(publishAndWait(i, start_ns + stamps_ns_[i])) << i;
      }
    }
    const ros::Time last = fromNanoseconds(start_ns + stamps_ns_.back());
    ASSERT_TRUE(odometry_.waitForStamp(last));
    ASSERT_TRUE(waitForTf(last));
  }
  void setClock(std::int64_t now_ns) {
    rosgraph_msgs::Clock clock;
    clock.clock = fromNanoseconds(now_ns);
    clock_.publish(clock);
    ASSERT_TRUE(waitUntil([&] { return ros::Time::now() == clock.clock; }));
  }
  /// The same, and waits until the nodelets have that time, too.
  void setClockOfNodelets(std::int64_t now_ns) {
    setClock(now_ns);
    ASSERT_TRUE(diagnostics_.wait([now_ns](const auto& messages) {
      return !messages.empty() && messages.back()->header.stamp == fromNanoseconds(now_ns);
    }));
  }
  bool waitForTf(const ros::Time& stamp) {
    return tf_.wait([&stamp](const auto& messages) {
      return !messages.empty() && messages.back()->transforms.at(0).header.stamp == stamp;
    });
  }
  void clear() {
    frames_.clear();
    scales_.clear();
    odometry_.clear();
    tf_.clear();
  }
  static bool finite(const nav_msgs::Odometry& odometry) {
    const auto all = [](const auto& covariance) {
      return Eigen::Map<const Eigen::Matrix<double, 36, 1>>(covariance.data()).allFinite();
    };
    const auto& twist = odometry.twist.twist;
    return all(odometry.pose.covariance) && all(odometry.twist.covariance) &&
           fromMsg(odometry.pose.pose).matrix().allFinite() &&
           Eigen::Vector3d(twist.linear.x, twist.linear.y, twist.linear.z).allFinite() &&
           Eigen::Vector3d(twist.angular.x, twist.angular.y, twist.angular.z).allFinite();
  }

  static PinholeCamera camera_;
  static std::vector<cv::Mat> grey_images_;
  static std::vector<std::int64_t> stamps_ns_;

  ros::NodeHandle handle_;
  ros::Publisher clock_, images_, infos_, external_frames_;
  TopicRecorder<VoFrameMsg> frames_;
  TopicRecorder<ScaleEstimateMsg> scales_;
  TopicRecorder<nav_msgs::Odometry> odometry_;
  TopicRecorder<tf2_msgs::TFMessage> tf_;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
};

PinholeCamera Time::camera_;
std::vector<cv::Mat> Time::grey_images_;
std::vector<std::int64_t> Time::stamps_ns_;

// Runs first. Three passes over the same stamps, as of a looped bag: the first without a clock, the
// second with a clock that starts then, the third after the clock has jumped back.
TEST_F(Time, ALateClockAndEachLoopOfABagGiveTheSameResults) {
  ASSERT_TRUE(ros::Time::now().isZero());
  std::vector<nav_msgs::Odometry::ConstPtr> first;
  std::uint32_t map_id = 0;
  for (int pass = 0; pass < 3; ++pass) {
    if (pass == 2) setClock(kStart + stamps_ns_.back() + 30 * kSecond);
    tf2_ros::Buffer buffer;
    const tf2_ros::TransformListener listener(buffer, handle_);
    clear();
    ASSERT_NO_FATAL_FAILURE(play(kStart, pass > 0)) << "pass " << pass;
    EXPECT_TRUE(waitForValue(diagnostics_, "images", "used", "scale_recovery"));

    const auto frames = frames_.messages();
    ASSERT_EQ(frames.size(), kFrames) << "pass " << pass;
    for (std::size_t i = 0; i < kFrames; ++i) EXPECT_EQ(frames[i]->sequence, i);
    const auto scales = scales_.messages();
    EXPECT_EQ(scales.size(), kFrames);
    if (pass > 0) {
      EXPECT_GT(scales.front()->map_id, map_id);
    }
    map_id = scales.back()->map_id;

    const auto odometry = odometry_.messages();
    if (pass == 0) first = odometry;
    ASSERT_GT(first.size(), kFrames / 2);
    ASSERT_EQ(odometry.size(), first.size()) << "pass " << pass;
    const auto transforms = tf_.messages();
    ASSERT_EQ(transforms.size(), odometry.size());
    for (std::size_t k = 0; k < first.size(); ++k) {
      // Each loop gives identical results.
      nav_msgs::Odometry again = *odometry[k];
      again.header.seq = first[k]->header.seq;
      EXPECT_EQ(again, *first[k]) << "pass " << pass << ", " << k;
      // tf holds nothing of the previous pass.
      geometry_msgs::TransformStamped transform = transforms[k]->transforms.at(0);
      transform.header.seq = odometry[k]->header.seq;
      EXPECT_EQ(transform, toTransformMsg(*odometry[k])) << "pass " << pass << ", " << k;
    }
    // tf2 clears a listener when the clock jumps; this one exists since the start of the pass.
    const auto& last = *odometry.back();
    ASSERT_TRUE(waitUntil([&] {
      return buffer.canTransform("odom", "camera", last.header.stamp, ros::Duration(0));
    }));
    EXPECT_EQ(buffer.lookupTransform("odom", "camera", last.header.stamp).transform,
              toTransformMsg(last).transform);
  }
}

// Frames that are late when the clock jumps back would be in the future of the new pass: tf2 would
// then ignore the transforms of all of it.
TEST_F(Time, LateFramesOfTheLastPassAreNotOnTf) {
  constexpr std::size_t kBefore = 40;
  constexpr std::int64_t start = kStart + 40000 * kSecond;
  clear();
  setClock(start);
  ASSERT_NO_FATAL_FAILURE(playFirst(kBefore, start));
  // The clock of bags may jump a little; not a loop.
  setClock(start - kSecond / 2);
  ASSERT_TRUE(publishAndWait(kBefore, start + stamps_ns_[kBefore]));
  const ros::Time last_on_tf = fromNanoseconds(start + stamps_ns_[kBefore]);
  ASSERT_TRUE(waitForTf(last_on_tf));

  constexpr std::int64_t again = start - 100 * kSecond;
  setClockOfNodelets(again);
  for (std::size_t i = kBefore + 1; i < kFrames; ++i) {
    ASSERT_TRUE(publishAndWait(i, start + stamps_ns_[i])) << i;
  }
  ASSERT_TRUE(odometry_.waitForStamp(fromNanoseconds(start + stamps_ns_.back())));
  ASSERT_NO_FATAL_FAILURE(play(again, true));

  ros::Time latest;
  for (const auto& message : tf_.messages()) {
    latest = std::max(latest, message->transforms.at(0).header.stamp);
  }
  EXPECT_EQ(latest, last_on_tf);
}

// The clock of the new pass comes after its first images; and stamps that are always ahead of it.
TEST_F(Time, TheNewPassIsOnTf) {
  constexpr std::size_t kLate = 20;  // images before the clock jumps
  for (const std::int64_t ahead : {10 * kSecond, std::int64_t{0}}) {
    constexpr std::int64_t start = kStart + 30000 * kSecond;
    for (const std::int64_t pass_start : {start, start - 100 * kSecond}) {
      const bool is_late = ahead == 0 && pass_start != start;
      clear();
      for (std::size_t i = 0; i < kFrames; ++i) {
        if (!is_late || i >= kLate) setClock(pass_start + stamps_ns_[i] - ahead);
        if (i == 0) {
          publish(i, pass_start);
        } else {
          ASSERT_TRUE(publishAndWait(i, pass_start + stamps_ns_[i])) << i;
        }
      }
      ASSERT_TRUE(odometry_.waitForStamp(fromNanoseconds(pass_start + stamps_ns_.back())));
      const std::size_t poses = odometry_.messages().size();
      EXPECT_GT(poses, kFrames / 2);
      EXPECT_TRUE(tf_.wait([&](const auto& messages) { return messages.size() == poses; }));
    }
  }
}

// Both nodelets drop and count such a message, and one with a repeated, an earlier or no stamp;
// nothing is reset.
TEST_F(Time, InvalidStampsAreDroppedAndCounted) {
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
  publish(0, kStart);
  ASSERT_TRUE(publishAndWait(1, kStart + stamps_ns_[1]));
  const std::uint32_t map_id = scales_.messages().back()->map_id;
  publish(2, kMost * kSecond);
  ASSERT_TRUE(publishAndWait(2, kStart + stamps_ns_[2]));
  EXPECT_EQ(frames_.messages().back()->sequence, 2u);
  publish(3, 0);
  ASSERT_TRUE(publishAndWait(3, kStart + stamps_ns_[3]));
  publish(4, kStart + stamps_ns_[3]);
  publish(4, kStart + stamps_ns_[2]);
  ASSERT_TRUE(publishAndWait(4, kStart + stamps_ns_[4]));
  EXPECT_EQ(frames_.messages().back()->sequence, 4u);
  EXPECT_EQ(scales_.messages().back()->map_id, map_id);
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: image stamp", "4", "mono_vo"));

  // MonoVo publishes no frames with such stamps, so this test does.
  VoFrameMsg frame = *frames_.messages().back();
  frame.map_start = ros::Time();  // unknown; a map cannot start after its frame
  const auto publishFrame = [&](std::int64_t stamp_ns) {
    frame.header = header(stamp_ns);
    ++frame.sequence;
    external_frames_.publish(frame);
  };
  for (const std::int64_t stamp_ns : {kMost * kSecond, std::int64_t{0}, kStart}) {
    publishFrame(stamp_ns);
  }
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: frame stamp", "3", "scale_recovery"));
  ASSERT_TRUE(publishAndWait(5, kStart + stamps_ns_[5]));

  // Two consistent stamps are a jump, even beyond the 2^31 s of ros::Duration, and back.
  publishFrame(kMost * kSecond - kSecond / 10);
  publishFrame(kMost * kSecond);
  ASSERT_TRUE(scales_.waitForStamp(fromNanoseconds(kMost * kSecond)));
  publishFrame(kStart + stamps_ns_[6]);
  publishFrame(kStart + stamps_ns_[7]);
  ASSERT_TRUE(scales_.waitForStamp(fromNanoseconds(kStart + stamps_ns_[7])));
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: frame stamp", "3", "scale_recovery"));
}

// Such an image is dropped by itself: the odometry is not reset, and neither its pose nor the
// stamps on tf jump.
TEST_F(Time, ASingleWrongStampCostsOneImage) {
  constexpr std::size_t kBefore = 20;
  constexpr std::int64_t start = kStart + 20000 * kSecond;
  clear();
  ASSERT_NO_FATAL_FAILURE(playFirst(kBefore, start));
  const std::uint32_t map_id = scales_.messages().back()->map_id;
  std::size_t i = kBefore;
  for (const std::int64_t error_s : {2, 30, 3000, -5}) {
    publish(i, start + stamps_ns_[i] + error_s * kSecond);
    ++i;
    for (const std::size_t end = i + 4; i < end; ++i) {
      ASSERT_TRUE(publishAndWait(i, start + stamps_ns_[i])) << i << ", " << error_s << " s";
    }
    EXPECT_EQ(scales_.messages().back()->map_id, map_id) << error_s << " s";
    EXPECT_EQ(frames_.messages().back()->status, VoFrameMsg::TRACKING) << error_s << " s";
  }
  EXPECT_EQ(frames_.messages().size(), i - 4);
  EXPECT_EQ(frames_.messages().back()->sequence - frames_.messages().front()->sequence, i - 5);
  const ros::Time last = fromNanoseconds(start + stamps_ns_[i - 1]);
  ASSERT_TRUE(odometry_.waitForStamp(last));
  const auto odometry = odometry_.messages();
  for (std::size_t k = 1; k < odometry.size(); ++k) {
    const auto &previous = *odometry[k - 1], &next = *odometry[k];
    EXPECT_GT(next.header.stamp, previous.header.stamp);
    const double step = next.pose.pose.position.x - previous.pose.pose.position.x;
    EXPECT_GT(step, 0) << next.header.stamp;
    EXPECT_LT(step, 3) << next.header.stamp;
  }
}

// After a pause of two hours the odometry continues. The first image is held until the next one
// confirms its stamp.
TEST_F(Time, APauseOfHoursIsBridged) {
  constexpr std::size_t kBefore = 30;
  constexpr std::int64_t start = kStart - 500 * kSecond;
  constexpr std::int64_t kPause = 7200 * kSecond;
  clear();
  ASSERT_NO_FATAL_FAILURE(playFirst(kBefore, start));
  publish(kBefore, start + kPause + stamps_ns_[kBefore]);
  for (std::size_t i = kBefore + 1; i < kFrames; ++i) {
    ASSERT_TRUE(publishAndWait(i, start + kPause + stamps_ns_[i])) << i;
  }
  EXPECT_EQ(scales_.messages().size(), kFrames);
  EXPECT_EQ(frames_.messages().back()->status, VoFrameMsg::TRACKING);
  EXPECT_EQ(frames_.messages().back()->sequence, kFrames - 1);  // no reset
  ASSERT_TRUE(odometry_.waitForStamp(fromNanoseconds(start + kPause + stamps_ns_.back())));
  for (const auto& odometry : odometry_.messages()) {
    EXPECT_TRUE(finite(*odometry)) << odometry->header.stamp;
    EXPECT_LT(odometry->twist.twist.linear.x, 12) << odometry->header.stamp;
  }
}

}  // namespace
}  // namespace ground_scale_vo
