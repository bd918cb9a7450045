// ScaleRecovery fed by another odometry: a camera 1 VO unit above a flat road, with exact points.
// The mounting comes from tf, late; the clock jumps; the odometry restarts; messages are malformed.
// A second ScaleRecovery in the namespace `alone` gets the same frames with `refine: false` (no
// images). The difference of the two outputs is the effect of the images.

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <vector>

#include "call_service.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "mounting.hpp"
#include "support/road_image.hpp"
#include "topic_recorder.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kCameraHeight = 1.65;  // [m] for 1 VO unit
constexpr double kStep = 0.5;           // [VO units] per frame
constexpr double kPeriod = 0.1;         // [s]
/// [VO units] height of the camera above the road in the images. In the points it is 1, so the
/// scale shows whether the images are used.
constexpr double kImageHeight = 1.02;

/// The simulated odometry.
class FlatRoad {
 public:
  explicit FlatRoad(double start_s) : start_s_(start_s) {
    camera_.width = 620;
    camera_.height = 188;
    camera_.fx = camera_.fy = 359;
    camera_.cx = 303;
    camera_.cy = 92;
  }

  const PinholeCamera& camera() const { return camera_; }

  /// The image of the frame that next() will return.
  sensor_msgs::Image::Ptr nextImage() const {
    RoadScene scene;
    scene.camera = camera_;
    scene.height = kImageHeight;
    scene.pitch = 0;
    const cv::Mat grey = roadImage(scene, kStep * sequence_);
    auto image = boost::make_shared<sensor_msgs::Image>();
    image->header = header();
    image->encoding = "mono8";
    image->width = image->step = static_cast<std::uint32_t>(grey.cols);
    image->height = static_cast<std::uint32_t>(grey.rows);
    image->data.assign(grey.datastart, grey.dataend);
    return image;
  }

  /// Of the frame that next() returned last.
  ros::Time lastStamp() const { return ros::Time(start_s_ + kPeriod * (sequence_ - 1.0)); }
  /// The next frame of the odometry.
  VoFrameMsg::Ptr next() {
    VoFrame frame;
    frame.sequence = sequence_;
    frame.status = VoStatus::kTracking;
    frame.keyframe = true;
    frame.camera = camera_;
    frame.T_w_c.translation().z() = kStep * sequence_;
    std::uint64_t id = 0;
    for (int row = 0; row < 200; ++row) {
      for (int column = -6; column <= 6; ++column, ++id) {
        // Irregular spacing: on a regular grid the Delaunay triangulation is ambiguous. The two
        // outer columns are a facade, at five heights.
        const double x = 0.7 * column + 0.2 * std::sin(7.0 * static_cast<double>(id));
        const double z = 0.8 * row + 0.3 * std::sin(3.0 * static_cast<double>(id));
        const bool facade = std::abs(column) == 6;
        const Eigen::Vector3d p_c(facade ? 2 * x : x, facade ? -0.3 * (row % 5) : 1.0,
                                  z - kStep * sequence_);
        if (p_c.z() < 2.0 || p_c.z() > 25.0) continue;
        const Eigen::Vector2d u = camera_.project(p_c);
        if (u.x() < 0 || u.y() < 0 || u.x() > camera_.width - 1 || u.y() > camera_.height - 1) {
          continue;
        }
        TrackedFeature feature;
        feature.id = id;
        feature.age = sequence_;
        feature.u = u.cast<float>();
        feature.has_point = true;
        feature.p_c = p_c.cast<float>();
        feature.depth_sigma = static_cast<float>(0.002 * p_c.z() * p_c.z());
        frame.features.push_back(feature);
      }
    }
    const std_msgs::Header stamped = header();
    frame.stamp_ns = toNanoseconds(stamped.stamp);
    ++sequence_;
    return toMsg(frame, stamped);
  }

 private:
  std_msgs::Header header() const {
    std_msgs::Header header;
    header.stamp = ros::Time(start_s_ + kPeriod * sequence_);
    header.frame_id = "camera";
    return header;
  }

  PinholeCamera camera_;
  double start_s_;
  std::uint32_t sequence_ = 0;
};

class Scale : public testing::Test {
 protected:
  static constexpr int kFrames = 40;

