// Both nodelets in a nodelet manager, on a rendered drive with ground truth: late or missing
// messages, parameters, mountings on tf, resets, two pairs, masks.

#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "manager_test.hpp"
#include "simulation/tools/distortion.hpp"

namespace gsv {
namespace {

class Graph : public DriveTest<50> {
 protected:
  static constexpr std::size_t kHalf = kFrames / 2;

  static std::string temporaryFile(const std::string& extension) {
    return std::filesystem::temp_directory_path() /
           ("graph_rostest_" + std::to_string(getpid()) + extension);
  }
};

TEST_F(Graph, AMissingInputIsAnErrorThatNamesItsTopic) {
  NodeletPair pair(manager_, *drive_, "/never");
  ASSERT_TRUE(pair.load());
  EXPECT_TRUE(diagnostics_.waitForSummary("never/mono_vo", Status::ERROR,
                                          "no image received yet on /never/image"));
  EXPECT_TRUE(diagnostics_.waitForSummary("never/scale_recovery", Status::ERROR,
                                          "no vo/frame received yet on /never/vo/frame"));
  EXPECT_TRUE(waitForLine("/never/mono_vo: no image received yet on /never/image"));
  EXPECT_TRUE(waitForLine("/never/scale_recovery: no vo/frame received yet on /never/vo/frame"));
  for (std::size_t i = 0; i < kFrames; ++i) pair.publishImage(i);
  // The queue holds the newest five (default of queue_size); the others have been dropped.
  EXPECT_TRUE(diagnostics_.waitForValues(
      "never/mono_vo", {{"images received", std::to_string(kFrames)},
                        {"images dropped, queue full", std::to_string(kFrames - 5)}}));
  EXPECT_TRUE(diagnostics_.waitForSummary("never/mono_vo", Status::ERROR,
                                          "no camera_info received yet on /never/camera_info"));
  EXPECT_EQ(pair.frames.count(), 0u);
  // A frame that is refused is received.
  const ros::Publisher invalid = handle_.advertise<VoFrameMsg>("/never/vo/frame", 1, true);
  invalid.publish(VoFrameMsg());
  EXPECT_TRUE(
      diagnostics_.waitForSummary("never/scale_recovery", Status::WARN, "scale not known yet"));
}

// The camera_info is latched and arrives while the nodelets are being loaded, ScaleRecovery first.
// K and D describe the raw camera, P the rectified images.
TEST_F(Graph, OneLatchedCameraInfoOfRectifiedImagesIsEnough) {
  NodeletPair pair(manager_, *drive_, "/once");
  pair.setParam("mono_vo", "image_is_rectified", true);
  sensor_msgs::CameraInfo info = toCameraInfo(drive_->drive().camera());
  info.K[0] = info.K[4] = 1.2 * info.P[0];
  info.D = {-0.3, 0.1, 0, 0, 0};
  pair.publishInfo(info);
  ASSERT_TRUE(pair.loadScaleRecovery() && pair.loadMonoVo() && pair.waitUntilConnected());
  for (std::size_t i = 0; i < kFrames; ++i) {
    pair.publishImage(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
  }
  EXPECT_EQ(pair.frames.last()->fx, info.P[0]);
  EXPECT_TRUE(diagnostics_.waitForStatus("once/scale_recovery", [](const Status& status) {
    return status.level == Status::OK && valueIn(status, "images") == "used";
  }));
  pair.expectTrueLength();
}

TEST_F(Graph, WrongParametersAreRefusedWithTheReason) {
  const struct {
    std::string type, parameter;
    XmlRpc::XmlRpcValue value;
  } kCases[] = {
      {"ScaleRecovery", "camera_height", {}},  // missing
      {"ScaleRecovery", "camera_height", -1.65}, {"MonoVo", "queue_size", 0},
      {"MonoVo", "image_transport", "pigeon"},   {"MonoVo", "image_transport", 3},
      {"MonoVo", "mask", "/missing/mask.png"},   {"MonoVo", "camera_file", "/missing.yaml"},
  };
  int i = 0;
  for (const auto& test_case : kCases) {
    const std::string name = "/refused_" + std::to_string(i++);
    SCOPED_TRACE(name + ": " + test_case.parameter);
    if (test_case.parameter != "camera_height") ros::param::set(name + "/camera_height", 1.65);
    if (test_case.value.valid()) ros::param::set(name + "/" + test_case.parameter, test_case.value);
    EXPECT_FALSE(manager_.load(test_case.type, name));
    EXPECT_TRUE(waitForLine(name + " does not start: ", test_case.parameter));
  }
  ASSERT_EQ(manager_.loaded(), 0u) << "or the manager has ended";
}

// On /tf, with a stamp before the images.
TEST_F(Graph, ALateMountingTransformStartsTheMetricOdometry) {
  NodeletPair pair(manager_, *drive_, "/mounted");
  pair.setParam("scale_recovery", "base_frame", "mounted_base");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.play(0, kHalf - 1));
  ASSERT_NE(pair.scales.last()->status, ScaleEstimateMsg::UNKNOWN);
  EXPECT_EQ(pair.odometry.count(), 0u);
  const std::string error = "base_frame \"mounted_base\" to the camera frame \"camera\"";
  EXPECT_TRUE(diagnostics_.waitForSummary("mounted/scale_recovery", Status::ERROR, error));
  EXPECT_TRUE(waitForLine(error));

  const ros::Publisher tf = handle_.advertise<tf2_msgs::TFMessage>("/tf", 100);
  ASSERT_TRUE(waitUntil([&] { return tf.getNumSubscribers() > 0; }));
  tf.publish(tfMessage(mounting("mounted_base", {0, 0, 1.65}), pair.stamp(0)));
  std::size_t next = kHalf;
  while (next < kFrames && pair.odometry.count() == 0) {
    ASSERT_TRUE(pair.publishAndWait(next));
    // The nodelet repeats the lookup at every image.
    pair.odometry.waitForCount(1, 0.3);
    ++next;
  }
  ASSERT_LT(next, kFrames - 10);
  ASSERT_TRUE(pair.playUntilPose(next, kFrames - 1));
  EXPECT_EQ(pair.odometry.last()->child_frame_id, "mounted_base");
  pair.expectTrueLength();
  // The twist is in the axes of the base: x is forward.
  EXPECT_GT(pair.odometry.last()->twist.twist.linear.x, 5);
  EXPECT_TRUE(diagnostics_.waitForSummary("mounted/scale_recovery", Status::OK, "scale measured"));
}

TEST_F(Graph, AfterAResetOfBothNodeletsThePoseIsZero) {
  NodeletPair pair(manager_, *drive_, "/reset");
  pair.setParam("scale_recovery", "base_frame", "camera");  // needs no tf
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playUntilPose(0, kHalf - 1));
  ASSERT_TRUE(callTrigger("/reset/mono_vo/reset"));
  EXPECT_TRUE(diagnostics_.waitForStatus("reset/mono_vo", [](const Status& status) {
    return status.message == "initialising" && valueIn(status, "features") == "0" &&
           valueIn(status, "map points") == "0";
  }));
  ASSERT_TRUE(callTrigger("/reset/scale_recovery/reset"));
  pair.clear();
  ASSERT_TRUE(pair.playUntilPose(kHalf, kFrames - 1));
  EXPECT_EQ(pair.frames.first()->sequence, 0u);
  EXPECT_EQ(pair.scales.first()->status, ScaleEstimateMsg::UNKNOWN);
  const Eigen::Isometry3d T_odom_c = fromMsg(pair.odometry.first()->pose.pose);
  EXPECT_EQ(T_odom_c.translation().norm(), 0);
  EXPECT_TRUE(T_odom_c.linear().isApprox(bodyFromOptical(), 1e-12));
  pair.expectTrueLength();
}

// A reset of MonoVo alone is a new map, from which the metric pose continues. The heading may have
// changed while no image was processed.
TEST_F(Graph, AResetOfMonoVoKeepsTheMetricPose) {
  NodeletPair pair(manager_, *drive_, "/vo_reset");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playUntilPose(0, kHalf - 1));
  const std::uint32_t map_id = pair.scales.last()->map_id;
  const geometry_msgs::PoseWithCovariance before = pair.odometry.last()->pose;
  ASSERT_TRUE(callTrigger("/vo_reset/mono_vo/reset"));
  constexpr std::size_t kMissing = 9;  // a gap of 1 s
  ASSERT_TRUE(pair.playUntilPose(kHalf + kMissing, kFrames - 1));
  EXPECT_GT(pair.scales.last()->map_id, map_id);
  const geometry_msgs::PoseWithCovariance after = pair.odometry.last()->pose;
  EXPECT_GT(after.pose.position.x, before.pose.position.x);
  constexpr std::size_t kYaw = 35;  // 0.1 rad per second
  EXPECT_NEAR(after.covariance[kYaw] - before.covariance[kYaw], 0.01, 0.001);
}

