// ScaleRecovery fed by another odometry: a camera 1 VO unit above a flat road, with exact points.
// The mounting comes from tf; the camera changes; messages are malformed.
// A second ScaleRecovery in the namespace `alone` gets the same frames with `refine: false` (no
// images). The difference of the two outputs is the effect of the images.

#include <tf2_ros/static_transform_broadcaster.h>

#include "nodelet_pair.hpp"
#include "support/road_image.hpp"

namespace gsv {
namespace {

constexpr double kCameraHeight = 1.65;                      // [m] for 1 VO unit
constexpr double kStep = 0.5;                               // [VO units] per frame
constexpr double kPeriod = 0.1;                             // [s]
constexpr double kSpeed = kCameraHeight * kStep / kPeriod;  // [m/s]
/// [VO units] height of the camera above the road in the images. In the points it is 1, so the
/// scale shows whether the images are used.
constexpr double kImageHeight = 1.02;

/// The simulated odometry.
class FlatRoad {
 public:
  explicit FlatRoad(double start_s) : start_s_(start_s) {
    scene_.height = 1;
    scene_.pitch = 0;
    scene_.addPatch(6000, -4, 4, 0, 160, 0, 1);
  }

  const PinholeCamera& camera() const { return scene_.camera; }

  /// The image of the frame that next() will return.
  sensor_msgs::Image::Ptr nextImage() const {
    RoadScene imaged = scene_;
    imaged.height = kImageHeight;
    return toMsg(roadImage(imaged, z_ + kStep), "mono8", header());
  }

  /// Stamp of the frame that next() returned last.
  ros::Time lastStamp() const { return ros::Time(start_s_ + kPeriod * (sequence_ - 1.0)); }
  /// The next frame of the odometry.
  VoFrameMsg::Ptr next() {
    if (is_moving) z_ += kStep;
    VoFrame frame = scene_.frameAt(sequence_, z_);
    if (!has_features) frame.features.clear();
    const std_msgs::Header stamped = header();
    ++sequence_;
    return toMsg(frame, stamped);
  }

  bool is_moving = true, has_features = true;

 private:
  std_msgs::Header header() const { return headerAt(ros::Time(start_s_ + kPeriod * sequence_)); }

  RoadScene scene_;
  double start_s_;
  std::uint32_t sequence_ = 0;
  double z_ = -kStep;  ///< of the last frame [VO units]
};

class Scale : public testing::Test {
 protected:
  static constexpr int kFrames = 40;

  void SetUp() override {
    ASSERT_TRUE(reset());
    ASSERT_TRUE(reset("alone/scale_recovery/reset"));
    ASSERT_TRUE(waitUntil([this] {  // frames: also this test
      return frames_.getNumSubscribers() > 1 && images_.getNumSubscribers() > 0 &&
             masks_.getNumSubscribers() > 0 && out_.scales.connected() &&
             out_.odometry.connected() && alone_.scales.connected() &&
             alone_.odometry.connected() && diagnostics_.connected();
    }));
    out_.clear();
    alone_.clear();
  }
  /// Waits for the reset service, i.e. until the nodelet is loaded, and calls it. The number of
  /// subscribers does not show that: roscpp has one connection per topic and process, and the other
  /// nodelet may hold it.
  static bool reset(const std::string& service = "scale_recovery/reset") {
    return ros::service::waitForService(service, static_cast<std::int32_t>(1000 * kTimeout)) &&
           callTrigger(service);
  }
  bool play(FlatRoad& road, int frames) {
    for (int i = 0; i < frames; ++i) frames_.publish(road.next());
    return out_.scales.waitForStamp(road.lastStamp());
  }
  /// Plays kFrames frames, each after its image.
  bool playWithImages(FlatRoad& road, const std::string& encoding = "mono8") {
    for (int i = 0; i < kFrames; ++i) {
      const sensor_msgs::Image::Ptr image = road.nextImage();
      image->encoding = encoding;
      images_.publish(image);
      frames_.publish(road.next());
      // The first one is held until the next frame confirms the jump of the clock.
      if (i > 0 && !out_.scales.waitForStamp(road.lastStamp())) return false;
    }
    return alone_.scales.waitForStamp(road.lastStamp());
  }
  static void publishMounting() {
    static tf2_ros::StaticTransformBroadcaster broadcaster;
    geometry_msgs::TransformStamped second = mounting("base_link", {1.5, 2, 1.4});
    second.child_frame_id = "camera2";
    broadcaster.sendTransform({mounting("base_link", {1.5, 0, 1.4}), second});
  }
  /// Publishes frames until the first `odometry`, i.e. until the nodelet has received the mounting
  /// transform.
  bool playUntilOdometry(FlatRoad& road) {
    publishMounting();
    return waitUntil([&] {
             frames_.publish(road.next());
             return out_.odometry.count() > 0;
           }) &&
           // The next test must not receive the results of these frames.
           out_.odometry.waitForStamp(road.lastStamp());
  }