  Scale()
      : frames_(handle_.advertise<VoFrameMsg>("vo/frame", 100)),
        scales_(handle_, "scale"),
        odometry_(handle_, "odometry") {}

  void SetUp() override {
    ASSERT_TRUE(reset());
    ASSERT_TRUE(waitUntil([this] {
      return frames_.getNumSubscribers() > 0 && scales_.connected() && odometry_.connected();
    }));
  }
  /// Waits for the reset service, i.e. until the nodelet is loaded, and calls it. The number of
  /// subscribers does not show that: roscpp has one connection per topic and process, and the other
  /// nodelet may hold it.
  static bool reset(const std::string& service = "scale_recovery/reset") {
    return ros::service::waitForService(service, static_cast<std::int32_t>(1000 * kTimeout)) &&
           callTrigger(service);
  }
  void play(FlatRoad& road, int frames) {
    for (int i = 0; i < frames; ++i) frames_.publish(road.next());
    ASSERT_TRUE(scales_.waitForStamp(road.lastStamp()));
  }
  static void publishMounting() {
    static tf2_ros::StaticTransformBroadcaster broadcaster;
    geometry_msgs::TransformStamped second = mounting("base_link", {1.5, 2, 1.4});
    second.child_frame_id = "camera2";
    broadcaster.sendTransform({mounting("base_link", {1.5, 0, 1.4}), second});
  }
  /// Publishes frames until the first `odometry`, i.e. until the nodelet has received the mounting
  /// transform.
  void playUntilOdometry(FlatRoad& road) {
    ASSERT_TRUE(waitUntil([&] {
      frames_.publish(road.next());
      return !odometry_.messages().empty();
    }));
    // The next test must not receive the results of these frames.
    ASSERT_TRUE(odometry_.waitForStamp(road.lastStamp()));
  }

  ros::NodeHandle handle_;
  ros::Publisher frames_;
  TopicRecorder<ScaleEstimateMsg> scales_;
  TopicRecorder<nav_msgs::Odometry> odometry_;
};

// The first test: no mounting transform has been published yet.
TEST_F(Scale, NoOdometryIsPublishedWithoutTheMounting) {
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  TopicRecorder<tf2_msgs::TFMessage> tf(handle_, "/tf");
  TopicRecorder<nav_msgs::Odometry> alone(handle_, "alone/odometry");
  ASSERT_TRUE(waitUntil([&] { return tf.connected() && alone.connected(); }));
  FlatRoad road(1000);
  play(road, kFrames);
  EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK);
  EXPECT_NEAR(scales_.messages().back()->scale, kCameraHeight, 0.03);
  EXPECT_TRUE(odometry_.messages().empty());
  // `alone` needs no mounting, and has publish_tf false.
  ASSERT_TRUE(alone.waitForStamp(road.lastStamp()));
  EXPECT_TRUE(tf.messages().empty());

  // A fixed mounting is not waited for: 200 ms would be as long as two frames.
  EXPECT_TRUE(waitUntil([&] {
    frames_.publish(road.next());
    const auto reports = diagnostics.messages();
    return std::any_of(reports.begin(), reports.end(), [](const auto& report) {
      return report->status.front().name.find("scale_recovery") == 0 &&
             countIn(report->status.front(), "frames processed") > kFrames &&
             numberIn(report->status.front(), "time of the last frame [ms]") < 150;
    });
  }));

  publishMounting();  // late
  ASSERT_NO_FATAL_FAILURE(playUntilOdometry(road));
  EXPECT_EQ(odometry_.messages().front()->child_frame_id, "base_link");
}