// The rendered camera is pitched down by 1.1 degrees, the first mounting by 8. The second one looks
// to the left of the base.
TEST_F(Graph, AMountingThatTheRoadContradictsIsReportedUntilAResetFindsAnother) {
  const std::string text = "with pitch 8.0 deg and roll 0.0 deg";
  NodeletPair pair(manager_, *drive_, "/tilted");
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting("tilted_base", {0, 0, 1.65}, 8 * kRadiansPerDegree));
  pair.setParam("scale_recovery", "base_frame", "tilted_base");
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playUntilPose(0, kHalf - 1));
  EXPECT_GT(pair.odometry.last()->twist.twist.linear.x, 5);
  EXPECT_TRUE(diagnostics_.waitForSummary("tilted/scale_recovery", Status::WARN, text));
  EXPECT_TRUE(waitForLine(text));

  tf2_ros::Buffer buffer;
  const tf2_ros::TransformListener listener(buffer, handle_);
  const auto left = mounting("tilted_base", {0, 0, 1.65}, 0, M_PI_2);
  broadcaster.sendTransform(left);
  ASSERT_TRUE(waitUntil([&] {
    return buffer.canTransform("tilted_base", "camera", ros::Time(0)) &&
           buffer.lookupTransform("tilted_base", "camera", ros::Time(0)).transform ==
               left.transform;
  }));
  ASSERT_TRUE(callTrigger("/tilted/scale_recovery/reset"));
  ASSERT_TRUE(pair.playUntilPose(kHalf, kFrames - 1));
  EXPECT_GT(pair.odometry.last()->twist.twist.linear.y, 5);
  EXPECT_NEAR(pair.odometry.last()->twist.twist.linear.x, 0, 0.5);
  EXPECT_TRUE(diagnostics_.waitForSummary("tilted/scale_recovery", Status::OK, "scale measured"));
  EXPECT_EQ(lines(text), 1);  // not with every image
}

