// A rendered drive through both nodelets in a nodelet manager, image by image: the same poses
// as of the offline run, and everything else that the nodelets publish about them.

#include <sensor_msgs/point_cloud2_iterator.h>

#include <sstream>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "manager_test.hpp"

namespace gsv {
namespace {

/// Sends the drive through the nodelets and through the offline run, and records the results.
struct PlayedDrive : NodeletPair {
  PlayedDrive(const ManagerClient& manager, const RenderedDrive& rendered)
      : NodeletPair(manager, rendered, ""),
        drive(rendered),
        offline(rendered.drive().camera(), optionsFor(rendered.drive().cameraHeight())) {}

  void play() {
    ASSERT_TRUE(load());
    ASSERT_TRUE(waitUntil(
        [this] { return vo_odometry.connected() && tf.connected() && display.connected(); }));
    for (std::size_t i = 0; i < drive.size(); ++i) {
      publish(i);
      offline.process(drive.grey(i), toNanoseconds(stamp(i)));
      // Wait for the result before the next image, so that no frame is dropped.
      ASSERT_TRUE(waitForResult(i)) << i;
    }
    ASSERT_TRUE(odometry.waitForStamp(lastStamp()) && vo_odometry.waitForStamp(lastStamp()) &&
                display.points.waitForStamp(lastStamp()) &&
                display.vo_points.waitForStamp(lastStamp()) &&
                display.ground_points.waitForStamp(lastStamp()) &&
                display.tracks.waitForStamp(lastStamp()) &&
                display.road.waitForStamp(lastStamp()) && display.path.waitForCount(1));
    ASSERT_TRUE(tf.wait([this](const auto& messages) {
      return !messages.empty() && messages.back()->transforms.at(0).header.stamp == lastStamp();
    }));
  }

  const RenderedDrive& drive;
  OfflineRun offline;
  TopicRecorder<nav_msgs::Odometry> vo_odometry{handle_, "vo/odometry"};
  Display display{handle_, ""};
  TopicRecorder<tf2_msgs::TFMessage> tf{handle_, "/tf"};
};

/// The drive is played once; all tests check the same run.
class Drive : public testing::Test {
 protected:
  static void SetUpTestSuite() { drive_ = std::make_unique<RenderedDrive>(smallDrive(90)); }
  static void TearDownTestSuite() {
    run_.reset();
    drive_.reset();
  }
  void SetUp() override {
    if (!run_) {
      const ManagerClient manager("/manager");
      ASSERT_TRUE(manager.waitForServices());
      run_ = std::make_unique<PlayedDrive>(manager, *drive_);
      run_->play();
    }
  }

