// A rendered drive through both nodelets in a nodelet manager, image by image: the metric odometry
// against ground truth, and against the offline run, which must give the same poses.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/Marker.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <boost/make_shared.hpp>
#include <memory>
#include <utility>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "topic_recorder.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {
namespace {

/// Sends the drive through the nodelets and through the offline run, and records the results.
struct PlayedDrive {
  static constexpr double kCameraHeight = 1.65;
  static constexpr std::int64_t kStartNs = 1000000000000;  // stamp of the first image

  explicit PlayedDrive(ros::NodeHandle& handle)
      : drive(driveOptions()),
        offline(drive.camera(), offlineOptions()),
        frames(handle, "vo/frame"),
        scales(handle, "scale"),
        odometry(handle, "odometry"),
        vo_odometry(handle, "vo/odometry"),
        path(handle, "path"),
        tracks(handle, "vo/image_tracks"),
        road(handle, "image_road"),
        points(handle, "points"),
        vo_points(handle, "vo/points"),
        ground_points(handle, "ground_points"),
        plane(handle, "ground_plane"),
        tf(handle, "/tf"),
        diagnostics(handle, "/diagnostics"),
        images(handle.advertise<sensor_msgs::Image>("image", 10)),
        infos(handle.advertise<sensor_msgs::CameraInfo>("camera_info", 10)) {}

  static SyntheticDrive::Options driveOptions() {
    SyntheticDrive::Options options;
    options.frames = 90;
    options.camera_height = kCameraHeight;
    return options;
  }
  static OfflineRun::Options offlineOptions() {
    OfflineRun::Options options;
    options.scale.camera_height = kCameraHeight;
    return options;
  }

  void play() {
    ASSERT_TRUE(waitUntil([this] {
      return images.getNumSubscribers() > 0 && infos.getNumSubscribers() > 0 &&
             frames.connected() && scales.connected() && odometry.connected() && path.connected() &&
             vo_odometry.connected() && vo_points.connected() && tracks.connected() &&
             road.connected() && points.connected() && ground_points.connected() &&
             plane.connected() && tf.connected();
    })) << "the nodelets did not come up";
    for (std::size_t i = 0; i < drive.size(); ++i) {
      const cv::Mat grey = drive.image(i);
      const auto image =
          cv_bridge::CvImage(header(i), sensor_msgs::image_encodings::MONO8, grey).toImageMsg();
      auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(drive.camera()));
      info->header = image->header;
      infos.publish(info);
      images.publish(image);
      offline.process(grey, toNanoseconds(image->header.stamp));
      with_direct += offline.last().scale.direct.height > 0;
      offline_ground_points.push_back(offline.last().scale.ground_points_c);
      // Wait for the result before the next image, so that no frame is dropped.
      ASSERT_TRUE(scales.waitForStamp(image->header.stamp)) << "frame " << i;
    }
    const ros::Time last = header(drive.size() - 1).stamp;
    ASSERT_TRUE(frames.waitForStamp(last));
    ASSERT_TRUE(odometry.waitForStamp(last));
    ASSERT_TRUE(vo_odometry.waitForStamp(last));
    ASSERT_TRUE(tf.wait([&last](const auto& messages) {
      return !messages.empty() && messages.back()->transforms.at(0).header.stamp == last;
    }));
  }

  std_msgs::Header header(std::size_t i) const {
    std_msgs::Header header;
    header.stamp = fromNanoseconds(kStartNs + drive.frame(i).stamp_ns);
    header.frame_id = "camera";
    return header;
  }
  std::size_t frameAt(const ros::Time& stamp) const {
    for (std::size_t i = 0; i < drive.size(); ++i) {
      if (header(i).stamp == stamp) return i;
    }
    throw std::logic_error("no frame has this stamp");
  }