TEST_F(Scale, TheBaseDrivesAlongXFromTheOrigin) {
  publishMounting();
  FlatRoad road(2000);
  playUntilOdometry(road);
  play(road, kFrames);
  const ros::Time last = scales_.messages().back()->header.stamp;
  ASSERT_TRUE(odometry_.waitForStamp(last));
  const nav_msgs::Odometry odometry = *odometry_.messages().back();
  // SetUp has called the service: the first pose is zero.
  const geometry_msgs::Point& origin = odometry_.messages().front()->pose.pose.position;
  EXPECT_NEAR(std::hypot(origin.x, origin.y, origin.z), 0, 1e-12);
  const ros::Duration driven = last - odometry_.messages().front()->header.stamp;
  const double metres = kCameraHeight * kStep * driven.toSec() / kPeriod;
  EXPECT_NEAR(odometry.pose.pose.position.x, metres, 0.02 * metres);
  EXPECT_NEAR(odometry.pose.pose.position.y, 0, 0.02 * metres);
  EXPECT_NEAR(odometry.pose.pose.position.z, 0, 0.02 * metres);
  EXPECT_NEAR(odometry.pose.pose.orientation.w, 1, 1e-6);
  EXPECT_NEAR(odometry.twist.twist.linear.x, kCameraHeight * kStep / kPeriod, 0.2);
  EXPECT_GT(odometry.pose.covariance[0], 0);
}

TEST_F(Scale, AnEmptyFrameIdIsAnErrorOfItsFrameOnly) {
  publishMounting();
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  FlatRoad road(2500);
  playUntilOdometry(road);
  const auto nextFrame = [&] { play(road, 2); };
  const auto nextFrameIsLost = [&] {
    const VoFrameMsg::Ptr lost = road.next();
    lost->status = VoFrameMsg::LOST;
    frames_.publish(lost);
  };
  const auto isReset = [] { ASSERT_TRUE(reset()); };
  const std::vector<std::function<void()>> ends{nextFrame, nextFrameIsLost, isReset};
  for (const auto& end : ends) {
    const VoFrameMsg::Ptr unnamed = road.next();
    unnamed->header.frame_id.clear();
    frames_.publish(unnamed);
    EXPECT_TRUE(waitForStatus(diagnostics, [](const auto& status) {
      return status.name.find("scale_recovery") == 0 &&
             status.level == diagnostic_msgs::DiagnosticStatus::ERROR &&
             status.message.find("frame_id of the images is empty") != std::string::npos;
    }));
    end();
    EXPECT_TRUE(waitForStatus(diagnostics, [](const auto& status) {
      return status.name.find("scale_recovery") == 0 &&
             status.level < diagnostic_msgs::DiagnosticStatus::ERROR;
    }));
  }
}

// `alone` publishes the pose of the camera.
TEST_F(Scale, AnotherCameraFrameResets) {
  publishMounting();
  TopicRecorder<nav_msgs::Odometry> alone(handle_, "alone/odometry");
  ASSERT_TRUE(waitUntil([&] { return alone.connected(); }));
  FlatRoad road(2600);
  playUntilOdometry(road);
  play(road, kFrames);
  ASSERT_TRUE(alone.waitForStamp(road.lastStamp()));
  ASSERT_TRUE(odometry_.waitForStamp(road.lastStamp()));
  EXPECT_EQ(alone.messages().back()->child_frame_id, "camera");
  for (auto* recorder : {&alone, &odometry_}) recorder->clear();
  scales_.clear();
  for (int i = 0; i < kFrames; ++i) {
    const VoFrameMsg::Ptr frame = road.next();
    frame->header.frame_id = "camera2";
    frames_.publish(frame);
  }
  ASSERT_TRUE(scales_.waitForStamp(road.lastStamp()));
  EXPECT_EQ(scales_.messages().front()->status, ScaleEstimateMsg::UNKNOWN);
  const double speed = kCameraHeight * kStep / kPeriod;
  for (auto* recorder : {&alone, &odometry_}) {
    const bool is_base = recorder == &odometry_;
    ASSERT_TRUE(recorder->waitForStamp(road.lastStamp()));
    const auto& first = *recorder->messages().front();
    const auto& last = *recorder->messages().back();
    EXPECT_EQ(first.child_frame_id, is_base ? "base_link" : "camera2");
    const auto& origin = first.pose.pose.position;
    EXPECT_NEAR(std::hypot(origin.x, origin.y, origin.z), 0, 1e-12);
    const double metres = speed * (last.header.stamp - first.header.stamp).toSec();
    EXPECT_GT(metres, 10);
    EXPECT_NEAR(last.pose.pose.position.x, metres, 0.02 * metres);
    // The other mounting is no motion of the base.
    const geometry_msgs::Vector3& velocity = last.twist.twist.linear;
    EXPECT_NEAR(is_base ? velocity.x : velocity.z, speed, 0.2);
    EXPECT_NEAR(velocity.y, 0, 0.1);
    EXPECT_NEAR(is_base ? velocity.z : velocity.x, 0, 0.1);
  }
}

