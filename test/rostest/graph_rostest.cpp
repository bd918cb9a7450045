// Late or missing messages, and the nodelets loaded in either order: both nodelets in a nodelet
// manager, on a rendered drive with ground truth.

#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <rosgraph_msgs/Log.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <opencv2/core.hpp>
#include <set>

#include "call_service.hpp"
#include "drive_test.hpp"
#include "ground_scale_vo/nodelets/dedicated_spinner.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "mounting.hpp"

namespace ground_scale_vo {
namespace {

class Graph : public DriveTest<50> {
 protected:
  bool waitForSummaryOf(const std::string& nodelet, std::int8_t level, const std::string& text) {
    return waitForSummary(diagnostics_, nodelet, level, text);
  }
};

TEST_F(Graph, AMissingCameraInfoIsAnErrorThatNamesItsTopic) {
  NodeletPair pair(manager_, *drive_, "/never");
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  ASSERT_TRUE(pair.load());
  const auto isLogged = [&](const std::string& sentence, double timeout = kTimeout) {
    return log.wait(
        [&](const auto& lines) {
          return std::any_of(lines.begin(), lines.end(), [&](const auto& line) {
            return line->level == rosgraph_msgs::Log::WARN && line->msg == sentence;
          });
        },
        timeout);
  };
  EXPECT_TRUE(waitForSummaryOf("never/mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "no image received yet on /never/image"));
  EXPECT_TRUE(waitForSummaryOf("never/scale_recovery", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "no vo/frame received yet on /never/vo/frame"));
  EXPECT_TRUE(isLogged("/never/mono_vo: no image received yet on /never/image"));
  EXPECT_TRUE(isLogged("/never/scale_recovery: no vo/frame received yet on /never/vo/frame"));
  for (std::size_t i = 0; i < drive_->size(); ++i) pair.publishImage(i);
  EXPECT_TRUE(waitForValue(diagnostics_, "images received", std::to_string(drive_->size())));
  EXPECT_TRUE(waitForSummaryOf("never/mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "no camera_info received yet on /never/camera_info"));
  // The queue holds the newest five (default of queue_size); the others have been dropped.
  EXPECT_TRUE(
      waitForValue(diagnostics_, "images dropped, queue full", std::to_string(drive_->size() - 5)));
  EXPECT_TRUE(waitUntil([&] {
    pair.publishImage(0);  // so that the images are not missing, too
    return isLogged("/never/mono_vo: no camera_info received yet on /never/camera_info", 0.5);
  }));
  EXPECT_TRUE(pair.frames.messages().empty());
  // A frame that is refused is received.
  const ros::Publisher invalid = handle_.advertise<VoFrameMsg>("/never/vo/frame", 1, true);
  invalid.publish(VoFrameMsg());
  EXPECT_TRUE(waitForSummaryOf("never/scale_recovery", diagnostic_msgs::DiagnosticStatus::WARN,
                               "scale not known yet"));
  EXPECT_TRUE(pair.unload());
}

// K and D describe the raw camera, P the rectified images.
TEST_F(Graph, OneCameraInfoOfRectifiedImagesIsEnough) {
  NodeletPair pair(manager_, *drive_, "/once");
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    pair.setParam(nodelet, "image_is_rectified", true);
  }
  ASSERT_TRUE(pair.load());
  sensor_msgs::CameraInfo info = toCameraInfo(drive_->drive().camera());
  info.K[0] = info.K[4] = 1.2 * info.P[0];
  info.D = {-0.3, 0.1, 0, 0, 0};
  pair.publishInfo(info);
  for (std::size_t i = 0; i < drive_->size(); ++i) {
    pair.publishImage(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
  }
  EXPECT_EQ(pair.frames.messages().back()->fx, info.P[0]);
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "used"));
  EXPECT_TRUE(
      waitForSummaryOf("once/scale_recovery", diagnostic_msgs::DiagnosticStatus::OK, "measured"));
  EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(pair.unload());
}

// A nodelet manager disables the callback queue of a nodelet while it is being loaded, so messages
// that arrive meanwhile are lost there.
TEST(DedicatedSpinner, KeepsMessagesFromBeforeItsStart) {
  ros::NodeHandle handle;
  ros::Publisher publisher = handle.advertise<std_msgs::Header>("latched", 1, true);
  publisher.publish(std_msgs::Header());
  ros::CallbackQueue of_manager;
  of_manager.disable();
  ros::NodeHandle of_nodelet;
  of_nodelet.setCallbackQueue(&of_manager);
  std::atomic<bool> received{false};
  DedicatedSpinner queue;
  const ros::Subscriber subscriber =
      queue.handle(of_nodelet)
          .subscribe<std_msgs::Header>("latched", 1,
                                       [&](const std_msgs::HeaderConstPtr&) { received = true; });
  ASSERT_TRUE(waitUntil([&] { return publisher.getNumSubscribers() == 1; }));
  queue.start();
  EXPECT_TRUE(waitUntil([&] { return received.load(); }));
  queue.stop();
}

TEST(DedicatedSpinner, RunsAPostedTaskAfterThoseAlreadyQueued) {
  DedicatedSpinner spinner;
  std::string order;
  std::atomic<bool> done{false};
  spinner.post([&] {
    order += 'a';
    spinner.post([&] {
      order += 'c';
      done = true;
    });
  });
  spinner.post([&] { order += 'b'; });
  spinner.start();
  EXPECT_TRUE(waitUntil([&] { return done.load(); }));
  spinner.stop();
  EXPECT_EQ(order, "abc");
}

// The latched message arrives while the nodelets are being loaded.
TEST_F(Graph, ALatchedCameraInfoIsEnough) {
  for (int round = 0; round < 5; ++round) {
    NodeletPair pair(manager_, *drive_, "/latched_" + std::to_string(round));
    pair.publishInfo(0);
    ASSERT_TRUE(pair.load());
    pair.publishImage(0);
    ASSERT_TRUE(pair.waitForResult(0)) << round;
    EXPECT_TRUE(pair.unload());
  }
}

/// Number of features in the first frame of the drive.
std::size_t featuresOfTheFirstImage(const SyntheticDrive& drive, double cell_size) {
  VisualOdometry::Options options;
  options.tracker.cell_size = cell_size;
  VisualOdometry odometry(drive.camera(), options);
  return odometry.process(drive.image(0), 0).frame.features.size();
}

TEST_F(Graph, ParametersAreUsed) {
  constexpr double kCellSize = 0.06;
  NodeletPair pair(manager_, *drive_, "/configured");
  pair.setParam("mono_vo", "tracker/cell_size", kCellSize);
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    pair.setParam(nodelet, "clock_jump_s", 10.0);
  }
  ASSERT_TRUE(pair.load());
  // A step of 4.9 s. With the default of clock_jump_s the second image would be held.
  for (const std::size_t i : {std::size_t{0}, drive_->size() - 1}) {
    pair.publish(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
  }
  const std::size_t features = featuresOfTheFirstImage(drive_->drive(), kCellSize);
  ASSERT_LT(features,
            featuresOfTheFirstImage(drive_->drive(), FeatureTracker::Options().cell_size));
  EXPECT_EQ(pair.frames.messages().front()->id.size(), features);
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, CameraInfoForMonoVoOnlyGivesAScaleFromFeatures) {
  NodeletPair pair(manager_, *drive_, "/points");
  ASSERT_TRUE(pair.loadMonoVo());
  ASSERT_TRUE(manager_.load("ScaleRecovery", "/points/scale_recovery",
                            {{"/points/camera_info", "/points/no_camera_info"}}));
  ASSERT_TRUE(pair.waitUntilConnected());
  ASSERT_TRUE(pair.playAll());
  EXPECT_TRUE(waitForSummary(diagnostics_, "points/scale_recovery",
                             diagnostic_msgs::DiagnosticStatus::WARN,
                             "scale measured from features only, no valid camera_info received yet "
                             "on /points/no_camera_info",
                             false));
  EXPECT_TRUE(waitForValue(diagnostics_, "images",
                           "no valid camera_info received yet on /points/no_camera_info"));
  EXPECT_NEAR(pair.displacementRatio(), 1, 2 * kTolerance);
  // No more images are published.
  EXPECT_TRUE(waitForSummaryOf("points/mono_vo", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "no image for "));
  EXPECT_TRUE(waitForSummaryOf("points/scale_recovery", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "no vo/frame for "));
  EXPECT_TRUE(pair.unload());
}

// As of a paused bag: the images have not come, but neither have the frames.
TEST_F(Graph, APauseIsNoLossOfTheImages) {
  NodeletPair pair(manager_, *drive_, "/paused");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playAll());
  for (int report = 0; report < 3; ++report) {
    std::string message;
    EXPECT_TRUE(waitForStatus(diagnostics_, [&](const auto& status) {
      message = status.message;
      return status.name.find("paused/scale_recovery") != std::string::npos;
    }));
    EXPECT_EQ(message.find("features only"), std::string::npos) << message;
  }
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, ATransportThatIsNotInstalledIsRefused) {
  NodeletPair pair(manager_, *drive_, "/transport");
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  ASSERT_TRUE(waitUntil([&] { return log.connected(); }));
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    pair.setParam(nodelet, "image_transport", std::string("pigeon"));
  }
  const auto logged = [&](const std::string& nodelet) {
    return log.wait(
        [&](const auto& lines) {
          return std::any_of(lines.begin(), lines.end(), [&](const auto& line) {
            return line->msg.find("/transport/" + nodelet +
                                  " does not start: parameter image_transport is \"pigeon\"") == 0;
          });
        },
        0.5);
  };
  // Repeat until this test is connected to the log of the manager.
  EXPECT_TRUE(waitUntil([&] { return pair.loadMonoVo() || logged("mono_vo"); }));
  EXPECT_TRUE(waitUntil([&] { return pair.loadScaleRecovery() || logged("scale_recovery"); }));
  ASSERT_EQ(manager_.loaded(), 0u) << "or the manager has ended";
}

TEST_F(Graph, EitherLoadingOrderGivesMetricOdometry) {
  for (const bool mono_vo_first : {true, false}) {
    NodeletPair pair(manager_, *drive_, mono_vo_first ? "/mono_first" : "/scale_first");
    // Images are published while the nodelets are being loaded.
    std::size_t next = 0;
    for (; next < 3; ++next) pair.publish(next);
    ASSERT_TRUE(mono_vo_first ? pair.loadMonoVo() : pair.loadScaleRecovery());
    ASSERT_TRUE(pair.waitForImageSubscribers());
    if (mono_vo_first) {
      ASSERT_TRUE(waitUntil([&] { return pair.frames.connected(); }));
    }
    for (; next < 6; ++next) pair.publish(next);
    if (mono_vo_first) {  // frames that the other nodelet does not receive
      ASSERT_TRUE(pair.frames.waitForStamp(pair.header(next - 1).stamp));
    }
    ASSERT_TRUE(mono_vo_first ? pair.loadScaleRecovery() : pair.loadMonoVo());
    ASSERT_TRUE(pair.waitUntilConnected());
    ASSERT_TRUE(pair.play(next, drive_->size() - 1));
    EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
    EXPECT_TRUE(pair.unload());
  }
}

TEST_F(Graph, ALateMountingTransformStartsTheMetricOdometry) {
  NodeletPair pair(manager_, *drive_, "/mounted");
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  pair.setParam("scale_recovery", "base_frame", std::string("mounted_base"));
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(waitUntil([&] { return log.connected(); }));
  const std::size_t half = drive_->size() / 2;
  for (std::size_t i = 0; i < half; ++i) {
    pair.publish(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
  }
  ASSERT_NE(pair.scales.messages().back()->status, ScaleEstimateMsg::UNKNOWN);
  EXPECT_TRUE(pair.odometry.messages().empty());
  EXPECT_TRUE(waitForSummaryOf("mounted/scale_recovery", diagnostic_msgs::DiagnosticStatus::ERROR,
                               "base_frame \"mounted_base\" to the camera frame \"camera\""));
  EXPECT_TRUE(log.wait([](const auto& lines) {
    return std::any_of(lines.begin(), lines.end(), [](const auto& line) {
      return line->level == rosgraph_msgs::Log::ERROR &&
             line->msg.find("base_frame \"mounted_base\" to the camera frame \"camera\"") !=
                 std::string::npos;
    });
  }));

  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting("mounted_base", {0, 0, 1.65}));
  std::size_t next = half;
  while (next < drive_->size() && pair.odometry.messages().empty()) {
    pair.publish(next);
    ASSERT_TRUE(pair.waitForResult(next));
    // The nodelet repeats the lookup at every image.
    pair.odometry.waitForCount(1, 0.3);
    ++next;
  }
  ASSERT_LT(next, drive_->size() - 10);
  ASSERT_TRUE(pair.play(next, drive_->size() - 1));
  EXPECT_EQ(pair.odometry.messages().back()->child_frame_id, "mounted_base");
  EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
  // The twist is in the axes of the base: x is forward.
  EXPECT_GT(pair.odometry.messages().back()->twist.twist.linear.x, 5);
  EXPECT_TRUE(
      waitForSummaryOf("mounted/scale_recovery", diagnostic_msgs::DiagnosticStatus::OK, ""));
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, AfterAResetOfBothNodeletsThePoseIsZero) {
  NodeletPair pair(manager_, *drive_, "/reset");
  pair.setParam("scale_recovery", "base_frame", std::string("camera"));  // needs no tf
  ASSERT_TRUE(pair.load());
  const std::size_t half = drive_->size() / 2;
  ASSERT_TRUE(pair.play(0, half - 1));
  EXPECT_FALSE(ros::service::exists("/reset/reset", false));  // two pairs may share a namespace
  ASSERT_TRUE(callTrigger("/reset/mono_vo/reset"));
  EXPECT_TRUE(
      waitForSummaryOf("reset/mono_vo", diagnostic_msgs::DiagnosticStatus::WARN, "initialising"));
  EXPECT_TRUE(waitForValue(diagnostics_, "features", "0", "reset/mono_vo"));
  EXPECT_TRUE(waitForValue(diagnostics_, "map points", "0", "reset/mono_vo"));
  ASSERT_TRUE(callTrigger("/reset/scale_recovery/reset"));
  pair.frames.clear();
  pair.scales.clear();
  pair.odometry.clear();
  ASSERT_TRUE(pair.play(half, drive_->size() - 1));
  EXPECT_EQ(pair.frames.messages().front()->sequence, 0u);
  EXPECT_EQ(pair.scales.messages().front()->status, ScaleEstimateMsg::UNKNOWN);
  const geometry_msgs::Point& origin = pair.odometry.messages().front()->pose.pose.position;
  EXPECT_EQ(origin.x, 0);
  EXPECT_EQ(origin.y, 0);
  EXPECT_EQ(origin.z, 0);
  const Eigen::Isometry3d T_odom_c = fromMsg(pair.odometry.messages().front()->pose.pose);
  EXPECT_TRUE(T_odom_c.linear().isApprox(bodyFromOptical(), 1e-12));
  EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(pair.unload());
}

// A reset of MonoVo alone is a new map, from which the metric pose continues. The heading may have
// changed while no image was processed.
TEST_F(Graph, AResetOfMonoVoKeepsTheMetricPose) {
  NodeletPair pair(manager_, *drive_, "/vo_reset");
  ASSERT_TRUE(pair.load());
  const std::size_t half = drive_->size() / 2;
  ASSERT_TRUE(pair.play(0, half - 1));
  const std::uint32_t map_id = pair.scales.messages().back()->map_id;
  const geometry_msgs::PoseWithCovariance before = pair.odometry.messages().back()->pose;
  ASSERT_TRUE(callTrigger("/vo_reset/mono_vo/reset"));
  constexpr std::size_t kMissing = 9;  // a gap of 1 s
  ASSERT_TRUE(pair.play(half + kMissing, drive_->size() - 1));
  EXPECT_GT(pair.scales.messages().back()->map_id, map_id);
  const geometry_msgs::PoseWithCovariance after = pair.odometry.messages().back()->pose;
  EXPECT_GT(after.pose.position.x, before.pose.position.x);
  constexpr std::size_t kYaw = 35;  // new_map_rotation_sigma_per_s: 0.1 rad
  EXPECT_NEAR(after.covariance[kYaw] - before.covariance[kYaw], 0.01, 0.001);
  EXPECT_TRUE(pair.unload());
}

// Upside down, the images show no place of the first map.
TEST_F(Graph, ANewMapIsReported) {
  constexpr std::size_t kUpright = 10;
  std::size_t images = 0;
  const RenderedDrive turned(smallDrive(25), "camera", [&](const cv::Mat& image) {
    cv::Mat result = image.clone();
    if (images++ >= kUpright) cv::rotate(image, result, cv::ROTATE_180);
    return result;
  });
  NodeletPair pair(manager_, turned, "/new_map");
  ASSERT_TRUE(pair.load());
  for (std::size_t i = 0; i < turned.size(); ++i) {
    pair.publish(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
  }
  const std::uint32_t map_id = pair.frames.messages().back()->map_id;
  ASSERT_GT(map_id, 0u);
  EXPECT_TRUE(waitForValue(diagnostics_, "map_id", std::to_string(map_id), "new_map/mono_vo"));
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, ThePathHasItsSpacingAndItsLength) {
  NodeletPair pair(manager_, *drive_, "/path");
  pair.setParam("scale_recovery", "path_max_poses", 6);
  pair.setParam("scale_recovery", "path_spacing_m", 3.0);
  TopicRecorder<nav_msgs::Path> path(handle_, "/path/path");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(waitUntil([&] { return path.connected(); }));
  ASSERT_TRUE(pair.play(0, drive_->size() - 1));
  ASSERT_TRUE(path.waitForCount(10));
  std::size_t longest = 0;
  for (const auto& message : path.messages()) {
    longest = std::max(longest, message->poses.size());
    for (std::size_t i = 1; i < message->poses.size(); ++i) {
      const auto &a = message->poses[i - 1].pose.position, &b = message->poses[i].pose.position;
      const double spacing = std::hypot(b.x - a.x, b.y - a.y, b.z - a.z);
      EXPECT_GE(spacing, 3);
      if (message->poses.size() == 2) {
        EXPECT_LT(spacing, 4.5);
      }
    }
  }
  EXPECT_EQ(longest, 6u);
  EXPECT_TRUE(pair.unload());
}

/// The camera on "turning_base" or "moving_base", yawed to the left.
geometry_msgs::TransformStamped yawedMounting(const std::string& base_frame, double yaw) {
  nav_msgs::Odometry yawed;
  yawed.header.frame_id = base_frame;
  yawed.child_frame_id = "camera";
  yawed.pose.pose = toMsg(Eigen::Isometry3d(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                            Eigen::Isometry3d(bodyFromOptical())));
  return toTransformMsg(yawed);
}

TEST_F(Graph, AResetLooksTheMountingUpAgain) {
  NodeletPair pair(manager_, *drive_, "/remounted");
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(yawedMounting("turning_base", 0));
  pair.setParam("scale_recovery", "base_frame", std::string("turning_base"));
  ASSERT_TRUE(pair.load());
  const std::size_t half = drive_->size() / 2;
  ASSERT_TRUE(pair.play(0, half - 1));
  EXPECT_GT(pair.odometry.messages().back()->twist.twist.linear.x, 5);
  EXPECT_TRUE(waitForSummaryOf("remounted/scale_recovery", diagnostic_msgs::DiagnosticStatus::OK,
                               "scale measured"));
  tf2_ros::Buffer buffer;
  const tf2_ros::TransformListener listener(buffer, handle_);
  broadcaster.sendTransform(yawedMounting("turning_base", M_PI_2));
  ASSERT_TRUE(waitUntil([&] {
    return buffer.canTransform("turning_base", "camera", ros::Time(0)) &&
           buffer.lookupTransform("turning_base", "camera", ros::Time(0)).transform ==
               yawedMounting("turning_base", M_PI_2).transform;
  }));
  ASSERT_TRUE(callTrigger("/remounted/scale_recovery/reset"));
  ASSERT_TRUE(pair.play(half, drive_->size() - 1));
  EXPECT_GT(pair.odometry.messages().back()->twist.twist.linear.y, 5);
  EXPECT_NEAR(pair.odometry.messages().back()->twist.twist.linear.x, 0, 0.5);
  EXPECT_TRUE(pair.unload());
}

/// How many lines of the log are warnings of scale_recovery in this namespace with this text.
std::size_t warnings(const std::vector<rosgraph_msgs::Log::ConstPtr>& lines, const std::string& ns,
                     const std::string& text) {
  return static_cast<std::size_t>(std::count_if(lines.begin(), lines.end(), [&](const auto& line) {
    return line->level == rosgraph_msgs::Log::WARN &&
           line->msg.find(ns + "/scale_recovery: ") == 0 &&
           line->msg.find(text) != std::string::npos;
  }));
}

// The rendered camera is pitched down by 1.1 degrees, that of tf by 8.
TEST_F(Graph, AMountingThatTheRoadContradictsIsReportedOnce) {
  NodeletPair pair(manager_, *drive_, "/tilted");
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting("tilted_base", {0, 0, 1.65}, 8 * M_PI / 180));
  pair.setParam("scale_recovery", "base_frame", std::string("tilted_base"));
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(waitUntil([&] { return log.connected(); }));
  const std::size_t half = drive_->size() / 2;
  for (const std::size_t mountings : {1u, 2u}) {
    ASSERT_TRUE(pair.play(half * (mountings - 1), half * mountings - 1));
    EXPECT_TRUE(waitForSummaryOf("tilted/scale_recovery", diagnostic_msgs::DiagnosticStatus::WARN,
                                 "with pitch 8.0 deg and roll 0.0 deg"));
    EXPECT_TRUE(log.wait([&](const auto& lines) {
      return warnings(lines, "/tilted", "with pitch 8.0 deg") == mountings;
    }));
    ASSERT_TRUE(callTrigger("/tilted/scale_recovery/reset"));  // looks the mounting up again
    EXPECT_TRUE(waitForStatus(diagnostics_, [](const auto& status) {
      return status.name.find("tilted/scale_recovery") == 0 &&
             status.message == "scale not known yet";
    }));
  }
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, AMovingMountIsNotComparedWithTheRoad) {
  NodeletPair pair(manager_, *drive_, "/tilting");
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting("tilting_base", {0, 0, 1.65}, 8 * M_PI / 180));
  pair.setParam("scale_recovery", "base_frame", std::string("tilting_base"));
  pair.setParam("scale_recovery", "moving_mount", true);
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playAll());
  EXPECT_TRUE(waitForSummaryOf("tilting/scale_recovery", diagnostic_msgs::DiagnosticStatus::OK,
                               "scale measured"));
  EXPECT_TRUE(pair.unload());
}