// The camera slides forward on its base by 0.1 m per image. The transforms of the last images but
// one are published after the scale, i.e. while the nodelet waits for them; at least one of them
// comes in time. The transform of one image before is missing: it gets no pose. The pitch of 8
// degrees is not compared with the road.
TEST_F(Graph, AMovingMountIsLookedUpAtTheStampOfEachImage) {
  NodeletPair pair(manager_, *drive_, "/moving");
  pair.setParam("scale_recovery", "base_frame", "moving_base");
  pair.setParam("scale_recovery", "moving_mount", true);
  ASSERT_TRUE(pair.load());
  const ros::Publisher tf = handle_.advertise<tf2_msgs::TFMessage>("/tf", 100);
  ASSERT_TRUE(waitUntil([&] { return tf.getNumSubscribers() > 0; }));
  const std::size_t first_late = kFrames - 11, end_late = kFrames - 1, missing = first_late - 3;
  const auto isLate = [&](std::size_t i) { return i >= first_late && i < end_late; };
  for (std::size_t i = 0; i < kFrames; ++i) {
    const Eigen::Vector3d position(0.1 * static_cast<double>(i), 0, 1.65);
    const auto message =
        tfMessage(mounting("moving_base", position, 8 * kRadiansPerDegree), pair.stamp(i));
    if (!isLate(i) && i != missing) tf.publish(message);
    ASSERT_TRUE(pair.publishAndWait(i)) << i;
    if (i == missing) {  // the next transform would allow to interpolate
      EXPECT_TRUE(diagnostics_.waitForSummary("moving/scale_recovery", Status::ERROR,
                                              "no tf transform from base_frame \"moving_base\""));
    }
    if (isLate(i)) tf.publish(message);
  }
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.lastStamp()));
  const auto messages = pair.odometry.messages();
  std::set<std::size_t> images;
  for (const auto& odometry : messages) images.insert(pair.frameAt(odometry->header.stamp));
  EXPECT_TRUE(std::any_of(images.begin(), images.end(), isLate));
  EXPECT_EQ(images.count(missing), 0u);
  ASSERT_GT(*images.begin(), 0u);
  // odom is the base at the first image, also for the first pose, which comes later.
  for (const auto& odometry : {messages.front(), messages.back()}) {
    const double camera = pair.truePosition(odometry->header.stamp).norm();
    const auto slid = 0.1 * static_cast<double>(pair.frameAt(odometry->header.stamp));
    EXPECT_NEAR(odometry->pose.pose.position.x, camera - slid, kTolerance * camera);
  }
  EXPECT_NEAR(messages.back()->twist.twist.linear.x, 9 - 1, 0.5);
  EXPECT_TRUE(diagnostics_.waitForSummary("moving/scale_recovery", Status::OK, "scale measured"));
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
      wheels.publish(tfMessage(mounting("wheels", {0, 0, 1.65}), pair.stamp(i)));
      if (!pair.publishAndWait(i)) return false;
    }
    return true;
  };
  ASSERT_TRUE(play(0, kHalf - 1));
  EXPECT_TRUE(diagnostics_.waitForSummary(
      "parents/scale_recovery", Status::ERROR,
      "frame \"camera\" has the parent \"wheels\" on tf, so odom -> camera is not broadcast; set "
      "publish_tf to false, or stop the other publisher",
      false));

  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped to_mast = mounting("vehicle", {1, 0, 1});
  to_mast.child_frame_id = "mast";
  broadcaster.sendTransform({to_mast, mounting("mast", {0, 0, 0.65})});
  ASSERT_TRUE(play(kHalf, kFrames - 1));
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.lastStamp()));
  EXPECT_TRUE(diagnostics_.waitForSummary(
      "parents/scale_recovery", Status::ERROR,
      "frame \"camera\" has the parent \"mast\" on tf, so odom -> camera is not broadcast; set "
      "base_frame to \"vehicle\""));
  for (const auto& message : tf.messages()) {
    for (const auto& transform : message->transforms) {
      EXPECT_NE(transform.header.frame_id, "odom") << transform.child_frame_id;
    }
  }
}