TEST_F(Scale, ALeadingSlashOfFrameIdIsRemoved) {
  publishMounting();
  FlatRoad road(2700);
  ASSERT_TRUE(waitUntil([&] {
    const VoFrameMsg::Ptr frame = road.next();
    frame->header.frame_id = "/camera";
    frames_.publish(frame);
    return !odometry_.messages().empty();
  }));
  ASSERT_TRUE(odometry_.waitForStamp(road.lastStamp()));
  EXPECT_EQ(scales_.messages().back()->header.frame_id, "camera");
}

TEST_F(Scale, ResetMakesTheScaleUnknown) {
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  FlatRoad road(3000);
  play(road, kFrames);
  ASSERT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK);
  ASSERT_TRUE(reset());
  // `alone` is not reset.
  EXPECT_TRUE(waitForValue(diagnostics, "scale status", "unknown", "scale_recovery"));
  EXPECT_TRUE(waitForValue(diagnostics, "distance [m]", "0", "scale_recovery"));
  EXPECT_TRUE(waitForStatus(diagnostics, [](const auto& status) {
    return status.name.find("scale_recovery") == 0 &&
           std::none_of(status.values.begin(), status.values.end(), [](const auto& entry) {
             return entry.key == "age of the last measurement [s]";
           });
  }));
  EXPECT_TRUE(waitForValue(diagnostics, "images", "no publisher on /image", "scale_recovery"));
  play(road, 1);
  EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::UNKNOWN);
}

void removeFeatures(VoFrameMsg& frame) {
  for (auto* array : {&frame.u, &frame.v, &frame.x, &frame.y, &frame.z, &frame.depth_sigma}) {
    array->clear();
  }
  frame.id.clear();
  frame.age.clear();
}

TEST_F(Scale, AScaleThatIsHeldForSecondsIsReported) {
  publishMounting();
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  FlatRoad road(3500);
  playUntilOdometry(road);
  play(road, kFrames);
  for (int i = 0; i < kFrames; ++i) {
    const VoFrameMsg::Ptr frame = road.next();
    removeFeatures(*frame);
    frames_.publish(frame);
  }
  ASSERT_TRUE(scales_.waitForStamp(road.lastStamp()));
  EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::HELD);
  // From the first of the 40 frames to the last.
  EXPECT_TRUE(waitForSummary(diagnostics, "scale_recovery", diagnostic_msgs::DiagnosticStatus::WARN,
                             "scale held for 3.9 s: too_few_triangles"));
  EXPECT_TRUE(waitForValue(diagnostics, "reason", "too_few_triangles", "scale_recovery"));
  // From the frame before them.
  EXPECT_TRUE(waitForValue(diagnostics, "age of the last measurement [s]", "4", "scale_recovery"));
}

TEST_F(Scale, AStandstillIsNotPartOfTheTimeForWhichTheScaleIsHeld) {
  publishMounting();
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  FlatRoad road(3800);
  playUntilOdometry(road);
  play(road, kFrames - 1);
  const VoFrameMsg::Ptr last = road.next();
  frames_.publish(last);
  VoFrameMsg::Ptr frame;
  constexpr int kMoving = 5;  // after the standstill, without features
  for (int i = 1; i <= kFrames + kMoving; ++i) {
    frame = boost::make_shared<VoFrameMsg>(*last);
    frame->sequence += static_cast<std::uint32_t>(i);
    frame->header.stamp += ros::Duration(kPeriod * i);
    if (i > kFrames) {
      removeFeatures(*frame);
      frame->pose.position.z += kStep * (i - kFrames);
    }
    frames_.publish(frame);
  }
  ASSERT_TRUE(scales_.waitForStamp(frame->header.stamp));
  EXPECT_TRUE(waitForSummary(diagnostics, "scale_recovery", diagnostic_msgs::DiagnosticStatus::OK,
                             "scale held for 0.4 s: too_few_triangles"));
}

