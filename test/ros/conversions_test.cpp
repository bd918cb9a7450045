#include "ground_scale_vo/ros/conversions.hpp"

#include <tuple>

#include "input/camera_info.hpp"
#include "ros/ros_messages.hpp"
#include "support/scene.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

constexpr float kNanF = std::numeric_limits<float>::quiet_NaN();

TEST(Nanoseconds, HoldAllStampsExactly) {
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  for (const ros::Time& stamp : {ros::Time(0, 0), ros::Time(0, 1), ros::Time(2147483648u, 5),
                                 ros::Time(kMaxSeconds, 999999999)}) {
    EXPECT_EQ(fromNanoseconds(toNanoseconds(stamp)), stamp);
  }
  EXPECT_EQ(toNanoseconds(ros::Time(kMaxSeconds, 999999999)), 4294967295999999999);
}

/// A frame with random values that need the full precision of their types.
VoFrame someFrame() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  VoFrame frame;
  frame.stamp_ns = 1317617735123456789;
  frame.sequence = 17;
  frame.status = VoStatus::kTracking;
  frame.map_id = 3;
  frame.keyframe = true;
  frame.camera = {1241, 376, 718.856, 718.857, 607.1928, 185.2157, true, 0.004};
  frame.zoom = 1.2;
  frame.T_w_c = test::pose({0.3, -1.2, 2}, {normal(random), normal(random), normal(random)});
  const Matrix6d root = Matrix6d::NullaryExpr([&] { return normal(random); });
  frame.pose_covariance = root * root.transpose();
  frame.readout_motion << 0.001, 0.02, -0.003, 0.1, -0.01, 1 / 3.0;
  frame.map_start.stamp_ns = 1317617734123456789;
  frame.map_start.R_previous_w = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()).matrix();
  frame.map_start.rotation_sigma = 0.002;
  for (std::uint64_t id = 0; id < 50; ++id) {
    TrackedFeature feature;
    feature.id = (id << 33) + 5;
    feature.age = static_cast<std::uint32_t>(id);
    feature.u = Eigen::Vector2d(normal(random), normal(random)).cast<float>();
    feature.has_point = id % 3 != 0;
    if (feature.has_point) {
      feature.p_c = Eigen::Vector3d(normal(random), normal(random), 2 + 1 / 3.0).cast<float>();
      feature.depth_sigma = 1.f / 3.f;
    }
    frame.features.push_back(feature);
  }
  return frame;
}

VoFrameMsg message(const VoFrame& frame) {
  return *toMsg(frame, headerAt(fromNanoseconds(frame.stamp_ns)));
}

TEST(VoFrameMsg, RoundTripIsExact) {
  const VoFrame frame = someFrame();
  const VoFrameMsg msg = message(frame);
  const VoFrame back = fromMsg(msg);
  const auto values = [](const VoFrame& f) {
    return std::tuple(f.stamp_ns, f.sequence, f.status, f.map_id, f.keyframe, f.zoom,
                      f.camera.width, f.camera.height, f.camera.fx, f.camera.fy, f.camera.cx,
                      f.camera.cy, f.map_start.stamp_ns, f.map_start.rotation_sigma,
                      f.features.size());
  };
  EXPECT_EQ(values(back), values(frame));
  EXPECT_TRUE(isSameCamera(back.camera, frame.camera));
  EXPECT_EQ(back.T_w_c.translation(), frame.T_w_c.translation());
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-15);
  EXPECT_EQ(back.pose_covariance, frame.pose_covariance);
  EXPECT_EQ(back.readout_motion, frame.readout_motion);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-15);
  for (std::size_t i = 0; i < back.features.size(); ++i) {
    const TrackedFeature &a = frame.features[i], &b = back.features[i];
    EXPECT_EQ(std::tuple(b.id, b.age, b.has_point), std::tuple(a.id, a.age, a.has_point));
    EXPECT_TRUE(b.u == a.u && b.p_c == a.p_c && b.depth_sigma == a.depth_sigma);
    EXPECT_EQ(std::isnan(msg.x[i]) && std::isnan(msg.depth_sigma[i]), !a.has_point);
  }
}