  static inline std::unique_ptr<RenderedDrive> drive_;
  static inline std::unique_ptr<PlayedDrive> run_;
  const double height = drive_->drive().cameraHeight();
};

// Runs first: waits for the diagnostics of the drive's end.
TEST_F(Drive, DiagnosticsDescribeTheDriveAndItsLastFrame) {
  ros::NodeHandle handle;
  DiagnosticsRecorder diagnostics(handle);
  const auto text = [](double value) {
    std::ostringstream stream;
    stream << value;
    return stream.str();
  };
  const std::vector<TrackedFeature> features = fromMsg(*run_->frames.last()).features;
  const auto points = std::count_if(features.begin(), features.end(),
                                    [](const TrackedFeature& f) { return f.has_point; });
  ASSERT_LT(points, static_cast<std::ptrdiff_t>(features.size()));
  EXPECT_TRUE(diagnostics.waitForValues("mono_vo",
                                        {{"images processed", std::to_string(run_->drive.size())},
                                         {"features", std::to_string(features.size())},
                                         {"map points", std::to_string(points)}}));
  const ScaleRecovery::Output& last = run_->offline.last().scale;
  EXPECT_TRUE(diagnostics.waitForValues("scale_recovery",
                                        {{"frames processed", std::to_string(run_->drive.size())},
                                         {"images", "used"},
                                         {"distance [m]", text(last.pose->distance)},
                                         {"scale [m / VO unit]", text(last.scale.scale)},
                                         {"sigma [m / VO unit]", text(last.scale.sigma)}}));
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    EXPECT_GT(numberIn(diagnostics.next(nodelet), "time of the last frame [ms]"), 0) << nodelet;
  }
}

TEST_F(Drive, EveryImageGivesOneFrameAndOneScaleInOrder) {
  const auto frames = run_->frames.messages();
  const auto scales = run_->scales.messages();
  const auto vo_odometry = run_->vo_odometry.messages();
  ASSERT_EQ(frames.size(), run_->drive.size());
  ASSERT_EQ(scales.size(), run_->drive.size());
  std::size_t tracked = 0, without_scale = 0;
  for (std::size_t i = 0; i < run_->drive.size(); ++i) {
    EXPECT_EQ(frames[i]->sequence, i);
    EXPECT_EQ(frames[i]->header.stamp, run_->stamp(i));
    EXPECT_EQ(frames[i]->header.frame_id, "camera");
    EXPECT_EQ(scales[i]->header.stamp, run_->stamp(i));
    if (scales[i]->status == ScaleEstimateMsg::UNKNOWN) {
      EXPECT_EQ(scales[i]->scale, 0);
      without_scale = i;
    }
    if (frames[i]->status != VoFrameMsg::TRACKING) continue;
    ASSERT_LT(tracked, vo_odometry.size());
    const nav_msgs::Odometry& odometry = *vo_odometry[tracked++];
    EXPECT_EQ(odometry.header.stamp, run_->stamp(i));
    EXPECT_EQ(odometry.header.frame_id, "vo_world");
    EXPECT_EQ(odometry.pose.pose, frames[i]->pose);
  }
  EXPECT_EQ(vo_odometry.size(), tracked);
  EXPECT_LT(tracked, run_->drive.size());  // the first frames have no pose
  // Nothing metric comes before the first scale.
  ASSERT_LT(without_scale, run_->drive.size() / 2);
  EXPECT_GT(run_->odometry.first()->header.stamp, run_->stamp(without_scale));
  EXPECT_GT(run_->display.plane.first()->header.stamp, run_->stamp(without_scale));
  EXPECT_GT(run_->tf.first()->transforms.at(0).header.stamp, run_->stamp(without_scale));
}

TEST_F(Drive, ResultsEqualTheOfflineRun) {
  const auto& records = run_->offline.record().frames();
  const auto scales = run_->scales.messages();
  ASSERT_EQ(records.size(), scales.size());
  std::size_t poses = 0;
  for (std::size_t i = 0; i < records.size(); ++i) {
    EXPECT_EQ(scales[i]->status, static_cast<int>(records[i].scale.status)) << i;
    EXPECT_NEAR(scales[i]->scale, records[i].scale.scale, 1e-9) << i;
    poses += records[i].has_metric_pose;
  }
  EXPECT_EQ(run_->odometry.count(), poses);
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  T_odom_o.linear() = bodyFromOptical();
  for (const auto& message : run_->odometry.messages()) {
    const std::size_t i = run_->frameAt(message->header.stamp);
    ASSERT_TRUE(records[i].has_metric_pose);
    EXPECT_EQ(message->header.frame_id, "odom");
    EXPECT_EQ(message->child_frame_id, "camera");
    const Eigen::Isometry3d T_o_c = T_odom_o.inverse() * fromMsg(message->pose.pose);
    EXPECT_LT((T_o_c.matrix() - records[i].T_o_c.matrix()).cwiseAbs().maxCoeff(), 1e-9) << i;
  }
}

TEST_F(Drive, TfAndPathEqualTheOdometry) {
  const auto odometry = run_->odometry.messages();
  const auto tf = run_->tf.messages();
  ASSERT_EQ(tf.size(), odometry.size());
  for (std::size_t k = 0; k < odometry.size(); ++k) {
    ASSERT_EQ(tf[k]->transforms.size(), 1u);
    geometry_msgs::TransformStamped transform = tf[k]->transforms[0];
    transform.header.seq = odometry[k]->header.seq;
    EXPECT_EQ(transform, toTransformMsg(*odometry[k]));
  }
  const auto path = run_->display.path.last();
  EXPECT_GT(path->poses.size(), 10u);
  EXPECT_EQ(path->header.stamp, path->poses.back().header.stamp);
  for (const geometry_msgs::PoseStamped& pose : path->poses) {
    EXPECT_EQ(pose.header.frame_id, "odom");
    const auto same = std::find_if(odometry.begin(), odometry.end(), [&](const auto& message) {
      return message->header.stamp == pose.header.stamp;
    });
    ASSERT_NE(same, odometry.end());
    EXPECT_EQ(pose.pose, (*same)->pose.pose);
  }
}

TEST_F(Drive, PointsAreInMetresAndInVoUnits) {
  std::vector<float> depths;  // [VO units]
  for (const TrackedFeature& feature : fromMsg(*run_->frames.last()).features) {
    if (feature.has_point) depths.push_back(feature.p_c.z());
  }
  ASSERT_GT(depths.size(), 50u);
  const double scale = run_->scales.last()->scale;
  for (const auto& [cloud, unit] :
       {std::pair(run_->display.points.last(), scale), {run_->display.vo_points.last(), 1.0}}) {
    ASSERT_EQ(cloud->width * cloud->height, depths.size());
    sensor_msgs::PointCloud2ConstIterator<float> z(*cloud, "z");
    for (const float depth : depths) {
      EXPECT_FLOAT_EQ(*z, static_cast<float>(unit) * depth);
      ++z;
    }
  }
}

TEST_F(Drive, GroundPointsAreInMetres) {
  const auto scales = run_->scales.messages();
  std::vector<double> heights;
  for (const auto& cloud : run_->display.ground_points.messages()) {
    if (cloud->data.empty()) continue;  // at a standstill
    const auto& up = scales.at(run_->frameAt(cloud->header.stamp))->normal;
    sensor_msgs::PointCloud2ConstIterator<float> x(*cloud, "x");
    for (; x != x.end(); ++x) heights.push_back(up.x * x[0] + up.y * x[1] + up.z * x[2]);
  }
  ASSERT_GT(heights.size(), 500u);
  const auto median = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), median, heights.end());
  EXPECT_NEAR(*median, -height, 0.03 * height);
}

}  // namespace
}  // namespace gsv