// tf does not have the transform of a joint at the stamp of an image yet.
TEST_F(Graph, AFixedMountingMayBeOlderThanTheImages) {
  NodeletPair pair(manager_, *drive_, "/joint");
  pair.setParam("scale_recovery", "base_frame", std::string("joint_base"));
  ASSERT_TRUE(pair.load());
  const ros::Publisher tf = handle_.advertise<tf2_msgs::TFMessage>("/tf", 100);
  ASSERT_TRUE(waitUntil([&] { return tf.getNumSubscribers() > 0; }));
  tf2_msgs::TFMessage message;
  message.transforms.push_back(mounting("joint_base", {0, 0, 1.65}));
  message.transforms[0].header.stamp = pair.header(0).stamp;
  tf.publish(message);
  ASSERT_TRUE(pair.playAll());
  EXPECT_EQ(pair.odometry.messages().back()->child_frame_id, "joint_base");
  EXPECT_TRUE(pair.unload());
}

// The camera slides forward on its base by 0.1 m per image. The transforms of the last images but
// one are published after the scale, i.e. while the nodelet waits for them; at least one of them
// comes in time. That of one image before is missing: it gets no pose.
TEST_F(Graph, AMovingMountIsLookedUpAtTheStampOfEachImage) {
  NodeletPair pair(manager_, *drive_, "/moving");
  pair.setParam("scale_recovery", "base_frame", std::string("moving_base"));
  pair.setParam("scale_recovery", "moving_mount", true);
  ASSERT_TRUE(pair.load());
  const ros::Publisher tf = handle_.advertise<tf2_msgs::TFMessage>("/tf", 100);
  ASSERT_TRUE(waitUntil([&] { return tf.getNumSubscribers() > 0; }));
  const std::size_t first_late = drive_->size() - 11, end_late = drive_->size() - 1;
  const std::size_t missing = first_late - 3;
  for (std::size_t i = 0; i < drive_->size(); ++i) {
    geometry_msgs::TransformStamped mount =
        mounting("moving_base", {0.1 * static_cast<double>(i), 0, 1.65});
    mount.header.stamp = pair.header(i).stamp;
    tf2_msgs::TFMessage message;
    message.transforms.push_back(mount);
    const bool is_late = i >= first_late && i < end_late;
    if (!is_late && i != missing) tf.publish(message);
    pair.publish(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
    if (i == missing) {  // the next transform would allow to interpolate
      EXPECT_TRUE(waitForSummaryOf("moving/scale_recovery",
                                   diagnostic_msgs::DiagnosticStatus::ERROR,
                                   "no tf transform from base_frame \"moving_base\""));
    }
    if (is_late) tf.publish(message);
  }
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.header(drive_->size() - 1).stamp));
  const auto messages = pair.odometry.messages();
  const auto &first = *messages.front(), &last = *messages.back();
  EXPECT_TRUE(std::any_of(messages.begin(), messages.end(), [&](const auto& odometry) {
    const std::size_t i = pair.frameAt(odometry->header.stamp);
    return i >= first_late && i < end_late;
  }));
  EXPECT_TRUE(std::none_of(messages.begin(), messages.end(), [&](const auto& odometry) {
    return pair.frameAt(odometry->header.stamp) == missing;
  }));
  // odom is the base at the first image, also for the first pose, which comes later.
  for (const nav_msgs::Odometry* odometry : {&first, &last}) {
    const std::size_t images = pair.frameAt(odometry->header.stamp);
    ASSERT_GT(images, 0u);
    const double camera = drive_->drive().frame(images).T_c0_c.translation().norm();
    EXPECT_NEAR(odometry->pose.pose.position.x, camera - 0.1 * static_cast<double>(images),
                kTolerance * camera);
  }
  EXPECT_NEAR(last.twist.twist.linear.x, 9 - 1, 0.5);
  EXPECT_TRUE(pair.unload());
}

