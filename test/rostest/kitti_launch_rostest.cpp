// kitti.launch with a bag of each kind: it plays the bag to its end, gives no frame two parents,
// publishes the ground truth beside the estimate, and ends.

#include <geometry_msgs/TwistStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "child_process.hpp"
#include "common/time.hpp"
#include "mounting.hpp"
#include "rendered_camera.hpp"
#include "support/temporary_folder.hpp"

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

class KittiBag : public TemporaryFolder {
 protected:
  static constexpr std::size_t kFrames = 40;

  static void SetUpTestSuite() {
    if (!drive_) drive_ = std::make_unique<RenderedDrive>(smallDrive(kFrames), "camera_gray_left");
  }

  void SetUp() override {
    TemporaryFolder::SetUp();
    // On a busy machine no frame may be dropped either.
    for (const char* file : {"mono_vo.yaml", "scale_recovery.yaml"}) {
      write(file, "queue_size: 1000\n");
    }
  }

  /// kind: "odometry": pose of the camera on /tf, as by kitti2bag and kitti_to_bag; "raw": pose of
  /// a base on /tf, mounting of the camera on /tf_static.
  fs::path writeBag(const std::string& kind) const {
    const std::string image = kind == "raw" ? "image_raw" : "image_rect";
    const fs::path file = folder_ / (kind + ".bag");
    rosbag::Bag bag(file.string(), rosbag::bagmode::Write);
    for (std::size_t i = 0; i < kFrames; ++i) {
      const ros::Time stamp = fromNanoseconds(1000000000000 + drive_->frame(i).stamp_ns);
      const Eigen::Isometry3d& T_c0_c = drive_->frame(i).T_c0_c;
      const auto writePose = [&](const std::string& parent, const std::string& child,
                                 const Eigen::Isometry3d& T) {
        bag.write("/tf", stamp, tfMessage(transformBetween(parent, child, T), stamp));
      };
      sensor_msgs::CameraInfo info = *drive_->info(stamp);
      if (kind == "odometry") {
        info.K.fill(0);
        writePose("world", "camera_left", T_c0_c);
      } else {
        info.K[0] = info.K[4] = 2 * info.K[0];  // of the raw camera
        info.D = {-0.37, 0.2, 0.001, 0.001, -0.07};
        writePose("world", "base_link", baseFromCamera() * T_c0_c * baseFromCamera().inverse());
        bag.write(
            "/tf_static", stamp,
            tfMessage(transformBetween("base_link", "camera_gray_left", baseFromCamera()), stamp));
      }
      geometry_msgs::TwistStamped speed;
      speed.header.stamp = stamp;
      speed.twist.linear.x = speedAt(i);
      bag.write("/kitti/oxts/gps/vel", stamp, speed);
      bag.write("/kitti/camera_gray_left/camera_info", stamp, info);
      bag.write("/kitti/camera_gray_left/" + image, stamp, *drive_->image(i, stamp));
    }
    return file;
  }

  /// What is recorded while the launch file plays a bag of this kind, with one more argument.
  std::vector<ScaleEstimateMsg::Ptr> recordedScales(const std::string& kind,
                                                    const std::string& argument) const {
    const fs::path recorded = folder_ / "recorded.bag";
    ChildProcess roslaunch({"roslaunch", "ground_scale_vo", "kitti.launch",
                            "bag:=" + writeBag(kind).string(), "required:=true", argument,
                            "record:=" + recorded.string(), "config_dir:=" + folder_.string(),
                            "rate:=" + std::to_string(2 / kTimeoutFactor)});
    std::vector<ScaleEstimateMsg::Ptr> scales;
    EXPECT_TRUE(roslaunch.waitForEnd() && fs::exists(recorded)) << roslaunch.output();
    if (!fs::exists(recorded)) return scales;
    rosbag::Bag result(recorded.string());
    for (const auto& message : rosbag::View(result)) {
      if (const auto scale = message.instantiate<ScaleEstimateMsg>()) scales.push_back(scale);
    }
    return scales;
  }

  /// Of the vehicle at the image: over the intervals before and after it [m/s].
  static double speedAt(std::size_t i) {
    const auto &from = drive_->frame(i == 0 ? 0 : i - 1),
               &to = drive_->frame(std::min(i + 1, kFrames - 1));
    return (to.T_c0_c.translation() - from.T_c0_c.translation()).norm() /
           secondsBetween(from.stamp_ns, to.stamp_ns);
  }

  static inline std::unique_ptr<RenderedDrive> drive_;
};

class KittiLaunch : public KittiBag, public testing::WithParamInterface<Kind> {};

TEST_P(KittiLaunch, PlaysTheBagAndGivesEveryFrameOneParent) {
  const Kind& kind = GetParam();
  ros::NodeHandle handle;
  TopicRecorder<nav_msgs::Odometry> odometry(handle, "odometry");
  TopicRecorder<nav_msgs::Odometry> ground_truth(handle, "ground_truth/odometry");
  TopicRecorder<nav_msgs::Path> ground_truth_path(handle, "ground_truth/path");
  TopicRecorder<tf2_msgs::TFMessage> tf(handle, "/tf"), tf_static(handle, "/tf_static");

  // The bag is played when it is recorded and the nodelets are connected; this test may be later.
  EXPECT_EQ(recordedScales(kind.name, "base_frame:=" + kind.base_frame).size(), kFrames)
      << "a frame was lost";
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

  ASSERT_GT(odometry.count(), kFrames / 2);
  ASSERT_GT(ground_truth.count(), kFrames / 2);
  EXPECT_EQ(odometry.last()->child_frame_id, kind.published);
  EXPECT_EQ(ground_truth.last()->header.frame_id, "odom");
  EXPECT_EQ(ground_truth.last()->child_frame_id, "ground_truth/" + kind.published);
  const auto estimate = odometry.last()->pose.pose.position;
  const auto true_position = ground_truth.last()->pose.pose.position;
  EXPECT_GT(true_position.x, 15.0);
  EXPECT_NEAR(estimate.x, true_position.x, 0.08 * true_position.x);
  EXPECT_NEAR(estimate.y, true_position.y, 0.08 * true_position.x);

  ASSERT_GT(ground_truth_path.count(), 0u);
  const nav_msgs::Path path = *ground_truth_path.last();
  EXPECT_EQ(path.header.frame_id, "odom");
  ASSERT_GT(path.poses.size(), 15u);  // a metre per frame
  EXPECT_NEAR(path.poses.back().pose.position.x, true_position.x, 1.1);
}

TEST_F(KittiBag, TheScaleIsFromTheSpeedAlone) {
  const auto scales = recordedScales("odometry", "speed:=/kitti/oxts/gps/vel");
  ASSERT_FALSE(scales.empty());
  const auto& last = scales.back();
  EXPECT_EQ(last->source, ScaleEstimateMsg::SOURCE_BOTH);
  EXPECT_NEAR(last->camera_height, 1.65, 0.1);
  EXPECT_NEAR(last->scale * last->height, last->camera_height, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Kinds, KittiLaunch,
                         testing::Values(Kind{"odometry", "", "camera_gray_left"},
                                         Kind{"raw", "base_link", "base_link"}));

}  // namespace
}  // namespace ground_scale_vo
