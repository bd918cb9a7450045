// The manager, standalone nodes or a whole launch receive SIGINT at any moment: they end in time,
// with status 0 and without messages of a crash.

#include <thread>

#include "child_process.hpp"
#include "nodelet_pair.hpp"
#include "support/long_tests.hpp"

namespace gsv {
namespace {

/// What happens in the manager when it receives the signal; kIdle: nodelets without images.
enum class Moment { kBeforeLoad, kWhileLoading, kInitialising, kTracking, kIdle };
constexpr int kMoments = 5;
const char* const kNames[] = {"before load", "while loading", "initialising", "tracking", "idle"};

class Shutdown : public testing::Test {
 protected:
  static void SetUpTestSuite() { drive_ = std::make_unique<RenderedDrive>(smallDrive(20)); }
  static void TearDownTestSuite() { drive_.reset(); }

  /// Rounds of the test of the manager; the others have a quarter of them.
  static int rounds() { return runsLongTests() ? 100 : 10; }

  /// The output without the parameters that the nodelets print at their start.
  static std::string withoutParameters(const std::string& output) {
    std::istringstream lines(output);
    std::string kept;
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("  ", 0) != 0 || line.find(" = ") == std::string::npos) kept += line + "\n";
    }
    return kept;
  }
  /// Waits up to 0.3 s and describes it.
  std::string waitAtRandom() {
    const double delay = 1e-3 * static_cast<double>(random_() % 300);
    ros::WallDuration(delay).sleep();
    return " + " + std::to_string(delay) + " s";
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
  std::mt19937 random_{1};
  static inline std::unique_ptr<RenderedDrive> drive_;
};

TEST_F(Shutdown, OfTheManagerAtAnyMoment) {
  ros::param::set("/scale_recovery/camera_height", 1.65);
  for (int round = 0; round < rounds(); ++round) {
    const Moment moment = static_cast<Moment>(round % kMoments);
    const std::string name = "/manager_" + std::to_string(round);
    TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
    std::unique_ptr<RepeatingCamera> camera;
    if (moment != Moment::kIdle) camera = std::make_unique<RepeatingCamera>(*drive_);
    ChildProcess manager({"rosrun", "nodelet", "nodelet", "manager", "__name:=" + name.substr(1)});
    const ManagerClient client(name);
    ASSERT_TRUE(client.waitForServices());
    const auto load = [&] {
      return client.load("MonoVo", "/mono_vo") && client.load("ScaleRecovery", "/scale_recovery");
    };
    std::thread loader;
    if (moment == Moment::kWhileLoading) {
      loader = std::thread(load);
    } else if (moment != Moment::kBeforeLoad) {
      ASSERT_TRUE(load());
    }
    if (moment == Moment::kInitialising) {
      ASSERT_TRUE(frames.waitForCount(1));
    } else if (moment == Moment::kTracking) {
      ASSERT_TRUE(frames.wait([](const auto& messages) {
        return !messages.empty() && messages.back()->status == VoFrameMsg::TRACKING;
      }));
    }
    const std::string what = kNames[round % kMoments] + waitAtRandom();
    manager.send(SIGINT);
    expectClean(manager, what);
    if (loader.joinable()) loader.join();
  }
}

// roslaunch stops all nodes at once: the manager and the nodes that loaded the nodelets.
TEST_F(Shutdown, OfStandaloneNodesAndOfTheWholeLaunch) {
  using CommandLine = std::vector<std::string>;
  ros::param::set("/scale_recovery/camera_height", 1.65);
  const RepeatingCamera camera(*drive_);
  const auto standalone = [](const std::string& type, const std::string& name) -> CommandLine {
    return {"rosrun",         "nodelet", "nodelet", "standalone", "ground_scale_vo/" + type,
            "__name:=" + name};
  };
  const std::vector<CommandLine> kPrograms[] = {
      {standalone("MonoVo", "mono_vo"), standalone("ScaleRecovery", "scale_recovery")},
      {{"roslaunch", "ground_scale_vo", "ground_scale_vo.launch", "camera_height:=1.65",
        "image:=image", "camera_info:=camera_info",
        "--sigint-timeout=" + std::to_string(15 * kTimeoutFactor)}}};
  for (int round = 0; round < rounds() / 4; ++round) {
    for (const auto& programs : kPrograms) {
      TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
      TopicRecorder<ScaleEstimateMsg> scales(handle_, "scale");
      std::vector<std::unique_ptr<ChildProcess>> processes;
      for (const auto& words : programs) {
        processes.push_back(std::make_unique<ChildProcess>(words));
      }
      if (round > 0 || programs.size() == 1) {
        ASSERT_TRUE(scales.waitForCount(1)) << processes.front()->output();
      } else {
        ASSERT_TRUE(waitUntil([&] { return frames.connected() && scales.connected(); }));
      }
      const std::string what = "round " + std::to_string(round) + waitAtRandom();
      for (const auto& process : processes) process->send(SIGINT);
      for (const auto& process : processes) expectClean(*process, what);
    }
  }
}

}  // namespace
}  // namespace gsv
