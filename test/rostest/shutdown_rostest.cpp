// The manager, standalone nodes or a whole launch receive SIGINT at any moment: they end in time,
// with status 0 and without messages of a crash.

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <memory>
#include <random>
#include <thread>

#include "child_process.hpp"
#include "manager_client.hpp"
#include "rendered_camera.hpp"
#include "support/long_tests.hpp"

namespace ground_scale_vo {
namespace {

/// The program of `rosrun nodelet nodelet`, to start it without a shell.
std::string nodeletProgram() {
  const char* const workspaces = std::getenv("CMAKE_PREFIX_PATH");
  std::istringstream prefixes(std::string(workspaces != nullptr ? workspaces : "") + ":/usr");
  for (std::string prefix; std::getline(prefixes, prefix, ':');) {
    if (std::filesystem::exists(prefix + "/lib/nodelet/nodelet")) {
      return prefix + "/lib/nodelet/nodelet";
    }
  }
  throw std::runtime_error("there is no program nodelet");
}

/// What happens in the manager when it receives the signal; kIdle: nodelets without images.
enum class Moment { kBeforeLoad, kWhileLoading, kInitialising, kTracking, kIdle };
constexpr int kMoments = 5;
const char* const kNames[] = {"before load", "while loading", "initialising", "tracking", "idle"};

/// Publishes the drive again and again, at about 100 images per second.
class Camera {
 public:
  explicit Camera(const RenderedDrive& drive)
      : images_(handle_.advertise<sensor_msgs::Image>("image", 10)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 10)),
        thread_([this, &drive] {
          for (int round = 0; !stop_; ++round) {
            for (std::size_t i = 0; i < drive.size() && !stop_; ++i) {
              const double start_s = 1000.0 * (1 + round);
              infos_.publish(drive.info(i, start_s));
              images_.publish(drive.image(i, start_s));
              ros::WallDuration(0.01).sleep();
            }
          }
        }) {}
  ~Camera() {
    stop_ = true;
    thread_.join();
  }

 private:
  ros::NodeHandle handle_;
  ros::Publisher images_, infos_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class Shutdown : public testing::Test {
 protected:
  static void SetUpTestSuite() { drive_ = std::make_unique<RenderedDrive>(smallDrive(20)); }

  /// Rounds of the test of the manager; the others have a quarter of them.
  static int rounds() { return runsLongTests() ? 100 : 15; }

  /// The output without the parameters that the nodelets print at their start.
  static std::string withoutParameters(const std::string& output) {
    std::istringstream lines(output);
    std::string kept;
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("  ", 0) != 0 || line.find(" = ") == std::string::npos) kept += line + "\n";
    }
    return kept;
  }
  static void expectClean(ChildProcess& process, const std::string& what) {
    const std::optional<int> status = process.waitForEnd();
    const std::string output = withoutParameters(process.output());
    EXPECT_TRUE(status.has_value()) << what << ": did not end\n" << output;
    EXPECT_EQ(status.value_or(-1), 0) << what << "\n" << output;
    for (const char* bad :
         {"terminate called", "lock_error", "egmentation", "Assertion", "has died", "escalating"}) {
      EXPECT_EQ(output.find(bad), std::string::npos) << what << "\n" << output;
    }
  }

  ros::NodeHandle handle_;
  static std::unique_ptr<RenderedDrive> drive_;
};

std::unique_ptr<RenderedDrive> Shutdown::drive_;

TEST_F(Shutdown, OfTheManagerAtAnyMoment) {
  std::mt19937 random(1);
  for (int round = 0; round < rounds(); ++round) {
    const Moment moment = static_cast<Moment>(round % kMoments);
    const double delay = 1e-3 * static_cast<double>(random() % 300);
    const std::string what = std::string(kNames[round % kMoments]) + " + " + std::to_string(delay);
    const std::string name = "/manager_" + std::to_string(round);
    ros::param::set("/scale_recovery/camera_height", 1.65);
    TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
    std::unique_ptr<Camera> camera;
    if (moment != Moment::kIdle) camera = std::make_unique<Camera>(*drive_);
    ChildProcess manager({nodeletProgram(), "manager", "__name:=" + name.substr(1)});
    const ManagerClient client(name);
    ASSERT_TRUE(client.waitForServices());
    if (moment == Moment::kBeforeLoad) {
      ros::WallDuration(delay).sleep();
      manager.send(SIGINT);
      expectClean(manager, what);
      continue;
    }
    std::thread loader;
    if (moment == Moment::kWhileLoading) {
      loader = std::thread([&] {
        client.load("MonoVo", "/mono_vo") && client.load("ScaleRecovery", "/scale_recovery");
      });
    } else {
      ASSERT_TRUE(client.load("MonoVo", "/mono_vo"));
      ASSERT_TRUE(client.load("ScaleRecovery", "/scale_recovery"));
    }
    if (moment == Moment::kInitialising) {
      ASSERT_TRUE(frames.waitForCount(1));
    } else if (moment == Moment::kTracking) {
      ASSERT_TRUE(frames.wait([](const auto& messages) {
        return !messages.empty() && messages.back()->status == VoFrameMsg::TRACKING;
      })) << what;
    }
    ros::WallDuration(delay).sleep();
    manager.send(SIGINT);
    expectClean(manager, what);
    if (loader.joinable()) loader.join();
  }
}

TEST_F(Shutdown, OfStandaloneNodes) {
  std::mt19937 random(3);
  ros::param::set("/scale_recovery/camera_height", 1.65);
  Camera camera(*drive_);
  for (int round = 0; round < rounds() / 4; ++round) {
    const double delay = 1e-3 * static_cast<double>(random() % 300);
    const std::string what = "round " + std::to_string(round) + " + " + std::to_string(delay);
    TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
    TopicRecorder<ScaleEstimateMsg> scales(handle_, "scale");
    ChildProcess mono_vo(
        {nodeletProgram(), "standalone", "ground_scale_vo/MonoVo", "__name:=mono_vo"});
    ChildProcess scale_recovery({nodeletProgram(), "standalone", "ground_scale_vo/ScaleRecovery",
                                 "__name:=scale_recovery"});
    if (round > 0) {
      ASSERT_TRUE(scales.waitForCount(1)) << mono_vo.output() << scale_recovery.output();
    } else {
      ASSERT_TRUE(waitUntil([&] { return frames.connected() && scales.connected(); }));
    }
    ros::WallDuration(delay).sleep();
    mono_vo.send(SIGINT);
    scale_recovery.send(SIGINT);
    expectClean(mono_vo, what + " MonoVo");
    expectClean(scale_recovery, what + " ScaleRecovery");
  }
}

// roslaunch stops all nodes at once: the manager and the nodes that loaded the nodelets.
TEST_F(Shutdown, OfTheWholeLaunch) {
  std::mt19937 random(2);
  Camera camera(*drive_);
  for (int round = 0; round < rounds() / 4; ++round) {
    const double delay = 1e-3 * static_cast<double>(random() % 300);
    const std::string what = "round " + std::to_string(round) + " + " + std::to_string(delay);
    TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
    ChildProcess launch({"roslaunch", "ground_scale_vo", "ground_scale_vo.launch",
                         "camera_height:=1.65", "image:=image", "camera_info:=camera_info"});
    ASSERT_TRUE(frames.waitForCount(1)) << launch.output();
    ros::WallDuration(delay).sleep();
    launch.send(SIGINT);
    expectClean(launch, what);
  }
}

}  // namespace
}  // namespace ground_scale_vo
