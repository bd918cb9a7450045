// Level and message of the scale's diagnostics, what the log prints, and what is said about
// the mounting and the camera height.

#include "ros/diagnostics.hpp"

#include "common/text.hpp"
#include "common/time.hpp"
#include "ros/odometry_output.hpp"
#include "scale/road.hpp"
#include "support/learned_height.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Level = DiagnosticStatus;

TEST(Summary, OfTheScale) {
  const struct {
    ScaleStatus status;
    MeasurementStatus reason;
    double held_s;
    const char* missing_image;
    std::int8_t level;
    std::string message;
  } kCases[] = {
      {ScaleStatus::kOk, MeasurementStatus::kMeasured, 0, "", Level::OK, "scale measured"},
      {ScaleStatus::kOk, MeasurementStatus::kMeasured, 0, "no publisher on /image", Level::WARN,
       "scale measured from features only, no publisher on /image"},
      {ScaleStatus::kUnknown, MeasurementStatus::kMeasured, 0, "", Level::WARN,
       "scale not known yet"},
      {ScaleStatus::kUnknown, MeasurementStatus::kNoPlane, 0, "", Level::WARN,
       "scale not known yet: no_plane"},
      // Holding the scale briefly or at standstill is normal.
      {ScaleStatus::kHeld, MeasurementStatus::kNoPlane, 0.84, "", Level::OK,
       "scale held for 0.8 s: no_plane"},
      {ScaleStatus::kHeld, MeasurementStatus::kNoPlane, 3.1, "", Level::WARN,
       "scale held for 3.1 s: no_plane"},
      {ScaleStatus::kHeld, MeasurementStatus::kStandstill, 3.1, "", Level::OK,
       "scale held: standstill"},
      {ScaleStatus::kHeld, MeasurementStatus::kVoNotTracking, 0, "", Level::WARN,
       "scale held for 0.0 s: vo_not_tracking"}};
  for (const auto& one : kCases) {
    ScaleEstimate scale;
    scale.status = one.status;
    scale.measurement = one.reason;
    EXPECT_EQ(summarize(scale, one.held_s, one.missing_image).level, one.level) << one.message;
    EXPECT_EQ(summarize(scale, one.held_s, one.missing_image).message, one.message);
  }
}

TEST(WarningLog, CountsAllAndPrintsTheFirstOfEachPeriod) {
  WarningLog log("nodelet");
  EXPECT_TRUE(log.drop("image size", "too small"));
  EXPECT_TRUE(log.drop("image stamp", "late"));
  EXPECT_TRUE(log.drop("camera_info refused", "zeros"));
  EXPECT_FALSE(log.drop("image size", "too small"));
  EXPECT_EQ(log.dropped().at("image size"), 2u);
  EXPECT_EQ(log.dropped("image "), 3u);
  const Stopwatch watch;
  const std::chrono::milliseconds period(300);
  EXPECT_TRUE(log.warn("other", "of messages that are used", period));
  // A warning with every image does not postpone the next print.
  while (!log.warn("other", "of messages that are used", period)) ASSERT_LT(watch.seconds(), 30);
  EXPECT_GE(watch.seconds(), 0.3);
  EXPECT_EQ(log.dropped().count("other"), 0u);
}

constexpr double kDegree = M_PI / 180;

/// An estimate with these angles [deg].
ScaleRecovery::Output estimate(double pitch, double roll, double sigma) {
  ScaleRecovery::Output output;
  output.mounting_pitch = pitch * kDegree;
  output.mounting_roll = roll * kDegree;
  output.mounting_sigma = sigma * kDegree;
  return output;
}

/// A camera with this up in its axes on tf.
TfFrames onTf(const Eigen::Vector3d& up_c) {
  TfFrames frames{"odom", "base_link"};
  frames.T_c_b.linear() =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), up_c).toRotationMatrix();
  return frames;
}

/// Pitch and roll [deg].
struct Angles {
  double pitch, roll;
  std::string text() const { return format("pitch %.1f deg and roll %.1f deg", pitch, roll); }
};

/// The sentence for an estimate with this standard deviation [deg]; on_tf: the transform has these
/// angles.
std::string check(const std::optional<Angles>& on_tf, const Angles& measured, double sigma) {
  std::optional<TfFrames> frames;
  if (on_tf) frames = onTf(roadNormal(on_tf->pitch * kDegree, on_tf->roll * kDegree));
  return mountingWarning(estimate(measured.pitch, measured.roll, sigma), std::nullopt,
                         frames ? &*frames : nullptr, "camera");
}