TEST_F(Scale, AClockThatJumpsBackStartsAnew) {
  publishMounting();
  FlatRoad road(4000);
  playUntilOdometry(road);
  play(road, kFrames);
  // The poses before and after the jump have the same stamps.
  ASSERT_TRUE(odometry_.waitForStamp(road.lastStamp()));
  odometry_.clear();
  FlatRoad again(4000);  // a looped bag
  play(again, 2);        // the second frame confirms the jump
  EXPECT_EQ(scales_.messages().end()[-2]->status, ScaleEstimateMsg::UNKNOWN);
  play(again, kFrames - 2);
  EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK);
  // The trajectory starts again at the origin.
  ASSERT_TRUE(odometry_.waitForStamp(scales_.messages().back()->header.stamp));
  const double metres = kCameraHeight * kStep * (kFrames - 1);
  EXPECT_NEAR(odometry_.messages().back()->pose.pose.position.x, metres, 0.02 * metres);
}

TEST_F(Scale, ARestartedOdometryIsANewMapAndTheMetricPoseContinues) {
  publishMounting();
  FlatRoad road(5000);
  playUntilOdometry(road);
  play(road, kFrames);
  ASSERT_TRUE(odometry_.waitForStamp(scales_.messages().back()->header.stamp));
  const double before = odometry_.messages().back()->pose.pose.position.x;
  const auto map_before = scales_.messages().back()->map_id;
  FlatRoad restarted(5100);  // its map_id and sequence are 0 again
  play(restarted, kFrames);
  EXPECT_GT(scales_.messages().back()->map_id, map_before);
  EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK);
  ASSERT_TRUE(odometry_.waitForStamp(scales_.messages().back()->header.stamp));
  EXPECT_GT(odometry_.messages().back()->pose.pose.position.x, before);
}

TEST_F(Scale, MalformedMessagesAreDropped) {
  publishMounting();
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  ASSERT_TRUE(diagnostics.waitForCount(1));  // connected: drops are in one message only
  FlatRoad road(6000);
  play(road, kFrames);
  VoFrameMsg::Ptr malformed = road.next();
  malformed->z.pop_back();
  frames_.publish(malformed);
  malformed = road.next();
  malformed->pose.position.x = std::numeric_limits<double>::quiet_NaN();
  frames_.publish(malformed);
  const VoFrameMsg::Ptr repeated = road.next();
  frames_.publish(repeated);
  frames_.publish(repeated);
  play(road, 1);
  EXPECT_EQ(scales_.messages().size(), static_cast<std::size_t>(kFrames) + 2);
  EXPECT_NE(scales_.messages().back()->status, ScaleEstimateMsg::UNKNOWN);
  const auto reportsDrops = [](const auto& status) {
    return status.message.find("frames dropped in the last second") != std::string::npos;
  };
  EXPECT_TRUE(waitForStatus(diagnostics, reportsDrops, false));
  EXPECT_TRUE(waitForStatus(diagnostics, [&](const auto& status) {
    return status.name.find("scale_recovery") == 0 &&
           status.level == diagnostic_msgs::DiagnosticStatus::OK;
  }));
}

// The field is left at its default by an odometry that does not count its images, or is constant.
TEST_F(Scale, ASequenceThatDoesNotIncreaseIsReported) {
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics(handle_, "/diagnostics");
  double start = 6100;
  for (const std::uint32_t sequence : {0u, std::numeric_limits<std::uint32_t>::max()}) {
    ASSERT_TRUE(reset());
    FlatRoad road(start += 100);
    for (int i = 0; i < kFrames; ++i) {
      const VoFrameMsg::Ptr msg = road.next();
      msg->sequence = sequence;
      frames_.publish(msg);
    }
    play(road, 0);
    EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK) << sequence;
    const std::string text =
        "sequence is " + std::to_string(sequence) + " in two vo/frame in a row";
    EXPECT_TRUE(waitForSummary(diagnostics, "scale_recovery",
                               diagnostic_msgs::DiagnosticStatus::WARN, text))
        << sequence;
    EXPECT_TRUE(waitForStatus(diagnostics, [](const auto& status) {
      return status.name.find("scale_recovery") == 0 &&
             std::any_of(status.values.begin(), status.values.end(),
                         [](const auto& entry) {
                           return entry.key == "frames dropped, queue full" && entry.value == "0";
                         }) &&
             std::none_of(status.values.begin(), status.values.end(),
                          [](const auto& entry) { return entry.key == "dropped: sequence"; });
    }));
  }
}