// tf2 rejects it.
TEST_F(Graph, ALeadingSlashOfAFrameNameIsRemoved) {
  const RenderedDrive slashed(smallDrive(30), "/slashed_camera");
  NodeletPair pair(manager_, slashed, "/slashes");
  TopicRecorder<rosgraph_msgs::Log> log(handle_, "/rosout");
  ASSERT_TRUE(waitUntil([&] { return log.connected(); }));
  pair.setParam("mono_vo", "world_frame", std::string("/slashed_world"));
  pair.setParam("scale_recovery", "odom_frame", std::string("/slashed_odom"));
  pair.setParam("scale_recovery", "base_frame", std::string("/slashed_base"));
  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped mount = mounting("slashed_base", {0, 0, 1.65});
  mount.child_frame_id = "slashed_camera";
  broadcaster.sendTransform(mount);
  TopicRecorder<tf2_msgs::TFMessage> tf(handle_, "/tf");
  TopicRecorder<nav_msgs::Odometry> vo_odometry(handle_, "/slashes/vo/odometry");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(waitUntil([&] { return vo_odometry.connected() && tf.connected(); }));
  ASSERT_TRUE(pair.playAll());
  ASSERT_TRUE(tf.waitForCount(1));
  ASSERT_TRUE(vo_odometry.waitForCount(1));
  const auto& odometry = *pair.odometry.messages().back();
  EXPECT_EQ(odometry.header.frame_id, "slashed_odom");
  EXPECT_EQ(odometry.child_frame_id, "slashed_base");
  EXPECT_EQ(tf.messages().back()->transforms.at(0).header.frame_id, "slashed_odom");
  EXPECT_EQ(tf.messages().back()->transforms.at(0).child_frame_id, "slashed_base");
  EXPECT_EQ(pair.frames.messages().back()->header.frame_id, "slashed_camera");
  EXPECT_EQ(pair.scales.messages().back()->header.frame_id, "slashed_camera");
  EXPECT_EQ(vo_odometry.messages().back()->header.frame_id, "slashed_world");
  EXPECT_EQ(vo_odometry.messages().back()->child_frame_id, "slashed_camera");
  EXPECT_TRUE(log.wait([](const auto& lines) {
    return std::count_if(lines.begin(), lines.end(), [](const auto& line) {
             return line->msg.find(
                        "frame_id of the images is \"/slashed_camera\"; tf2 has no leading "
                        "slash, \"slashed_camera\" is used") != std::string::npos;
           }) == 1;  // not with every image
  }));
  EXPECT_TRUE(pair.unload());
}

