// Loading and unloading in a real manager: refusals, two pairs, and unloading at any moment.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <atomic>
#include <boost/make_shared.hpp>
#include <thread>

#include "child_process.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "manager_client.hpp"
#include "node_probe.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {
namespace {

class Load : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(manager_.waitForServices()); }

  bool load(const std::string& type, const std::string& name) { return manager_.load(type, name); }
  bool unload(const std::string& name) { return manager_.unload(name); }
  std::optional<std::size_t> loaded() { return manager_.loaded(); }

  /// Both nodelets, unloaded in either order while they process images.
  void loadAndUnload(int round, TopicRecorder<VoFrameMsg>* frames) {
    ASSERT_TRUE(load("MonoVo", "/mono_vo"));
    ASSERT_TRUE(load("ScaleRecovery", "/scale_recovery"));
    frames->clear();
    EXPECT_TRUE(frames->waitForCount(static_cast<std::size_t>(1 + round % 3))) << "load " << round;
    ASSERT_TRUE(unload(round % 2 == 0 ? "/mono_vo" : "/scale_recovery"));
    ASSERT_TRUE(unload(round % 2 == 0 ? "/scale_recovery" : "/mono_vo"));
  }

  const ManagerClient manager_{"/manager"};
};

TEST_F(Load, ScaleRecoveryRefusesToLoadWithoutTheHeight) {
  EXPECT_FALSE(load("ScaleRecovery", "/without_height"));
  EXPECT_EQ(loaded(), 0u);
  ros::param::set("/without_height/camera_height", 1.65);
  EXPECT_TRUE(load("ScaleRecovery", "/without_height"));
  EXPECT_TRUE(unload("/without_height"));
}

TEST_F(Load, WrongParametersAreRefused) {
  ros::param::set("/wrong_height/camera_height", -1.65);
  EXPECT_FALSE(load("ScaleRecovery", "/wrong_height"));
  ros::param::set("/wrong_queue/queue_size", 0);
  EXPECT_FALSE(load("MonoVo", "/wrong_queue"));
  EXPECT_EQ(loaded(), 0u);
}

TEST_F(Load, AnUnknownParameterIsLogged) {
  ChildProcess nodelet({"rosrun", "nodelet", "nodelet", "standalone", "ground_scale_vo/MonoVo",
                        "__name:=misspelt", "_quue_size:=3"});
  EXPECT_TRUE(waitUntil([&] {
    return nodelet.output().find(
               "parameter /misspelt/quue_size is unknown and has no effect; did you mean "
               "/misspelt/queue_size?") != std::string::npos;
  })) << nodelet.output();
  nodelet.send(SIGINT);
  EXPECT_EQ(nodelet.waitForEnd(), 0) << nodelet.output();
  for (const std::string name : {"queue_size", "world_frame"}) {
    EXPECT_NE(nodelet.output().find("\n  " + name + " = "), std::string::npos) << nodelet.output();
  }
}

TEST_F(Load, TwoPairsInOneManager) {
  for (const std::string car : {"/front", "/rear"}) {
    ros::param::set(car + "/scale_recovery/camera_height", 1.65);
    EXPECT_TRUE(load("ScaleRecovery",
                     car + "/scale_recovery"));  // before MonoVo: the order does not matter
    EXPECT_TRUE(load("MonoVo", car + "/mono_vo"));
  }
  EXPECT_EQ(loaded(), 4u);
  ros::NodeHandle handle;
  TopicRecorder<VoFrameMsg> front(handle, "/front/vo/frame"), rear(handle, "/rear/vo/frame");
  EXPECT_TRUE(waitUntil([&] { return front.connected() && rear.connected(); }));
  for (const std::string car : {"/front", "/rear"}) {
    EXPECT_TRUE(unload(car + "/mono_vo"));
    EXPECT_TRUE(unload(car + "/scale_recovery"));
  }
  EXPECT_EQ(loaded(), 0u);
}

constexpr int kReloads = 100;
constexpr int kWarmUpReloads = 20;
/// Largest growth of the memory after the warm-up [MiB]: 50 KiB per reload. Measured in total:
/// 0.04.
constexpr double kMaxGrowth = 4;

TEST_F(Load, UnloadingIsCleanWhileImagesArrive) {
  ros::NodeHandle handle;
  ros::Publisher images = handle.advertise<sensor_msgs::Image>("image", 10);
  ros::Publisher infos = handle.advertise<sensor_msgs::CameraInfo>("camera_info", 10);
  std::atomic<bool> stop{false};
  std::thread camera([&] {
    PinholeCamera pinhole;
    pinhole.width = 320;
    pinhole.height = 120;
    pinhole.fx = pinhole.fy = 200;
    pinhole.cx = 160;
    pinhole.cy = 60;
    for (std::uint32_t i = 1; !stop; ++i) {
      auto image = boost::make_shared<sensor_msgs::Image>();
      image->header.stamp = ros::Time(100 + 0.01 * i);
      image->header.frame_id = "camera";
      image->encoding = "mono8";
      image->width = image->step = 320;
      image->height = 120;
      for (std::uint32_t k = 0; k < 320 * 120; ++k) {  // pseudo-random texture, always the same
        image->data.push_back(static_cast<std::uint8_t>((k * 2654435761u) >> 24));
      }
      auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(pinhole));
      info->header = image->header;
      infos.publish(info);
      images.publish(image);
      ros::WallDuration(0.01).sleep();  // the camera's rate
    }
  });
  ros::param::set("/scale_recovery/camera_height", 1.65);
  TopicRecorder<VoFrameMsg> frames(handle, "vo/frame");
  const NodeProbe manager("/manager");
  const std::set<std::string> registered = manager.registrations();
  std::size_t threads = 0;
  double rss_mb = 0;
  for (int i = 0; i < kReloads && !HasFatalFailure(); ++i) {
    if (i == kWarmUpReloads) {
      threads = manager.threads();
      rss_mb = manager.usage().rss_mb;
    }
    loadAndUnload(i, &frames);
  }
  stop = true;
  camera.join();
  EXPECT_EQ(loaded(), 0u);
  EXPECT_EQ(manager.registrations(), registered);
  EXPECT_LE(manager.threads(), threads);
  if (!kSanitized) {
    EXPECT_LT(manager.usage().rss_mb - rss_mb, kMaxGrowth) << "from " << rss_mb << " MiB";
  }
  RecordProperty("growth_kiB", static_cast<int>(1024 * (manager.usage().rss_mb - rss_mb)));
}

}  // namespace
}  // namespace ground_scale_vo