TEST_F(Scale, AFrameWithTooManyFeaturesIsRefused) {
  FlatRoad road(6400);
  play(road, kFrames);
  const VoFrameMsg::Ptr large = road.next();
  constexpr std::size_t kFeatures = 1000000;
  large->id.resize(kFeatures);
  std::iota(large->id.begin(), large->id.end(), std::uint64_t{0});
  large->age.resize(kFeatures);
  for (auto* array : {&large->u, &large->v, &large->x, &large->y, &large->z, &large->depth_sigma}) {
    array->resize(kFeatures, 1);
  }
  frames_.publish(large);
  play(road, 1);
  EXPECT_EQ(scales_.messages().size(), static_cast<std::size_t>(kFrames) + 1);
  EXPECT_NE(scales_.messages().back()->status, ScaleEstimateMsg::UNKNOWN);
}

/// Publishes images too. Both instances of ScaleRecovery get the same frames.
class WithImages : public Scale {
 protected:
  WithImages()
      : images_(handle_.advertise<sensor_msgs::Image>("image", 100)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 100)),
        alone_(handle_, "alone/scale"),
        diagnostics_(handle_, "/diagnostics") {}

  void SetUp() override {
    Scale::SetUp();
    ASSERT_TRUE(waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             alone_.connected() && diagnostics_.connected();
    }));
    ASSERT_TRUE(reset("alone/scale_recovery/reset"));
    scales_.clear();
    alone_.clear();
  }

  /// Plays kFrames frames, each after its image, which `spoil` may change.
  void play(FlatRoad& road, const std::function<void(sensor_msgs::Image&)>& spoil) {
    for (int i = 0; i < kFrames; ++i) {
      const sensor_msgs::Image::Ptr image = road.nextImage();
      spoil(*image);
      images_.publish(image);
      if (i == 0) {  // held until the next frame confirms the jump of the clock
        frames_.publish(road.next());
      } else {
        Scale::play(road, 1);
      }
    }
    const ros::Time last = scales_.messages().back()->header.stamp;
    ASSERT_TRUE(alone_.waitForStamp(last));
    ASSERT_EQ(scales_.messages().size(), static_cast<std::size_t>(kFrames));
    ASSERT_EQ(alone_.messages().size(), static_cast<std::size_t>(kFrames));
  }
  void publishCameraInfo(const PinholeCamera& camera) { infos_.publish(toCameraInfo(camera)); }
  void expectNoEffect() {
    for (std::size_t i = 0; i < kFrames; ++i) {
      EXPECT_EQ(scales_.messages()[i]->scale, alone_.messages()[i]->scale) << i;
    }
    EXPECT_EQ(scales_.messages().back()->status, ScaleEstimateMsg::OK);
  }

  ros::Publisher images_, infos_;
  TopicRecorder<ScaleEstimateMsg> alone_;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
};

// The first of these tests: no camera_info has been published yet.
TEST_F(WithImages, HasNoEffectWithoutACameraInfo) {
  FlatRoad road(7000);
  play(road, [](sensor_msgs::Image&) {});
  expectNoEffect();
  EXPECT_TRUE(
      waitForValue(diagnostics_, "images", "no valid camera_info received yet on /camera_info"));
}

TEST_F(WithImages, UsesTheImages) {
  FlatRoad road(8000);
  publishCameraInfo(road.camera());
  diagnostics_.clear();
  play(road, [](sensor_msgs::Image&) {});
  // `scale_recovery` uses them, `alone` does not, nor does it miss them.
  std::string of_alone;
  EXPECT_TRUE(waitForStatus(
      diagnostics_,
      [&](const auto& status) {
        of_alone = status.message;
        return status.name.find("alone/") == 0 && of_alone.find("scale measured") == 0;
      },
      false));
  EXPECT_EQ(of_alone, "scale measured");
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "used"));
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "not used"));
  EXPECT_NEAR(alone_.messages().back()->scale, kCameraHeight, 0.002 * kCameraHeight);
  EXPECT_LT(scales_.messages().back()->scale, 0.995 * alone_.messages().back()->scale);
  EXPECT_GT(scales_.messages().back()->scale, 0.995 * kCameraHeight / kImageHeight);
}