TEST_F(Graph, ParametersAreUsedAndALateSubscriberGetsTheWholePathUntilAReset) {
  NodeletPair pair(manager_, *drive_, "/late");
  pair.setParam("scale_recovery", "path_max_poses", 6);
  pair.setParam("mono_vo", "tracker/cell_size", 0.03);
  pair.setParam("mono_vo", "quue_size", 3);
  for (const char* nodelet : {"mono_vo", "scale_recovery"}) {
    pair.setParam(nodelet, "clock_jump_s", 10);  // a whole number is a number
  }
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playAll());
  VisualOdometry with_defaults(drive_->drive().camera(), {});
  const std::size_t features = with_defaults.process(drive_->grey(0), 0).frame.features.size();
  EXPECT_LT(pair.frames.first()->id.size(), 0.8 * static_cast<double>(features));
  EXPECT_TRUE(waitForLine("parameter /late/mono_vo/quue_size is unknown"));
  // A pause of the images is no loss of the images.
  for (int report = 0; report < 2; ++report) {
    const std::string message = diagnostics_.next("late/scale_recovery").message;
    EXPECT_EQ(message.find("features only"), std::string::npos) << message;
  }
  TopicRecorder<nav_msgs::Path> path(handle_, "/late/path");
  ASSERT_TRUE(path.waitForCount(1));
  const nav_msgs::Path whole = *path.last();
  EXPECT_EQ(whole.header.frame_id, "odom");
  ASSERT_GT(whole.poses.size(), 2u);
  EXPECT_LE(whole.poses.size(), 6u);
  ASSERT_TRUE(callTrigger("/late/scale_recovery/reset"));
  EXPECT_TRUE(path.wait([](const auto& paths) { return paths.back()->poses.empty(); }));
  // With the default of clock_jump_s an image after 5 s would be held.
  const ros::Time later = pair.lastStamp() + ros::Duration(5);
  pair.publishImage(0, later);
  EXPECT_TRUE(pair.waitForStamp(later));
}