  SyntheticDrive drive;
  OfflineRun offline;
  int with_direct = 0;  ///< frames with a direct measurement, offline
  std::vector<std::vector<Eigen::Vector3f>> offline_ground_points;  ///< by frame [VO units]
  TopicRecorder<VoFrameMsg> frames;
  TopicRecorder<ScaleEstimateMsg> scales;
  TopicRecorder<nav_msgs::Odometry> odometry, vo_odometry;
  TopicRecorder<nav_msgs::Path> path;
  TopicRecorder<sensor_msgs::Image> tracks, road;
  TopicRecorder<sensor_msgs::PointCloud2> points, vo_points, ground_points;
  TopicRecorder<visualization_msgs::Marker> plane;
  TopicRecorder<tf2_msgs::TFMessage> tf;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics;
  ros::Publisher images, infos;
};

/// The drive is played once; all tests check the same run.
class Drive : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    ros::NodeHandle handle;
    run_ = std::make_unique<PlayedDrive>(handle);
    run_->play();
  }
  static void TearDownTestSuite() { run_.reset(); }

  static std::unique_ptr<PlayedDrive> run_;
  PlayedDrive& run = *run_;
};

std::unique_ptr<PlayedDrive> Drive::run_;

TEST_F(Drive, EveryImageGivesOneFrameAndOneScaleInOrder) {
  const auto frame_messages = run.frames.messages();
  const auto scale_messages = run.scales.messages();
  ASSERT_EQ(frame_messages.size(), run.drive.size());
  ASSERT_EQ(scale_messages.size(), run.drive.size());
  for (std::size_t i = 0; i < run.drive.size(); ++i) {
    EXPECT_EQ(frame_messages[i]->sequence, i);
    EXPECT_EQ(frame_messages[i]->header.stamp, run.header(i).stamp);
    EXPECT_EQ(frame_messages[i]->header.frame_id, "camera");
    EXPECT_EQ(scale_messages[i]->header.stamp, run.header(i).stamp);
  }
}

// Runs before the tests that wait for later diagnostics.
TEST_F(Drive, DiagnosticsReportTheRateOfTheFrames) {
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    constexpr bool kFromNow = false;
    EXPECT_TRUE(waitForStatus(
        run.diagnostics,
        [&](const auto& status) {
          return status.name.find(nodelet) != std::string::npos &&
                 numberIn(status, "rate [Hz]") > 0;
        },
        kFromNow))
        << nodelet;
  }
}

TEST_F(Drive, ResultsEqualThoseOfTheOfflineRun) {
  const auto& records = run.offline.record().frames();
  const auto scale_messages = run.scales.messages();
  ASSERT_EQ(records.size(), scale_messages.size());
  std::size_t poses = 0;
  for (std::size_t i = 0; i < records.size(); ++i) {
    EXPECT_EQ(scale_messages[i]->status, static_cast<int>(records[i].scale.status)) << i;
    EXPECT_NEAR(scale_messages[i]->scale, records[i].scale.scale, 1e-9) << i;
    poses += records[i].has_metric_pose;
  }
  const auto odometry_messages = run.odometry.messages();
  ASSERT_EQ(odometry_messages.size(), poses);
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  T_odom_o.linear() = bodyFromOptical();
  for (const auto& message : odometry_messages) {
    const std::size_t i = run.frameAt(message->header.stamp);
    ASSERT_TRUE(records[i].has_metric_pose);
    const Eigen::Isometry3d T_o_c = T_odom_o.inverse() * fromMsg(message->pose.pose);
    EXPECT_LT((T_o_c.matrix() - records[i].T_o_c.matrix()).cwiseAbs().maxCoeff(), 1e-9) << i;
  }
}

TEST_F(Drive, ScaleRecoveryUsesTheImages) {
  EXPECT_TRUE(waitForValue(run.diagnostics, "images", "used"));
}

TEST_F(Drive, VoOdometryIsThePoseOfEachTrackedFrame) {
  const auto messages = run.vo_odometry.messages();
  std::size_t tracked = 0;
  for (const auto& frame : run.frames.messages()) {
    if (frame->status != VoFrameMsg::TRACKING) continue;
    ASSERT_LT(tracked, messages.size());
    const nav_msgs::Odometry& odometry = *messages[tracked++];
    EXPECT_EQ(odometry.header.stamp, frame->header.stamp);
    EXPECT_EQ(odometry.header.frame_id, "vo_world");
    EXPECT_EQ(odometry.pose.pose, frame->pose);
  }
  EXPECT_EQ(messages.size(), tracked);
  EXPECT_LT(tracked, run.drive.size());  // the first frames have no pose
}