// An empty base_frame although wheel odometry broadcasts the pose of the camera or the camera is
// mounted on a vehicle, on tf: odom must not become a second parent of the camera.
TEST_F(Graph, ASecondParentOfTheCameraIsDetected) {
  NodeletPair pair(manager_, *drive_, "/parents");
  TopicRecorder<tf2_msgs::TFMessage> tf(handle_, "/tf");
  const ros::Publisher wheels = handle_.advertise<tf2_msgs::TFMessage>("/tf", 100);
  ASSERT_TRUE(pair.load());
  // Of this test and of the manager.
  ASSERT_TRUE(waitUntil([&] { return wheels.getNumSubscribers() == 2; }));
  const auto play = [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i <= last; ++i) {
      tf2_msgs::TFMessage message;
      message.transforms.push_back(mounting("wheels", {0, 0, 1.65}));
      message.transforms[0].header.stamp = pair.header(i).stamp;
      wheels.publish(message);
      pair.publish(i);
      if (!pair.waitForResult(i)) return false;
    }
    return true;
  };
  const std::size_t half = drive_->size() / 2;
  ASSERT_TRUE(play(0, half - 1));
  EXPECT_TRUE(waitForSummary(
      diagnostics_, "parents/scale_recovery", diagnostic_msgs::DiagnosticStatus::ERROR,
      "frame \"camera\" has the parent \"wheels\" on tf, so odom -> camera is not broadcast; "
      "set publish_tf to false, or stop the other publisher",
      false));

  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped to_mast = mounting("vehicle", {1, 0, 1});
  to_mast.child_frame_id = "mast";
  broadcaster.sendTransform({to_mast, mounting("mast", {0, 0, 0.65})});
  ASSERT_TRUE(play(half, drive_->size() - 1));
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.header(drive_->size() - 1).stamp));
  EXPECT_TRUE(
      waitForSummaryOf("parents/scale_recovery", diagnostic_msgs::DiagnosticStatus::ERROR,
                       "frame \"camera\" has the parent \"mast\" on tf, so odom -> camera is "
                       "not broadcast; set base_frame to \"vehicle\""));
  for (const auto& message : tf.messages()) {
    for (const auto& transform : message->transforms) {
      EXPECT_NE(transform.header.frame_id, "odom") << transform.child_frame_id;
    }
  }
  EXPECT_FALSE(pair.odometry.messages().empty());
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, ALateSubscriberGetsTheWholePath) {
  NodeletPair pair(manager_, *drive_, "/late");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playAll());
  for (int subscriber = 0; subscriber < 2; ++subscriber) {
    TopicRecorder<nav_msgs::Path> path(handle_, "/late/path");
    ASSERT_TRUE(path.wait([&](const auto& paths) {
      return !paths.empty() && paths.back()->poses.size() > 10;
    })) << subscriber;
    EXPECT_EQ(path.messages().back()->header.frame_id, "odom");
  }
  TopicRecorder<nav_msgs::Path> path(handle_, "/late/path");
  ASSERT_TRUE(path.wait([](const auto& paths) { return !paths.empty(); }));
  ASSERT_TRUE(callTrigger("/late/scale_recovery/reset"));
  EXPECT_TRUE(
      path.wait([](const auto& paths) { return !paths.empty() && paths.back()->poses.empty(); }));
  EXPECT_TRUE(pair.unload());
}

