// kitti.launch with a bag of each kind: it plays the bag to its end, gives no frame two parents,
// publishes the ground truth beside the estimate, and ends.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/image_encodings.h>
#include <sys/wait.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "child_process.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {
namespace {

namespace fs = std::filesystem;

/// A kind of bag, and arguments of the launch file for it.
struct Kind {
  std::string name;        ///< as in writeBag()
  std::string base_frame;  ///< argument of the launch file
  std::string published;   ///< frame whose parent is odom
};

/// The camera is 1.5 m before the base and 1.65 m above it.
Eigen::Isometry3d baseFromCamera() {
  Eigen::Isometry3d T_b_c = Eigen::Isometry3d::Identity();
  T_b_c.linear() = bodyFromOptical();
  T_b_c.translation() << 1.5, 0, 1.65;
  return T_b_c;
}

tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child,
                              const ros::Time& stamp, const Eigen::Isometry3d& T) {
  nav_msgs::Odometry odometry;
  odometry.header.frame_id = parent;
  odometry.header.stamp = stamp;
  odometry.child_frame_id = child;
  odometry.pose.pose = toMsg(T);
  tf2_msgs::TFMessage message;
  message.transforms.push_back(toTransformMsg(odometry));
  return message;
}

class KittiBag : public testing::Test {
 protected:
  static constexpr std::size_t kFrames = 40;
  static constexpr const char* kCamera = "/kitti/camera_gray_left/";
  static constexpr const char* kInfo = "/kitti/camera_gray_left/camera_info";

  static void SetUpTestSuite() {
    SyntheticDrive::Options options;
    options.frames = static_cast<int>(kFrames);
    drive_ = std::make_unique<SyntheticDrive>(options);
    for (std::size_t i = images_.size(); i < kFrames; ++i) images_.push_back(drive_->image(i));
  }