TEST_F(WithImages, TheirLossIsReported) {
  FlatRoad road(8500);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image&) {});
  ASSERT_TRUE(waitForValue(diagnostics_, "images", "used"));
  scales_.clear();
  alone_.clear();
  play(road, [](sensor_msgs::Image& image) { image.encoding = "nonsense"; });
  EXPECT_TRUE(
      waitForSummary(diagnostics_, "scale_recovery", diagnostic_msgs::DiagnosticStatus::WARN,
                     "scale measured from features only, no image of the last frame", false));
}

// The odometry may be late by the frames that its queue holds.
TEST_F(WithImages, AsManyOfThemAsFramesMayWait) {
  FlatRoad road(8700);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image&) {});
  ASSERT_TRUE(waitForValue(diagnostics_, "images", "used"));
  const auto framesWithoutImage = [&] {
    int count = -1;
    EXPECT_TRUE(waitForStatus(diagnostics_, [&](const auto& status) {
      if (status.name.find("scale_recovery") != 0) return false;
      count = countIn(status, "frames without an image");
      return true;
    }));
    return count;
  };
  const int before = framesWithoutImage();
  FlatRoad ahead = road;
  for (int i = 0; i < kFrames; ++i) {
    images_.publish(ahead.nextImage());
    ahead.next();
  }
  for (int i = 0; i < kFrames; ++i) Scale::play(road, 1);
  EXPECT_EQ(framesWithoutImage(), before);
}

TEST_F(WithImages, HasNoEffectWithInvalidImages) {
  FlatRoad road(9000);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image& image) { image.encoding = "nonsense"; });
  expectNoEffect();
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: image refused"));
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "no image of the last frame"));
}

TEST_F(WithImages, HasNoEffectWithImagesOfAnotherCamera) {
  FlatRoad road(10000);
  PinholeCamera other = road.camera();
  other.fx += 10;
  publishCameraInfo(other);
  publishCameraInfo(PinholeCamera());  // refused: the one before stays
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: camera_info refused", "1"));
  play(road, [](sensor_msgs::Image&) {});
  expectNoEffect();
  EXPECT_TRUE(waitForValue(diagnostics_, "dropped: other camera"));
}

// A frame still waiting for its image when the clock jumps back is processed with the state from
// before the jump.
TEST_F(WithImages, AWaitingFrameIsProcessedBeforeAClockJump) {
  FlatRoad road(10500);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image&) {});
  frames_.publish(road.next());
  FlatRoad again(10500);
  frames_.publish(again.next());
  const VoFrameMsg::Ptr second = again.next();  // confirms the jump
  frames_.publish(second);
  ASSERT_TRUE(scales_.waitForStamp(second->header.stamp));
  const auto scales = scales_.messages();
  ASSERT_EQ(scales.size(), static_cast<std::size_t>(kFrames) + 3);
  EXPECT_EQ(scales[kFrames + 1]->status, ScaleEstimateMsg::UNKNOWN);
  EXPECT_NE(scales[kFrames]->status, ScaleEstimateMsg::UNKNOWN);
}

TEST_F(WithImages, AWaitingFrameIsProcessedBeforeAReset) {
  FlatRoad road(10800);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image&) {});
  frames_.publish(road.next());
  // `alone` does not wait for images. Both nodelets have received the frame now.
  ASSERT_TRUE(alone_.waitForStamp(road.lastStamp()));
  ASSERT_TRUE(reset());
  ASSERT_TRUE(scales_.waitForStamp(road.lastStamp()));
  EXPECT_NE(scales_.messages().back()->status, ScaleEstimateMsg::UNKNOWN);
}

TEST_F(WithImages, HasNoEffectWithImagesOfOtherStamps) {
  FlatRoad road(11000);
  publishCameraInfo(road.camera());
  play(road, [](sensor_msgs::Image& image) { image.header.stamp += ros::Duration(0.01); });
  expectNoEffect();
}

}  // namespace
}  // namespace ground_scale_vo