TEST_F(Drive, DiagnosticsDescribeTheDriveAndItsLastFrame) {
  const std::vector<TrackedFeature> features = fromMsg(*run.frames.messages().back()).features;
  const auto points = std::count_if(features.begin(), features.end(),
                                    [](const TrackedFeature& f) { return f.has_point; });
  ASSERT_LT(points, static_cast<std::ptrdiff_t>(features.size()));
  const auto reports = [](const std::string& nodelet, const std::string& key, auto value) {
    return waitForValue(run_->diagnostics, key, std::to_string(value), nodelet);
  };
  EXPECT_TRUE(reports("mono_vo", "images processed", run.drive.size()));
  EXPECT_TRUE(reports("mono_vo", "features", features.size()));
  EXPECT_TRUE(reports("mono_vo", "map points", points));
  EXPECT_TRUE(reports("scale_recovery", "frames processed", run.drive.size()));
  ASSERT_LT(run.with_direct, static_cast<int>(run.drive.size()));
  EXPECT_TRUE(reports("scale_recovery", "frames with a direct measurement", run.with_direct));
  const auto reportsNumber = [](const std::string& key, double value) {
    std::ostringstream text;
    text << value;
    return waitForValue(run_->diagnostics, key, text.str(), "scale_recovery");
  };
  for (const std::string nodelet : {"mono_vo", "scale_recovery"}) {
    EXPECT_TRUE(waitForStatus(run_->diagnostics, [&](const auto& status) {
      return status.name.find(nodelet) != std::string::npos &&
             numberIn(status, "time of the last frame [ms]") > 0;
    })) << nodelet;
  }
  const ScaleRecovery::Output& last = run.offline.last().scale;
  EXPECT_TRUE(reportsNumber("distance [m]", last.pose->distance));
  EXPECT_TRUE(reportsNumber("scale [m / VO unit]", last.scale.scale));
  EXPECT_TRUE(reportsNumber("sigma [m / VO unit]", last.scale.sigma));
}

TEST_F(Drive, NothingMetricBeforeTheFirstScale) {
  const auto scale_messages = run.scales.messages();
  ros::Time first_scale = ros::TIME_MAX;
  for (const auto& scale : scale_messages) {
    if (scale->status == ScaleEstimateMsg::UNKNOWN) {
      EXPECT_EQ(scale->scale, 0);
    } else {
      first_scale = std::min(first_scale, scale->header.stamp);
    }
  }
  ASSERT_LT(first_scale, run.header(run.drive.size() / 2).stamp) << "no scale in half of the drive";
  EXPECT_GE(run.odometry.messages().front()->header.stamp, first_scale);
  EXPECT_GE(run.plane.messages().front()->header.stamp, first_scale);
  EXPECT_GE(run.tf.messages().front()->transforms.at(0).header.stamp, first_scale);
}

TEST_F(Drive, PathLengthAgreesWithTheGroundTruth) {
  const auto messages = run.odometry.messages();
  ASSERT_GT(messages.size(), run.drive.size() / 2);
  double length = 0, true_length = 0;
  for (std::size_t k = 1; k < messages.size(); ++k) {
    const Eigen::Isometry3d step =
        fromMsg(messages[k - 1]->pose.pose).inverse() * fromMsg(messages[k]->pose.pose);
    length += step.translation().norm();
    const auto& a = run.drive.frame(run.frameAt(messages[k - 1]->header.stamp));
    const auto& b = run.drive.frame(run.frameAt(messages[k]->header.stamp));
    true_length += (b.T_c0_c.translation() - a.T_c0_c.translation()).norm();
  }
  EXPECT_NEAR(length / true_length, 1.0, 0.06);
}