TEST(VoFrameMsg, RefusesInvalidMessagesAndNamesFieldAndLimit) {
  const struct {
    std::function<void(VoFrameMsg*)> change;
    const char* reason;
  } kCases[] = {
      {[](VoFrameMsg* m) { m->age.pop_back(); }, "age has 49 elements, but id has 50"},
      {[](VoFrameMsg* m) { m->x.pop_back(); }, "x has 49 elements"},
      {[](VoFrameMsg* m) { m->depth_sigma.pop_back(); }, "depth_sigma has 49 elements"},
      {[](VoFrameMsg* m) { m->id[4] = m->id[3]; }, "the ids are not in ascending order"},
      {[](VoFrameMsg* m) { m->u[2] = kNanF; }, "pixel (nan, "},
      {[](VoFrameMsg* m) { m->v[2] = 2e9f; }, "2e+09), which is not finite or beyond 1e+09"},
      {[](VoFrameMsg* m) { m->fx = 0; }, "camera fx [px] is 0"},
      {[](VoFrameMsg* m) { m->k1_sigma = -1; }, "camera k1_sigma is -1"},
      {[](VoFrameMsg* m) { m->zoom = -1; }, "zoom is -1"},
      {[](VoFrameMsg* m) { m->zoom = kNanF; }, "zoom is nan"},
      {[](VoFrameMsg* m) { m->status = 3; }, "status is 3, it must lie in [0, 2]"},
      {[](VoFrameMsg* m) { m->pose.position.x = kInfinity; }, "the position (inf, "},
      {[](VoFrameMsg* m) { m->pose.orientation = geometry_msgs::Quaternion(); },
       "the quaternion (0, 0, 0, 0) of the pose is not of unit length"},
      {[](VoFrameMsg* m) { m->pose_covariance[7] = -1; }, "pose_covariance"},
      {[](VoFrameMsg* m) { m->pose_covariance[1] += 1; }, "pose_covariance"},
      {[](VoFrameMsg* m) { m->readout_motion[5] = kInfinity; }, "readout_motion"},
      {[](VoFrameMsg* m) { m->map_start_rotation.w = 3; }, "of map_start_rotation"},
      {[](VoFrameMsg* m) { m->map_start = m->header.stamp + ros::Duration(1); }, "map_start is"},
  };
  const VoFrameMsg good = message(someFrame());
  EXPECT_NO_THROW(fromMsg(good));
  for (const auto& refused : kCases) {
    VoFrameMsg msg = good;
    refused.change(&msg);
    expectThrows<DataError>([&] { fromMsg(msg); }, refused.reason);
  }
  VoFrameMsg lost = good;
  lost.status = VoFrameMsg::LOST;  // the pose is not used then
  lost.pose.position.x = lost.readout_motion[5] = 1e300;
  EXPECT_NO_THROW(fromMsg(lost));
}

TEST(VoFrameMsg, RoundsQuaternionsAndDropsUnusablePointsAndUnknownCovariances) {
  const VoFrame frame = someFrame();
  VoFrameMsg msg = message(frame);
  for (auto* q : {&msg.pose.orientation, &msg.map_start_rotation}) {
    for (double* element : {&q->x, &q->y, &q->z, &q->w}) *element *= 1.005;
  }
  for (const double unknown : {0.0, -1.0}) {
    msg.pose_covariance[0] = unknown;
    EXPECT_EQ(fromMsg(msg).pose_covariance, Matrix6d::Zero());
  }
  msg.z[1] = -2.f;  // behind the camera
  msg.depth_sigma[2] = std::numeric_limits<float>::infinity();
  msg.x[4] = 1e30f;  // implausibly far away
  const VoFrame back = fromMsg(msg);
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-12);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-12);
  for (const std::size_t i : {1, 2, 4}) EXPECT_FALSE(back.features[i].has_point) << i;
  EXPECT_TRUE(back.features[5].has_point);
}

TEST(VoFrameMsg, MapStartMayBeUnknown) {
  VoFrameMsg msg = message(someFrame());
  msg.map_start_rotation_sigma = 0;  // known, without an error
  EXPECT_EQ(fromMsg(msg).map_start.rotation_sigma, 0);
  msg.map_start_rotation = geometry_msgs::Quaternion();
  for (const double unknown : {-1.0, kNan, kInfinity, 0.0}) {
    // 0: an odometry that does not fill the fields. Otherwise also the first frame of the map.
    msg.map_start = unknown == 0 ? ros::Time() : msg.header.stamp;
    msg.map_start_rotation_sigma = unknown;
    const auto start = fromMsg(msg).map_start;
    EXPECT_EQ(start.stamp_ns, toNanoseconds(msg.map_start));
    EXPECT_EQ(start.R_previous_w, Eigen::Matrix3d::Identity());
    EXPECT_FALSE(std::isfinite(start.rotation_sigma));
  }
}