TEST_F(Graph, TwoPairsInOneManagerAreIndependent) {
  SyntheticDrive::Options options = smallDrive(50, 2.4);
  options.random_seed = 7;
  options.speed = 12;
  options.camera.fx = options.camera.fy = 200;
  const RenderedDrive high(options, "rear_camera");
  NodeletPair front(manager_, *drive_, "/front"), rear(manager_, high, "/rear");
  front.setParam("scale_recovery", "odom_frame", std::string("front_odom"));
  rear.setParam("scale_recovery", "odom_frame", std::string("rear_odom"));
  TopicRecorder<tf2_msgs::TFMessage> tf(handle_, "/tf");
  ASSERT_TRUE(front.load());
  ASSERT_TRUE(rear.load());
  ASSERT_TRUE(waitUntil([&] { return tf.connected(); }));
  // Concurrently: both images are published before waiting for the results.
  const std::size_t half = drive_->size() - 10;
  for (std::size_t i = 0; i < half; ++i) {
    front.publish(i);
    rear.publish(i);
    ASSERT_TRUE(front.waitForResult(i)) << i;
    ASSERT_TRUE(rear.waitForResult(i)) << i;
  }
  ASSERT_TRUE(front.odometry.waitForStamp(front.header(half - 1).stamp));
  ASSERT_TRUE(rear.odometry.waitForStamp(rear.header(half - 1).stamp));
  EXPECT_NEAR(front.displacementRatio(), 1, kTolerance);
  EXPECT_NEAR(rear.displacementRatio(), 1, kTolerance);
  EXPECT_EQ(front.odometry.messages().back()->header.frame_id, "front_odom");
  EXPECT_EQ(rear.odometry.messages().back()->header.frame_id, "rear_odom");
  std::map<std::string, std::set<std::string>> parents;
  for (const auto& message : tf.messages()) {
    for (const auto& transform : message->transforms) {
      parents[transform.child_frame_id].insert(transform.header.frame_id);
    }
  }
  EXPECT_EQ(parents["camera"], std::set<std::string>{"front_odom"});
  EXPECT_EQ(parents["rear_camera"], std::set<std::string>{"rear_odom"});

  EXPECT_TRUE(front.unload());
  ASSERT_TRUE(rear.play(half, high.size() - 1));
  EXPECT_NEAR(rear.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(rear.unload());
}

}  // namespace
}  // namespace ground_scale_vo