TEST(MountingCheck, NamesAMountingThatIsNotSupportedOrContradictsTf) {
  enum Fault { kNone, kOfRoad, kOfTf, kContradiction };
  const double unknown = Mounting({}).sigma() / kDegree;  // as constructed: the pitch is zero
  const struct {
    std::optional<Angles> on_tf;
    Angles measured;
    double sigma;
    Fault fault;
  } kCases[] = {{{}, {1.8, -19.3}, 0.3, kOfRoad},
                {{}, {25, 0}, 0.3, kOfRoad},
                {{}, {-25, 0}, 0.3, kOfRoad},
                // At the limits the estimate may be beyond them.
                {{}, {21.9, -16.9}, 0.1, kNone},
                {{}, {0, 18}, 0.4, kNone},
                {{}, {0, 25}, 0.6, kNone},
                {{{0, 40}}, {1, -10}, 1.5, kOfTf},
                {{{0, 0}}, {8, 0.02}, 0.1, kContradiction},
                {{{-2, 5}}, {3, -6}, 0.1, kContradiction},
                // The deviation may be due to the uncertainty.
                {{{0, 0}}, {4, 0}, 0.1, kContradiction},
                {{{0, 0}}, {4, 0}, 0.4, kNone},
                {{{20, 15}}, {0, 0}, unknown, kNone}};
  const std::string limits =
      ", but at most 20 deg of pitch and 15 deg of roll are supported: distances may be wrong; "
      "mount the camera upright or rotate its images";
  for (const auto& c : kCases) {
    const std::string warning = check(c.on_tf, c.measured, c.sigma);
    std::string expected;
    if (c.fault == kOfRoad) expected = "on the road the camera has " + c.measured.text() + limits;
    if (c.fault > kOfRoad) {
      expected = "tf mounts the camera \"camera\" on \"base_link\" with " + c.on_tf->text();
      expected += c.fault == kOfTf ? limits : ", but on the road it has " + c.measured.text();
    }
    if (c.fault == kContradiction) expected += ": the path climbs or sinks by up to ";
    EXPECT_EQ(warning.substr(0, std::max<std::size_t>(expected.size(), 1)), expected) << warning;
  }
  EXPECT_NE(check({{0, 0}}, {8, 0.02}, 0.1).find(" by up to 8.0 deg"), std::string::npos);
  for (const double tilt : {-2.0, 0.0, 2.0}) {  // of a vehicle that rides so
    for (const double pitch : {-3.0, 0.0, 20.0}) {
      EXPECT_EQ(check({{pitch, 0}}, {pitch + tilt, 0}, 0.1), "");
      EXPECT_EQ(check({{pitch, 10}}, {pitch, 10 + tilt}, 0.1), "");
    }
  }
  // A base that is upside down or optical.
  for (const Eigen::Vector3d& up_c : {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, 0, 1)}) {
    const TfFrames frames = onTf(up_c);
    EXPECT_NE(mountingWarning({}, std::nullopt, &frames, "camera"), "") << up_c.transpose();
  }
}

VoFrame frameAt(const Eigen::Quaterniond& R_w_c) {
  VoFrame frame;
  frame.status = VoStatus::kTracking;
  frame.T_w_c.linear() = R_w_c.toRotationMatrix();
  return frame;
}

/// After a curve to the left and one to the right, of 40 degrees each, over a crest, with a
/// suspension that vibrates. roll: of the camera [deg].
std::optional<Eigen::Vector3d> turnAxis(double roll, int frames = 80) {
  TurnAxis axis;
  for (int i = 0; i < frames; ++i) {
    const double yaw = (i < 40 ? i : 80 - i) * kDegree, pitch = (0.05 * i + i % 2) * kDegree;
    axis.add(frameAt(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()) *
                     Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()) *
                     Eigen::AngleAxisd(roll * kDegree, Eigen::Vector3d::UnitZ())));
  }
  return axis.upward();
}

TEST(MountingCheck, NamesAMountingThatTurnsShow) {
  const ScaleRecovery::Output wrong = estimate(0, -3, 0.2);  // of a facade
  EXPECT_FALSE(turnAxis(0, 20));
  const auto warning = [&](double roll) {
    return mountingWarning(wrong, turnAxis(roll), nullptr, "camera");
  };
  for (const double roll : {-15, 0, 15}) EXPECT_EQ(warning(roll), "");
  for (const double roll : {-90, -40, 40, 90}) {
    EXPECT_EQ(warning(roll).find("in turns the camera has pitch "), 0u);
    EXPECT_NEAR(std::abs(rollOf(*turnAxis(roll))), std::abs(roll) * kDegree, 8 * kDegree);
  }
}

TEST(TurnAxis, ANewMapIsNoTurn) {
  TurnAxis axis;
  for (int i = 0; i < 20; ++i) {
    VoFrame frame = frameAt(Eigen::Quaterniond(Eigen::AngleAxisd(i, Eigen::Vector3d::UnitX())));
    frame.continuity = Continuity::kNewMap;
    axis.add(frame);
  }
  EXPECT_FALSE(axis.upward());
}

TEST(CameraHeight, IsSavedAsCalibrateHeightWritesItOnceSpeedsHaveTaughtIt) {
  ScaleRecovery::Output measured = estimate(2, -1, 0.1);
  measured.scale = learned(1.65, 0.01);
  EXPECT_EQ(learnedHeightYaml(measured, 0),
            "# From the speeds of the vehicle.\n"
            "camera_height: 1.6500  # [m] ± 0.0219 (95 %), 1.33 %\n"
            "# The mounting of the camera, for tf; the scale does not need it.\n"
            "# pitch: 2.00 ± 0.20 (95 %) deg, positive looks down\n"
            "# roll: -1.00 ± 0.20 (95 %) deg, positive: the right of the camera is lower\n"
            "# A base_link on the road below the camera that faces as the camera does, with yaw, "
            "pitch and roll:\n"
            "# rosrun tf2_ros static_transform_publisher 0 0 1.650 -1.57019 -0.01745 -1.60570 "
            "base_link CAMERA_FRAME\n");
  EXPECT_NO_THROW(learnedHeightYaml(measured, 0.02));
  const struct {
    ScaleEstimate scale;
    double given_sigma;
    const char* reason;
  } kRefused[] = {{{}, 0, "not known yet"},
                  {learned(1.65, 0), 0, "camera_height_sigma is 0"},
                  {learned(1.65, 0.1), 0, "its error is 11.9 % (95 %)"},
                  {learned(1.65, 0.019), 0.02, "speeds have not determined it yet"}};
  for (const auto& c : kRefused) {
    measured.scale = c.scale;
    expectThrows<DataError>([&] { learnedHeightYaml(measured, c.given_sigma); }, c.reason);
  }
}

}  // namespace
}  // namespace gsv