  KittiBag()
      : folder_(fs::temp_directory_path() / ("kitti_launch_rostest_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
    // On a busy machine no frame may be dropped either.
    for (const char* file : {"mono_vo.yaml", "scale_recovery.yaml"}) {
      std::ofstream(folder_ / file) << "queue_size: 1000\n";
    }
  }
  ~KittiBag() override { fs::remove_all(folder_); }

  /// kind: "native": ground truth as by kitti_to_bag; "kitti2bag_odometry", "kitti2bag_older":
  /// pose of the camera on /tf; "kitti2bag_raw": pose of a base on /tf, mounting of the camera on
  /// /tf_static.
  fs::path writeBag(const std::string& kind) const {
    const std::string image = kind == "kitti2bag_raw"     ? "image_raw"
                              : kind == "kitti2bag_older" ? "image"
                                                          : "image_rect";
    const fs::path file = folder_ / (kind + ".bag");
    rosbag::Bag bag(file.string(), rosbag::bagmode::Write);
    for (std::size_t i = 0; i < kFrames; ++i) {
      std_msgs::Header header;
      header.stamp = fromNanoseconds(1000000000000 + drive_->frame(i).stamp_ns);
      header.frame_id = "camera_gray_left";
      const Eigen::Isometry3d& T_c0_c = drive_->frame(i).T_c0_c;
      sensor_msgs::CameraInfo info = toCameraInfo(drive_->camera());
      info.header = header;
      if (kind == "native") {
        bag.write("/tf", header.stamp,
                  transform("ground_truth", "ground_truth/camera_gray_left", header.stamp, T_c0_c));
      } else if (kind == "kitti2bag_odometry") {
        info.K.fill(0);
        bag.write("/tf", header.stamp, transform("world", "camera_left", header.stamp, T_c0_c));
      } else if (kind == "kitti2bag_older") {
        info.K.fill(0);
        bag.write("/tf", header.stamp,
                  transform("camera_init", "camera_gray_left", header.stamp, T_c0_c));
      } else {
        info.K[0] = info.K[4] = 2 * info.K[0];  // of the raw camera
        info.D = {-0.37, 0.2, 0.001, 0.001, -0.07};
        const Eigen::Isometry3d T_b0_b = baseFromCamera() * T_c0_c * baseFromCamera().inverse();
        bag.write("/tf", header.stamp, transform("world", "base_link", header.stamp, T_b0_b));
        bag.write("/tf_static", header.stamp,
                  transform("base_link", "camera_gray_left", header.stamp, baseFromCamera()));
      }
      bag.write(kInfo, header.stamp, info);
      bag.write(kCamera + image, header.stamp,
                *cv_bridge::CvImage(header, sensor_msgs::image_encodings::MONO8, images_[i])
                     .toImageMsg());
    }
    return file;
  }

  /// Starts kitti.launch. Returns the process id of roslaunch.
  static pid_t launch(const std::vector<std::string>& arguments) {
    std::vector<std::string> words = {"roslaunch", "ground_scale_vo", "kitti.launch"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const pid_t child = fork();
    if (child == 0) {
      execvp(argv[0], argv.data());
      _exit(127);
    }
    return child;
  }
  /// Waits for the end of the process; stops it, and fails, if it does not end in time.
  static void waitForEnd(pid_t child) {
    if (waitUntil([&] { return waitpid(child, nullptr, WNOHANG) == child; })) return;
    kill(child, SIGTERM);
    waitpid(child, nullptr, 0);
    ADD_FAILURE() << "roslaunch did not end";
  }

  fs::path folder_;
  static std::unique_ptr<SyntheticDrive> drive_;
  static std::vector<cv::Mat> images_;
};

std::unique_ptr<SyntheticDrive> KittiBag::drive_;
std::vector<cv::Mat> KittiBag::images_;

/// A forward position at a time [s].
nav_msgs::Odometry estimateAt(double time, double x) {
  nav_msgs::Odometry odometry;
  odometry.header.frame_id = "odom";
  odometry.header.stamp = ros::Time(time);
  odometry.child_frame_id = "camera";
  odometry.pose.pose = toMsg(Eigen::Isometry3d(Eigen::Translation3d(x, 0, 0)));
  return odometry;
}

TEST(GroundTruthRelay, AlignsAnewWhenTheBagBeginsAgain) {
  ros::NodeHandle handle;
  TopicRecorder<nav_msgs::Odometry> ground_truth(handle, "ground_truth/odometry");
  TopicRecorder<nav_msgs::Path> path(handle, "ground_truth/path");
  auto tf_publisher = handle.advertise<tf2_msgs::TFMessage>("ground_truth/tf", 10);
  auto estimate_publisher = handle.advertise<nav_msgs::Odometry>("odometry", 100);
  const fs::path tools = fs::read_symlink("/proc/self/exe").parent_path();
  ChildProcess relay({tools / "ground_truth_relay"});
  ASSERT_TRUE(waitUntil([&] {
    return tf_publisher.getNumSubscribers() > 0 && estimate_publisher.getNumSubscribers() > 0 &&
           ground_truth.connected() && path.connected();
  })) << relay.output();
  for (const double time : {10, 11, 20}) {
    tf_publisher.publish(transform("ground_truth", "ground_truth/camera", ros::Time(time),
                                   Eigen::Isometry3d(Eigen::Translation3d(time, 0, 0))));
  }
  const auto estimate = [&](double time, double x) {
    estimate_publisher.publish(estimateAt(time, x));
  };
  estimate(10, 0);
  estimate(20, 9);  // a metre too short
  ASSERT_TRUE(ground_truth.waitForCount(2) && path.waitForCount(2)) << relay.output();
  estimate(10, 3);
  estimate(11, 3.5);
  ASSERT_TRUE(ground_truth.waitForCount(4) && path.waitForCount(4)) << relay.output();
  std::vector<double> positions;
  for (const auto& message : ground_truth.messages()) {
    positions.push_back(message->pose.pose.position.x);
  }
  EXPECT_EQ(positions, (std::vector<double>{0, 10, 3, 4}));
  EXPECT_EQ(path.messages().back()->poses.size(), 2u);

  // Only the last 50 estimates wait for their ground truth.
  for (int i = 1; i <= 60; ++i) estimate(20 + 0.01 * i, 0);
  estimate(20, 0);  // its ground truth is known
  ASSERT_TRUE(ground_truth.waitForCount(5)) << relay.output();
  const ros::Time end(20 + 0.01 * 60);
  tf_publisher.publish(transform("ground_truth", "ground_truth/camera", end,
                                 Eigen::Isometry3d(Eigen::Translation3d(21, 0, 0))));
  ASSERT_TRUE(ground_truth.waitForStamp(end)) << relay.output();
  EXPECT_EQ(ground_truth.messages().size(), 5u + 49u);
  relay.send(SIGINT);
  EXPECT_EQ(relay.waitForEnd(), 0) << relay.output();
}

class KittiLaunch : public KittiBag, public testing::WithParamInterface<Kind> {};

TEST_P(KittiLaunch, PlaysTheBagAndGivesEveryFrameOneParent) {
  const Kind& kind = GetParam();
  const fs::path bag = writeBag(kind.name);
  const fs::path recorded = folder_ / "recorded.bag";

  ros::NodeHandle handle;
  TopicRecorder<nav_msgs::Odometry> odometry(handle, "odometry");
  TopicRecorder<nav_msgs::Odometry> ground_truth(handle, "ground_truth/odometry");
  TopicRecorder<nav_msgs::Path> ground_truth_path(handle, "ground_truth/path");
  TopicRecorder<tf2_msgs::TFMessage> tf(handle, "/tf"), tf_static(handle, "/tf_static");

  const pid_t roslaunch =
      launch({"bag:=" + bag.string(), "required:=true", "base_frame:=" + kind.base_frame,
              "record:=" + recorded.string(), "config_dir:=" + folder_.string(),
              "rate:=" + std::to_string(2 / kTimeoutFactor)});
  ASSERT_GT(roslaunch, 0);
  waitForEnd(roslaunch);

  ASSERT_TRUE(fs::exists(recorded));
  // The bag is played when it is recorded and the nodelets are connected; this test may be later.
  rosbag::Bag result(recorded.string());
  rosbag::View scales(result, rosbag::TypeQuery(ros::message_traits::datatype<ScaleEstimateMsg>()));
  EXPECT_EQ(scales.size(), kFrames) << "a frame was lost";
  std::map<std::string, std::set<std::string>> parents;
  for (auto* recorder : {&tf, &tf_static}) {
    for (const auto& message : recorder->messages()) {
      for (const auto& transform : message->transforms) {
        parents[transform.child_frame_id].insert(transform.header.frame_id);
      }
    }
  }
  for (const auto& [child, its_parents] : parents) EXPECT_EQ(its_parents.size(), 1u) << child;
  EXPECT_EQ(parents[kind.published], std::set<std::string>{"odom"});

  const auto estimates = odometry.messages();
  const auto ground_truth_messages = ground_truth.messages();
  ASSERT_GT(estimates.size(), kFrames / 2);
  ASSERT_GT(ground_truth_messages.size(), kFrames / 2);
  EXPECT_EQ(estimates.back()->child_frame_id, kind.published);
  EXPECT_EQ(ground_truth_messages.back()->header.frame_id, "odom");
  EXPECT_EQ(ground_truth_messages.back()->child_frame_id, "ground_truth/" + kind.published);
  const auto& estimate = estimates.back()->pose.pose.position;
  const auto& true_position = ground_truth_messages.back()->pose.pose.position;
  EXPECT_GT(true_position.x, 15.0);
  EXPECT_NEAR(estimate.x, true_position.x, 0.08 * true_position.x);
  EXPECT_NEAR(estimate.y, true_position.y, 0.08 * true_position.x);

  const auto paths = ground_truth_path.messages();
  ASSERT_FALSE(paths.empty());
  EXPECT_EQ(paths.back()->header.frame_id, "odom");
  EXPECT_GT(paths.back()->poses.size(), 15u);  // a metre per frame
  EXPECT_NEAR(paths.back()->poses.back().pose.position.x, true_position.x, 1.1);
}

INSTANTIATE_TEST_SUITE_P(Kinds, KittiLaunch,
                         testing::Values(Kind{"native", "", "camera_gray_left"},
                                         Kind{"kitti2bag_odometry", "", "camera_gray_left"},
                                         Kind{"kitti2bag_older", "", "camera_gray_left"},
                                         Kind{"kitti2bag_raw", "base_link", "base_link"},
                                         Kind{"kitti2bag_raw", "", "camera_gray_left"}));

}  // namespace
}  // namespace ground_scale_vo
