// Which image belongs to a frame, what the frame continues, and which messages are speeds.

#include "ros/scale_input.hpp"

#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <std_msgs/Float32.h>
#include <std_msgs/Float64.h>
#include <std_msgs/String.h>

#include <chrono>

#include "support/test.hpp"

namespace gsv {
namespace {

using Synchronizer = FrameImageSynchronizer<int, std::shared_ptr<int>>;

/// Frames and images are identified by their stamps.
class FrameImageSynchronization : public testing::Test {
 protected:
  void images(const std::vector<int>& stamps) {
    for (const int stamp : stamps) synchronizer_.addImage(stamp, std::make_shared<int>(stamp));
  }
  void frames(const std::vector<int>& stamps) {
    for (const int stamp : stamps) synchronizer_.addFrame(stamp, stamp, now_);
  }
  /// All frames returned now: "7 " for a frame with its image, "7- " for one without.
  std::string matches(bool may_wait = true) {
    std::string text;
    while (const auto match = synchronizer_.next(now_, may_wait)) {
      const auto& [frame, image] = *match;
      if (image) {
        EXPECT_EQ(*image, frame);
      }
      text += std::to_string(frame) + (image ? " " : "- ");
    }
    return text;
  }

  Synchronizer synchronizer_{5};
  Synchronizer::Clock::time_point now_;
};

TEST_F(FrameImageSynchronization, FramesWaitInOrderForTheirImagesOnceOneHasArrived) {
  frames({1, 2});
  EXPECT_EQ(matches(), "1- 2- ") << "no image ever arrived";
  images({3});
  frames({3, 4, 5, 6});
  EXPECT_EQ(matches(), "3 ");
  images({4});
  EXPECT_EQ(matches(), "4 ");
  images({6});
  EXPECT_EQ(matches(), "5- 6 ") << "a later image arrived";
  frames({7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17});
  EXPECT_EQ(matches(), "7- ") << "too many wait";
}

TEST_F(FrameImageSynchronization, StopsWaitingAfterATimeoutUntilImagesArriveAgain) {
  images({1});
  frames({1, 2});
  EXPECT_EQ(matches(), "1 ");
  now_ += std::chrono::milliseconds(499);
  frames({3});
  EXPECT_EQ(matches(), "");
  now_ += std::chrono::milliseconds(1);
  EXPECT_EQ(matches(), "2- 3- ");
  frames({4});
  EXPECT_EQ(matches(), "4- ");
  images({4});  // late
  frames({5});
  EXPECT_EQ(matches(), "");
  images({5});
  EXPECT_EQ(matches(), "5 ");
}

TEST_F(FrameImageSynchronization, StoresABoundedNumberOfImagesAndReleasesThoseOfPastFrames) {
  images({1, 2, 3, 4, 5});
  const auto image = std::make_shared<int>(6);
  synchronizer_.addImage(6, image);
  images({7});
  frames({2, 3});
  EXPECT_EQ(matches(), "2- 3 ");
  EXPECT_EQ(image.use_count(), 2);
  frames({7});
  EXPECT_EQ(matches(), "7 ");
  EXPECT_EQ(image.use_count(), 1);
}

TEST_F(FrameImageSynchronization, MatchesOnBothSidesOfAClockJump) {
  // A looped bag, whose images overtake its frames.
  images({98, 99, 1, 2});
  frames({98, 99});
  EXPECT_EQ(matches(), "98 99 ");
  synchronizer_.jumpBack(1);
  frames({1, 2});
  EXPECT_EQ(matches(), "1 2 ");
  // A player goes back by a few images: the image from after the jump counts.
  images({3, 4});
  const auto again = std::make_shared<int>(3);
  synchronizer_.addImage(3, again);
  synchronizer_.jumpBack(3);
  frames({3});
  const auto match = synchronizer_.next(now_);
  ASSERT_TRUE(match);
  EXPECT_EQ(match->second, again);
}

TEST_F(FrameImageSynchronization, AClockJumpDropsTheImagesBeforeIt) {
  images({98, 99});
  frames({97, 98, 100});
  EXPECT_EQ(matches(), "97- 98 ");
  EXPECT_EQ(matches(false), "100- ");
  images({101});
  synchronizer_.jumpBack(1);
  frames({1});  // waits: image 101, from before the jump, must not count as a later one
  EXPECT_EQ(matches(), "");
  images({1});
  EXPECT_EQ(matches(), "1 ");
}

TEST(FrameContinuity, CountsMissingFramesAndReportsNumbersThatCountNothing) {
  FrameContinuity continuity;
  const std::string error = "sequence of vo/frame is ";
  // 0 is a restart; twice, another one before the second image.
  const std::pair<std::uint32_t, std::string> kFrames[] = {
      {3, ""},
      {4, ""},
      {7, ""},
      {0, ""},
      {0, ""},
      {0, error + "0 after 0: "},
      {4000000000, error + "4000000000 after 0: "},
      {0, ""}};
  for (const auto& [sequence, expected] : kFrames) {
    continuity.receive(sequence);
    EXPECT_EQ(continuity.sequenceError().find(expected), 0u) << continuity.sequenceError();
    EXPECT_EQ(continuity.sequenceError().empty(), expected.empty()) << sequence;
  }
  EXPECT_EQ(continuity.missing(), 2u);
}

/// Applies the numbering to a frame whose rotation to the map has a sigma of 0.01 rad.
VoFrame numbered(FrameContinuity* continuity, std::uint32_t sequence, std::uint32_t map_id) {
  VoFrame frame;
  frame.sequence = sequence;
  frame.map_id = map_id;
  frame.map_start.rotation_sigma = 0.01;
  EXPECT_EQ(continuity->next(frame, "", false), "");
  return frame;
}

// The first map after a restart relates to its first image, not to the last pose before it.
TEST(FrameContinuity, ARestartedOdometryHasNewMapsOfUnknownRotation) {
  const struct {
    std::uint32_t sequence, map_id, numbered_map_id;
    double rotation_sigma;
  } kFrames[] = {
      {0, 0, 0, 0.01},      {1, 0, 0, 0.01},      {5, 2, 2, 0.01}, {0, 0, 3, kInfinity},
      {1, 0, 3, kInfinity}, {2, 1, 4, 0.01},      {2, 1, 4, 0.01}, {0, 0, 5, kInfinity},
      {7, 3, 8, 0.01},      {5, 2, 11, kInfinity}};  // its maps 0 and 1 were not received
  FrameContinuity continuity;
  for (const auto& frame : kFrames) {
    const VoFrame result = numbered(&continuity, frame.sequence, frame.map_id);
    EXPECT_EQ(result.map_id, frame.numbered_map_id);
    EXPECT_EQ(result.map_start.rotation_sigma, frame.rotation_sigma) << result.map_id;
  }
  // A trajectory that starts there, or at a restart, keeps the rotation.
  for (const std::uint32_t sequence : {6u, 0u, 1u}) {
    if (sequence != 1u) continuity.startTrajectory();
    EXPECT_EQ(numbered(&continuity, sequence, 2).map_start.rotation_sigma, 0.01) << sequence;
  }
}

/// The message as a subscriber that does not know its type receives it.
template <typename Message>
topic_tools::ShapeShifter received(const Message& message, const std::string& md5 = {}) {
  namespace traits = ros::message_traits;
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(out, message);
  topic_tools::ShapeShifter shape;
  shape.morph(md5.empty() ? traits::md5sum<Message>() : md5, traits::datatype<Message>(), "", "");
  ros::serialization::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  shape.read(in);
  return shape;
}

geometry_msgs::TwistStamped twistStamped(double x, double y = 0, double z = 0) {
  geometry_msgs::TwistStamped message;
  message.header.stamp = ros::Time(3, 4);
  message.twist.linear.x = x;
  message.twist.linear.y = y;
  message.twist.linear.z = z;
  return message;
}
/// Of a vehicle whose velocity is along x so far.
template <typename Message>
SpeedSample read(const Message& message, const std::string& md5 = {},
                 const std::string& unit = {}) {
  return SpeedReader(unit).read(received(message, md5), ros::Time(7, 8));
}

/// A message with a stamp, a velocity along x and its variance.
template <typename Message>
Message withCovariance(double x, double variance) {
  Message message;
  message.header.stamp = ros::Time(3, 4);
  message.twist.twist.linear.x = x;
  message.twist.covariance[0] = variance;
  return message;
}
nav_msgs::Odometry odometry(double x, double variance) {
  return withCovariance<nav_msgs::Odometry>(x, variance);
}

TEST(Speeds, HaveTheUnitThatIsStatedAndTheTimeOfArrivalWithoutAStamp) {
  using Twist = geometry_msgs::TwistWithCovarianceStamped;
  std_msgs::Float64 number;
  number.data = -36;
  std_msgs::Float32 small;
  small.data = -36;
  const struct {
    SpeedSample sample;
    double speed, sigma;
    std::int64_t stamp_ns = 3000000004;
  } kCases[] = {{read(twistStamped(-2.5)), -2.5, 0},
                {read(withCovariance<Twist>(7, 0.25)), 7, 0.5},
                {read(odometry(7, 0.25)), 7, 0.5},
                {read(number, {}, "kmh"), -10, 0, 7000000008},
                {read(small, {}, "kmh"), -10, 0, 7000000008},
                {read(number, {}, "mps"), -36, 0, 7000000008},
                {read(twistStamped(2000), {}, "mmps"), 2, 0},
                {read(odometry(0, 3.6 * 3.6), {}, "kmh"), 0, 1}};
  for (const auto& c : kCases) {
    EXPECT_DOUBLE_EQ(c.sample.speed, c.speed);
    EXPECT_DOUBLE_EQ(c.sample.sigma, c.sigma);
    EXPECT_EQ(c.sample.stamp_ns, c.stamp_ns);
  }
  for (const double unknown : {0.0, -1.0, kNan, kInfinity, 1e6}) {
    EXPECT_EQ(read(odometry(0, unknown)).sigma, 0) << unknown;
  }
}

TEST(Speeds, TheAxesOfTheVelocityDoNotMatter) {
  const auto speedOf = [](double x, double y, double z = 0) {
    return read(twistStamped(x, y, z)).speed;
  };
  EXPECT_DOUBLE_EQ(speedOf(-4, 3), -5) << "reverse, of a point that also moves sideways";
  EXPECT_DOUBLE_EQ(speedOf(3, -4), 5);
  EXPECT_DOUBLE_EQ(speedOf(0, 0, 9), 9) << "optical axes";
  EXPECT_EQ(speedOf(4, kNan, kNan), 4);
  EXPECT_EQ(speedOf(0.01, 0.5), std::hypot(0.01, 0.5));
}

TEST(Speeds, AVelocityThatIsNotAlongXHasNoSign) {
  SpeedReader reader("");
  const auto next = [&](double x, double y) {
    return reader.read(received(twistStamped(x, y)), ros::Time()).speed;
  };
  EXPECT_EQ(next(-5, 0), -5);
  EXPECT_NEAR(next(-0.1, 1), -1, 0.01) << "too slow for a direction";
  EXPECT_TRUE(reader.hasVehicleAxes());
  EXPECT_EQ(next(-3, 4), 5);
  EXPECT_FALSE(reader.hasVehicleAxes());
  EXPECT_EQ(next(-5, 0), 5);
}

TEST(Speeds, RefusesWhatIsNoSpeedWithTheReason) {
  expectThrows<DataError>(
      [] { read(std_msgs::String()); },
      "has the type std_msgs/String, accepted are nav_msgs/Odometry, geometry_msgs/TwistStamped, "
      "geometry_msgs/TwistWithCovarianceStamped, std_msgs/Float32 and std_msgs/Float64");
  expectThrows<DataError>([] { read(std_msgs::Float64()); }, "whose unit is not known");
  expectThrows<OptionError>([] { SpeedReader("km/h"); }, "'km/h' is no unit of a speed");
  geometry_msgs::TwistStamped without_stamp = twistStamped(1);
  without_stamp.header.stamp = ros::Time();
  expectThrows<DataError>([&] { read(without_stamp); }, "stamp of zero");
  for (const double x : {kNan, kInfinity}) {
    expectThrows<DataError>([&] { read(twistStamped(x)); }, "is not finite");
  }
  expectThrows<DataError>([&] { read(twistStamped(1), "another"); }, "cannot be read: ");
}

}  // namespace
}  // namespace gsv