// The lowest rows of the images show a hood with a texture.
TEST_F(Graph, TheRegionOfAMaskIsNotUsedButTinted) {
  const SyntheticDrive::Options options = smallDrive(30);
  const int height = options.camera.height, top = height * 9 / 10;
  cv::Mat mask(height, options.camera.width, CV_8U, cv::Scalar(255));
  mask.rowRange(top, height).setTo(0);
  const RenderedDrive drive(options, "camera", [&](const cv::Mat& image) {
    cv::Mat covered = image.clone(), hood = covered.rowRange(top, height);
    cv::RNG(3).fill(hood, cv::RNG::UNIFORM, 0, 256);
    return covered;
  });
  const std::string file = temporaryFile(".png");
  ASSERT_TRUE(cv::imwrite(file, mask));
  NodeletPair pair(manager_, drive, "/masked");
  pair.setParam("mono_vo", "mask", file);
  ASSERT_TRUE(pair.load());
  std::filesystem::remove(file);
  Display display(handle_, "/masked");
  TopicRecorder<sensor_msgs::Image> vo_images(handle_, "/masked/vo/image");
  TopicRecorder<sensor_msgs::Image> vo_masks(handle_, "/masked/vo/mask");
  ASSERT_TRUE(waitUntil([&] { return display.connected() && vo_images.connected(); }));
  ASSERT_TRUE(pair.playAll());
  std::size_t features = 0;
  for (const auto& frame : pair.frames.messages()) {
    EXPECT_GT(frame->v.size(), 50u);
    features += frame->v.size();
    for (const float row : frame->v) ASSERT_LT(row, top);
  }
  EXPECT_GT(features, 100 * drive.size());
  const auto scales = pair.scales.messages();
  ASSERT_EQ(scales.size(), drive.size());
  OfflineRun offline(options.camera, optionsFor(options.camera_height), mask);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const RunFrame& record = offline.process(drive.grey(i), drive.frame(i).stamp_ns);
    EXPECT_NEAR(scales[i]->scale, record.scale.scale, 1e-9) << i;
  }
  ASSERT_TRUE(vo_images.waitForStamp(pair.lastStamp()));
  EXPECT_EQ(vo_images.last()->data, drive.image(drive.size() - 1, {})->data);
  ASSERT_TRUE(vo_masks.waitForStamp(pair.stamp(0)));
  EXPECT_EQ(vo_masks.last()->data, toMsg(mask, "mono8", {})->data);
  for (auto* images : {&display.tracks, &display.road}) {
    ASSERT_TRUE(images->waitForStamp(pair.lastStamp()));
    const auto corner = images->last()->data.end() - 3;  // bgr8
    EXPECT_NE(corner[0], corner[2]);
  }
}