  ros::NodeHandle handle_;
  ros::Publisher frames_ = handle_.advertise<VoFrameMsg>("vo/frame", 100);
  ros::Publisher images_ = handle_.advertise<sensor_msgs::Image>("vo/image", 100);
  ros::Publisher masks_ = handle_.advertise<sensor_msgs::Image>("vo/mask", 100);
  NodeletTopics out_{""}, alone_{"/alone"};
  DiagnosticsRecorder diagnostics_{handle_};
};

// `alone` publishes the pose of the camera, and with publish_tf false nothing on tf.
TEST_F(Scale, AnotherCameraFrameResets) {
  TopicRecorder<tf2_msgs::TFMessage> tf(handle_, "/tf");
  ASSERT_TRUE(waitUntil([&] { return tf.connected(); }));
  FlatRoad road(2600);
  ASSERT_TRUE(playUntilOdometry(road));
  ASSERT_TRUE(play(road, kFrames));
  for (NodeletTopics* outputs : {&alone_, &out_}) {
    ASSERT_TRUE(outputs->scales.waitForStamp(road.lastStamp()));
    ASSERT_TRUE(outputs->odometry.waitForStamp(road.lastStamp()));
    outputs->clear();
  }
  const auto publishFrom = [&](const std::string& camera_frame) {
    const VoFrameMsg::Ptr frame = road.next();
    frame->header.frame_id = camera_frame;
    frames_.publish(frame);
  };
  for (int i = 0; i < kFrames; ++i) publishFrom("camera2");
  for (NodeletTopics* outputs : {&alone_, &out_}) {
    const bool is_base = outputs == &out_;
    ASSERT_TRUE(outputs->odometry.waitForStamp(road.lastStamp()));
    EXPECT_EQ(outputs->scales.first()->status, ScaleEstimateMsg::UNKNOWN);
    const auto& first = *outputs->odometry.first();
    const auto& last = *outputs->odometry.last();
    EXPECT_EQ(first.child_frame_id, is_base ? "base_link" : "camera2");
    const auto& origin = first.pose.pose.position;
    EXPECT_NEAR(std::hypot(origin.x, origin.y, origin.z), 0, 1e-12);
    const double metres = kSpeed * (last.header.stamp - first.header.stamp).toSec();
    EXPECT_GT(metres, 10);
    EXPECT_NEAR(last.pose.pose.position.x, metres, 0.02 * metres);
    // The other mounting is no motion of the base.
    const geometry_msgs::Vector3& velocity = last.twist.twist.linear;
    EXPECT_NEAR(is_base ? velocity.x : velocity.z, kSpeed, 0.2);
    EXPECT_NEAR(velocity.y, 0, 0.1);
    EXPECT_NEAR(is_base ? velocity.z : velocity.x, 0, 0.1);
  }
  EXPECT_GT(tf.count(), 0u);
  for (const auto& message : tf.messages()) {
    EXPECT_EQ(message->transforms.at(0).child_frame_id, "base_link");
  }

  // An empty frame_id is an error of its frame only.
  publishFrom("");
  EXPECT_TRUE(diagnostics_.waitForSummary("scale_recovery", Status::ERROR,
                                          "frame_id of the images is empty"));
  for (int i = 0; i < 2; ++i) publishFrom("camera2");
  EXPECT_TRUE(diagnostics_.waitForStatus(
      "scale_recovery", [](const Status& status) { return status.level < Status::ERROR; }));
}

TEST_F(Scale, TheTimeForWhichTheScaleIsHeldWhileDrivingIsReported) {
  FlatRoad road(3500);
  ASSERT_TRUE(playUntilOdometry(road));
  ASSERT_TRUE(play(road, kFrames));
  road.is_moving = false;
  ASSERT_TRUE(play(road, kFrames));
  road.is_moving = true;
  road.has_features = false;
  ASSERT_TRUE(play(road, kFrames));
  EXPECT_EQ(out_.scales.last()->status, ScaleEstimateMsg::HELD);
  // From the first of the frames without features to the last.
  EXPECT_TRUE(diagnostics_.waitForSummary("scale_recovery", Status::WARN,
                                          "scale held for 3.9 s: too_few_triangles"));
}

// The camera rolls, as one that is mounted on its side does in turns.
TEST_F(Scale, ResetForgetsTheTurns) {
  FlatRoad road(4500);
  ASSERT_TRUE(playUntilOdometry(road));
  for (int i = 0; i < kFrames; ++i) {
    const VoFrameMsg::Ptr frame = road.next();
    const double half = 0.03 * i;
    frame->pose.orientation.z = std::sin(half);
    frame->pose.orientation.w = std::cos(half);
    frames_.publish(frame);
  }
  const auto warns = [](const Status& status) {
    return status.message.find("in turns the camera has ") != std::string::npos;
  };
  EXPECT_TRUE(diagnostics_.waitForStatus("scale_recovery", warns, false));
  ASSERT_TRUE(reset());
  ASSERT_TRUE(play(road, kFrames));
  EXPECT_FALSE(warns(diagnostics_.next("scale_recovery")));
}

TEST_F(Scale, MalformedMessagesAreDroppedAndAnUncountedSequenceIsReported) {
  FlatRoad road(6000);
  const auto missing = [&] {
    return numberIn(diagnostics_.next("scale_recovery"), "frames dropped, queue full");
  };
  ASSERT_TRUE(play(road, kFrames));
  const double missing_before = missing();
  diagnostics_.clear();
  VoFrameMsg::Ptr malformed = road.next();
  malformed->z.pop_back();
  frames_.publish(malformed);
  malformed = road.next();
  malformed->pose.position.x = std::numeric_limits<double>::quiet_NaN();
  frames_.publish(malformed);
  const VoFrameMsg::Ptr repeated = road.next();
  frames_.publish(repeated);
  frames_.publish(repeated);
  ASSERT_TRUE(play(road, 1));
  EXPECT_EQ(out_.scales.count(), static_cast<std::size_t>(kFrames) + 2);
  for (int i = 0; i < 3; ++i) road.next();  // not received
  ASSERT_TRUE(play(road, 1));
  EXPECT_EQ(missing() - missing_before, 3);
  EXPECT_NE(out_.scales.last()->status, ScaleEstimateMsg::UNKNOWN);
  EXPECT_TRUE(diagnostics_.waitForStatus(
      "scale_recovery",
      [](const Status& status) {
        return status.message.find("frames dropped in the last second") != std::string::npos;
      },
      false));
  EXPECT_TRUE(diagnostics_.waitForStatus(
      "scale_recovery", [](const Status& status) { return status.level == Status::OK; }));

  // The field is left at its default by an odometry that does not count its images.
  for (int i = 0; i < kFrames; ++i) {
    const VoFrameMsg::Ptr frame = road.next();
    frame->sequence = 0;
    frames_.publish(frame);
  }
  ASSERT_TRUE(out_.scales.waitForStamp(road.lastStamp()));
  EXPECT_EQ(out_.scales.last()->status, ScaleEstimateMsg::OK);
  EXPECT_TRUE(diagnostics_.waitForSummary("scale_recovery", Status::WARN,
                                          "sequence of vo/frame is 0 after 0: "));
}

// All images come before the frames: an odometry may be late by the frames that its queue holds.
TEST_F(Scale, ImagesAreUsedWhereTheMaskAllowsAndTheirLossIsReported) {
  FlatRoad road(7000);
  // Black from here on: no pixel may be used.
  const cv::Mat black(road.camera().height, road.camera().width, CV_8U, cv::Scalar(0));
  masks_.publish(toMsg(black, "mono8", road.nextImage()->header));
  ASSERT_TRUE(playWithImages(road));
  const auto scales = out_.scales.messages(), without_images = alone_.scales.messages();
  ASSERT_EQ(scales.size(), without_images.size());
  for (std::size_t i = 0; i < scales.size(); ++i) {
    EXPECT_EQ(scales[i]->scale, without_images[i]->scale) << i;
  }

  masks_.publish(toMsg(~black, "mono8", road.nextImage()->header));
  const auto withoutImage = [&] {
    return numberIn(diagnostics_.next("scale_recovery"), "frames without an image");
  };
  const double before = withoutImage();
  FlatRoad ahead = road;
  for (int i = 0; i < kFrames; ++i) {
    images_.publish(ahead.nextImage());
    ahead.next();
  }
  diagnostics_.clear();
  ASSERT_TRUE(play(road, kFrames));
  ASSERT_TRUE(alone_.scales.waitForStamp(road.lastStamp()));
  EXPECT_TRUE(diagnostics_.waitForValues("scale_recovery", {{"images", "used"}}));
  EXPECT_EQ(withoutImage(), before);
  // `alone` does not use the images, nor does it miss them.
  EXPECT_TRUE(diagnostics_.waitForStatus("alone/scale_recovery", [](const Status& status) {
    return status.message == "scale measured" && valueIn(status, "images") == "not used";
  }));
  EXPECT_NEAR(alone_.scales.last()->scale, kCameraHeight, 0.002 * kCameraHeight);
  EXPECT_LT(out_.scales.last()->scale, 0.995 * alone_.scales.last()->scale);
  EXPECT_GT(out_.scales.last()->scale, 0.995 * kCameraHeight / kImageHeight);

  // A frame that waits for its image is processed before a reset. `alone` does not wait: both
  // nodelets have received the frame then.
  frames_.publish(road.next());
  ASSERT_TRUE(alone_.scales.waitForStamp(road.lastStamp()));
  ASSERT_TRUE(reset());
  ASSERT_TRUE(out_.scales.waitForStamp(road.lastStamp()));
  EXPECT_NE(out_.scales.last()->status, ScaleEstimateMsg::UNKNOWN);

  diagnostics_.clear();
  ASSERT_TRUE(playWithImages(road, "nonsense"));
  EXPECT_TRUE(diagnostics_.waitForSummary(
      "scale_recovery", Status::WARN,
      "scale measured from features only, no image of the last frame", false));
  EXPECT_TRUE(diagnostics_.waitForStatus("scale_recovery", [](const Status& status) {
    return numberIn(status, "dropped: image refused") >= kFrames;
  }));
}

}  // namespace
}  // namespace gsv