TEST_F(Drive, FramesAndAxesFollowRep103) {
  const auto messages = run.odometry.messages();
  for (const auto& message : messages) {
    EXPECT_EQ(message->header.frame_id, "odom");
    EXPECT_EQ(message->child_frame_id, "camera");
  }
  // Forward at the start is x; the orientation is that of an optical frame.
  const auto& early = *messages[std::min<std::size_t>(10, messages.size() - 1)];
  EXPECT_GT(early.pose.pose.position.x, 3 * std::abs(early.pose.pose.position.y));
  EXPECT_GT(early.pose.pose.position.x, 3 * std::abs(early.pose.pose.position.z));
  EXPECT_TRUE(fromMsg(early.pose.pose).linear().isApprox(bodyFromOptical(), 0.2));
  // The twist is in the camera's axes: forward is z.
  const auto& last = *messages.back();
  const std::size_t i = run.frameAt(last.header.stamp);
  const double seconds =
      1e-9 * static_cast<double>(run.drive.frame(i).stamp_ns - run.drive.frame(i - 1).stamp_ns);
  const double speed =
      (run.drive.frame(i).T_c0_c.translation() - run.drive.frame(i - 1).T_c0_c.translation())
          .norm() /
      seconds;
  EXPECT_NEAR(last.twist.twist.linear.z, speed, 0.15 * speed + 0.1);
}

TEST_F(Drive, CovarianceIsFilledAndGrows) {
  using Covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>;
  double before = 0;
  bool was_young = true;
  const auto messages = run.odometry.messages();
  for (const auto& message : messages) {
    const Covariance covariance(message->pose.covariance.data());
    ASSERT_TRUE(covariance.allFinite());
    EXPECT_EQ(covariance, covariance.transpose());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(covariance);
    EXPECT_GE(solver.eigenvalues().minCoeff(), -1e-12);
    const double trace = covariance.trace();
    if (!was_young) {
      EXPECT_GE(trace, before * (1 - 1e-9));
    }
    // Up to this length the scale becomes more certain, and with it the whole motion so far.
    was_young = message->pose.pose.position.x <
                MetricTrajectory::Options().young_map_heights * PlayedDrive::kCameraHeight;
    before = trace;
  }
  EXPECT_GT(before, 0);
  const Covariance twist(messages.back()->twist.covariance.data());
  EXPECT_GT(twist.trace(), 0);
}

TEST_F(Drive, TfEqualsTheOdometry) {
  const auto messages = run.odometry.messages();
  const auto tf_messages = run.tf.messages();
  ASSERT_EQ(tf_messages.size(), messages.size());
  for (std::size_t k = 0; k < messages.size(); ++k) {
    ASSERT_EQ(tf_messages[k]->transforms.size(), 1u);
    const geometry_msgs::TransformStamped& transform = tf_messages[k]->transforms[0];
    EXPECT_EQ(transform.header.frame_id, "odom");
    EXPECT_EQ(transform.child_frame_id, "camera");
    EXPECT_EQ(transform.header.stamp, messages[k]->header.stamp);
    EXPECT_EQ(transform.transform.translation.x, messages[k]->pose.pose.position.x);
    EXPECT_EQ(transform.transform.rotation.w, messages[k]->pose.pose.orientation.w);
  }
}