// Without camera_info, and with the same result as the offline tools.
TEST_F(Graph, ACameraFileDescribesTheImages) {
  const PinholeCamera& c = drive_->drive().camera();
  CameraCalibration calibration{c.width, c.height, c.fx, c.fy, c.cx, c.cy, {0.02, 0, 0, 0, 0}};
  calibration.estimated = true;
  calibration.readout_time = 0.01;
  const std::string file = temporaryFile(".yaml");
  std::ofstream(file) << cameraYaml(calibration, "");
  calibration = readCameraFile(file);
  NodeletPair pair(manager_, *drive_, "/filed");
  pair.setParam("mono_vo", "camera_file", file);
  pair.setParam("mono_vo", "image_is_rectified", true);
  ASSERT_TRUE(pair.loadMonoVo() && pair.loadScaleRecovery() && pair.waitUntilConnected(false));
  std::filesystem::remove(file);
  auto options = optionsFor(drive_->drive().cameraHeight());
  options.odometry.vo.readout_time = calibration.readout_time;
  OfflineRun offline(calibration, options);
  for (std::size_t i = 0; i < kHalf; ++i) {
    pair.publishImage(i);
    ASSERT_TRUE(pair.waitForResult(i)) << i;
    const RunFrame& record = offline.process(drive_->grey(i), drive_->frame(i).stamp_ns);
    EXPECT_NEAR(pair.scales.last()->scale, record.scale.scale, 1e-9) << i;
  }
  EXPECT_GT(pair.scales.last()->scale, 0);
  EXPECT_TRUE(pair.frames.last()->lens_is_estimated);
}

// ScaleRecovery gets the images as undistorted by the refined lens, and the odometry continues.
TEST_F(Graph, TheCameraIsRefinedWhileDriving) {
  SyntheticDrive::Options options = mediumImages();
  options.frames = 130;
  options.stop_s = 0;
  options.road_shift_m = 25;
  const Distortion distortion(options.camera, Lens{options.camera, 0.05, -0.01});
  const RenderedDrive drive(options, "camera",
                            [&](const cv::Mat& image) { return distortion.image(image); });
  const std::string file = temporaryFile(".yaml");
  NodeletPair pair(manager_, drive, "/refined");
  pair.setParam("mono_vo", "refined_camera_file", file);
  pair.setParam("mono_vo", "odometry/readout_time", 0.001);
  ASSERT_TRUE(pair.load());
  TopicRecorder<sensor_msgs::CameraInfo> infos(handle_, "/refined/refined_camera_info");
  TopicRecorder<sensor_msgs::Image> masks(handle_, "/refined/vo/mask");
  ASSERT_TRUE(waitUntil([&] { return masks.connected(); }));
  EXPECT_FALSE(callTrigger("/refined/mono_vo/save_camera"));
  ASSERT_TRUE(pair.playAll());
  ASSERT_TRUE(infos.waitForCount(1));
  EXPECT_NEAR(infos.last()->D.at(0), 0.05, 0.02);
  EXPECT_TRUE(masks.waitForCount(2)) << "that of the better lens";
  ASSERT_TRUE(callTrigger("/refined/mono_vo/save_camera"));
  EXPECT_TRUE(readCameraFile(file).estimated);
  EXPECT_EQ(readCameraFile(file).readout_time, 0.001);
  EXPECT_NEAR(readCameraFile(file).distortion[0], infos.last()->D.at(0), 1e-8);
  std::filesystem::remove(file);
  EXPECT_EQ(pair.frames.last()->map_id, 0u);
  EXPECT_EQ(pair.scales.last()->status, ScaleEstimateMsg::OK);
  const auto poses = pair.odometry.messages();
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto &a = poses[i - 1]->pose.pose.position, &b = poses[i]->pose.pose.position;
    EXPECT_LT(std::hypot(a.x - b.x, a.y - b.y, a.z - b.z), 1.3) << i;
  }
}

}  // namespace
}  // namespace gsv