TEST(ScaleEstimateMsg, RoundTripIsExact) {
  ScaleEstimate scale;
  scale.status = ScaleStatus::kHeld;
  scale.measurement = MeasurementStatus::kPlaneTilted;
  scale.raw_scale = 1 / 3.0;
  scale.scale = 2 / 3.0;
  scale.sigma = 0.1;
  scale.height = 2.5;
  scale.source = ScaleSource::kBoth;
  scale.camera_height = 5 / 3.0;
  scale.camera_height_sigma = 0.01;
  scale.n_c = {0.1, -0.9, -0.2};
  scale.triangles = 5;
  scale.ground_triangles = 4;
  scale.ground_points = 3;
  scale.window_points = 2;
  scale.plane_inliers = 1;
  const ScaleEstimateMsg::Ptr msg = toMsg(scale, 8, std_msgs::Header());
  EXPECT_EQ(msg->map_id, 8u);
  const auto values = [](const ScaleEstimate& s) {
    return std::tuple(s.status, s.measurement, s.raw_scale, s.scale, s.sigma, s.height, s.source,
                      s.camera_height, s.camera_height_sigma, s.triangles, s.ground_triangles,
                      s.ground_points, s.window_points, s.plane_inliers);
  };
  EXPECT_EQ(values(fromMsg(*msg)), values(scale));
  EXPECT_EQ(fromMsg(*msg).n_c, scale.n_c);
  const std::pair<std::uint8_t ScaleEstimateMsg::*, const char*> kRefused[] = {
      {&ScaleEstimateMsg::source, "source is 11, it must lie in [0, 3]"},
      {&ScaleEstimateMsg::reason, "reason is 11, it must lie in [0, 9]"},
      {&ScaleEstimateMsg::status, "status is 11, it must lie in [0, 2]"}};
  for (const auto& [field, reason] : kRefused) {
    (*msg).*field = 11;
    expectThrows<DataError>([&] { fromMsg(*msg); }, reason);
  }
}

template <typename... Enumerators>
std::vector<int> codes(Enumerators... enumerators) {
  return {static_cast<int>(enumerators)...};
}

TEST(Messages, ConstantsAreTheEnumerators) {
  using Vo = VoFrameMsg;
  using Scale = ScaleEstimateMsg;
  using Reason = MeasurementStatus;
  EXPECT_EQ(codes(Vo::INITIALISING, Vo::TRACKING, Vo::LOST),
            codes(VoStatus::kInitialising, VoStatus::kTracking, VoStatus::kLost));
  EXPECT_EQ(codes(Scale::UNKNOWN, Scale::OK, Scale::HELD),
            codes(ScaleStatus::kUnknown, ScaleStatus::kOk, ScaleStatus::kHeld));
  EXPECT_EQ(
      codes(Scale::MEASURED, Scale::VO_NOT_TRACKING, Scale::STANDSTILL, Scale::TOO_FEW_TRIANGLES,
            Scale::TOO_FEW_GROUND_POINTS, Scale::NO_PLANE, Scale::PLANE_TILTED,
            Scale::REJECTED_BY_FILTER, Scale::IMPLAUSIBLE_MOTION, Scale::ZOOMED),
      codes(Reason::kMeasured, Reason::kVoNotTracking, Reason::kStandstill,
            Reason::kTooFewTriangles, Reason::kTooFewGroundPoints, Reason::kNoPlane,
            Reason::kPlaneTilted, Reason::kRejectedByFilter, Reason::kImplausibleMotion,
            Reason::kZoomed));
  EXPECT_EQ(codes(Scale::SOURCE_NONE, Scale::SOURCE_ROAD, Scale::SOURCE_SPEED, Scale::SOURCE_BOTH),
            codes(ScaleSource::kNone, ScaleSource::kRoad, ScaleSource::kSpeed, ScaleSource::kBoth));
}

TEST(CameraInfoMsg, CalibrationsAreTheSameInItWithAndWithoutRectification) {
  CameraCalibration camera{640, 480, 500, 510, 310, 230};
  camera.setDistortion("plumb_bob", {-0.2, 0.05, 0.001, -0.002, 0.01});
  const CameraInfo info = fromMsg(toCameraInfo(camera));
  EXPECT_EQ(readCameraInfo(info, "t", false).distortion, camera.distortion);
  for (const bool is_rectified : {false, true}) {
    const CameraCalibration read = readCameraInfo(info, "t", is_rectified);
    EXPECT_EQ(read.describe().substr(0, read.describe().find("cy")),
              camera.describe().substr(0, camera.describe().find("cy")));
    EXPECT_EQ(read.cy, camera.cy);
  }
}

TEST(CompressedImage, KeepsABayerPatternThatFitsItsPixelsAndItsFormatInAnError) {
  EXPECT_EQ(bayerPatternOf("bayer_rggb8; jpeg compressed "), "bayer_rggb8");
  EXPECT_EQ(bayerPatternOf("rgb8; jpeg compressed bgr8"), "");
  cv::Mat red(6, 8, CV_8UC1, cv::Scalar(0));  // a red surface in this pattern
  for (int row = 0; row < red.rows; row += 2) {
    for (int col = 0; col < red.cols; col += 2) red.at<std::uint8_t>(row, col) = 200;
  }
  EXPECT_NE(cv::norm(GreyConverter().convert(red, "bayer_rggb8"), red), 0);
  EXPECT_EQ(cv::norm(GreyConverter().convert(red, "bayer_rggb16"), red), 0);
  // One that cannot be decoded is refused with its format.
  sensor_msgs::CompressedImage image;
  image.format = "mono8; jpeg compressed ";
  expectThrows<DataError>([&] { decode(image); },
                          "the compressed image (format \"mono8; jpeg compressed \", 0 bytes) ");
}

}  // namespace
}  // namespace gsv