TEST_F(Drive, ThePathConsistsOfPosesOfTheOdometry) {
  ASSERT_TRUE(run.path.waitForCount(1));
  const auto odometry = run.odometry.messages();
  const auto path = run.path.messages().back();
  ASSERT_FALSE(path->poses.empty());
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

/// Whether a pixel below the legend has the red of an outlier or of a feature that was not found.
bool showsRejectedFeatures(const sensor_msgs::Image::ConstPtr& bgr8) {
  constexpr std::size_t kLegendRows = 70;
  for (std::size_t i = kLegendRows * bgr8->step; i + 2 < bgr8->data.size(); i += 3) {
    const int blue = bgr8->data[i], green = bgr8->data[i + 1], red = bgr8->data[i + 2];
    if (red > green + 80 && red > blue + 40) return true;
  }
  return false;
}

TEST_F(Drive, VisualisationTopicsArePublishedToSubscribers) {
  ASSERT_TRUE(run.path.waitForCount(1));
  EXPECT_GT(run.path.messages().back()->poses.size(), 10u);
  ASSERT_TRUE(run.tracks.waitForCount(run.drive.size() / 2));
  const auto image = run.tracks.messages().back();
  EXPECT_EQ(image->encoding, "bgr8");
  EXPECT_EQ(static_cast<int>(image->width), run.drive.camera().width);
  const auto all_tracks = run.tracks.messages();
  EXPECT_TRUE(std::any_of(all_tracks.begin(), all_tracks.end(), showsRejectedFeatures));
  ASSERT_TRUE(run.road.waitForCount(run.drive.size() / 2));
  const auto road = run.road.messages().back();
  EXPECT_EQ(road->encoding, "bgr8");
  EXPECT_EQ(static_cast<int>(road->width), run.drive.camera().width);
  const auto markers = run.plane.messages();
  ASSERT_FALSE(markers.empty());
  // The quad lies below the camera (y down).
  for (const auto& marker : markers) {
    if (marker->id != 0) continue;
    EXPECT_GT(marker->pose.position.y, 0.8);
    EXPECT_LT(marker->pose.position.y, 3.0);
  }
}

TEST_F(Drive, PointsAreInMetresAndThoseOfMonoVoInVoUnits) {
  const ros::Time last = run.header(run.drive.size() - 1).stamp;
  ASSERT_TRUE(run.points.waitForStamp(last));
  ASSERT_TRUE(run.vo_points.waitForStamp(last));
  const auto frame = run.frames.messages().back();
  std::vector<float> depths;  // [VO units]
  for (const TrackedFeature& feature : fromMsg(*frame).features) {
    if (feature.has_point) depths.push_back(feature.p_c.z());
  }
  ASSERT_GT(depths.size(), 50u);
  const auto metric = run.points.messages().back(), unscaled = run.vo_points.messages().back();
  const double scale = run.scales.messages().back()->scale;
  for (const auto& [cloud, unit] : {std::pair(metric, scale), {unscaled, 1.0}}) {
    ASSERT_EQ(cloud->width * cloud->height, depths.size());
    sensor_msgs::PointCloud2ConstIterator<float> z(*cloud, "z");
    for (const float depth : depths) {
      EXPECT_FLOAT_EQ(*z, static_cast<float>(unit) * depth);
      ++z;
    }
  }
}

TEST_F(Drive, GroundPointsAreInMetres) {
  ASSERT_TRUE(run.ground_points.waitForStamp(run.header(run.drive.size() - 1).stamp));
  const auto scales = run.scales.messages();
  std::vector<double> heights;
  for (const auto& cloud : run.ground_points.messages()) {
    if (cloud->data.empty()) continue;  // at a standstill
    const std::size_t i = run.frameAt(cloud->header.stamp);
    const auto& up = scales.at(i)->normal;
    const Eigen::Vector3d normal(up.x, up.y, up.z);
    const auto& offline = run.offline_ground_points.at(i);
    ASSERT_EQ(cloud->width, offline.size()) << i;
    sensor_msgs::PointCloud2ConstIterator<float> x(*cloud, "x");
    for (const Eigen::Vector3f& p_c : offline) {
      const Eigen::Vector3d p(x[0], x[1], x[2]);
      EXPECT_TRUE(p.isApprox(scales[i]->scale * p_c.cast<double>(), 1e-5)) << i;
      heights.push_back(normal.dot(p));
      ++x;
    }
  }
  ASSERT_GT(heights.size(), 500u);
  const auto median = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), median, heights.end());
  EXPECT_NEAR(*median, -PlayedDrive::kCameraHeight, 0.03 * PlayedDrive::kCameraHeight);
}

}  // namespace
}  // namespace ground_scale_vo
