#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <std_msgs/Float64.h>

#include <cmath>
#include <limits>
#include <vector>

#include "ros/scale_input.hpp"
#include "support/expect_throws.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

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
double speedOf(double x, double y, double z = 0) {
  return SpeedReader().read(received(twistStamped(x, y, z))).speed;
}

TEST(SpeedReader, ReadsEveryType) {
  SpeedReader reader;
  const SpeedSample stamped = reader.read(received(twistStamped(-2.5)));
  EXPECT_EQ(stamped.stamp_ns, 3000000004);
  EXPECT_EQ(stamped.speed, -2.5);
  EXPECT_EQ(stamped.sigma, 0);

  geometry_msgs::TwistWithCovarianceStamped with_covariance;
  with_covariance.header.stamp = ros::Time(5, 6);
  with_covariance.twist.twist.linear.x = 7;
  with_covariance.twist.covariance[0] = 0.25;
  nav_msgs::Odometry odometry;
  odometry.header = with_covariance.header;
  odometry.twist = with_covariance.twist;
  for (const SpeedSample& sample :
       {reader.read(received(with_covariance)), reader.read(received(odometry))}) {
    EXPECT_EQ(sample.stamp_ns, 5000000006);
    EXPECT_EQ(sample.speed, 7);
    EXPECT_EQ(sample.sigma, 0.5);
  }
}

TEST(SpeedReader, IgnoresAnUnknownCovariance) {
  nav_msgs::Odometry odometry;
  odometry.header.stamp = ros::Time(1, 0);
  for (const double variance : {0.0, -1.0, kNan, std::numeric_limits<double>::infinity(), 1e6}) {
    odometry.twist.covariance[0] = variance;
    EXPECT_EQ(SpeedReader().read(received(odometry)).sigma, 0) << variance;
  }
}

TEST(SpeedReader, TheAxesOfTheVelocityDoNotMatter) {
  EXPECT_DOUBLE_EQ(speedOf(-4, 3), -5) << "reverse, of a point that also moves sideways";
  EXPECT_DOUBLE_EQ(speedOf(3, -4), 5);
  EXPECT_DOUBLE_EQ(speedOf(0, 0, 9), 9) << "optical axes";
  EXPECT_EQ(speedOf(4, kNan, kNan), 4);
  EXPECT_EQ(speedOf(0.01, 0.5), std::hypot(0.01, 0.5));
}

TEST(SpeedReader, AVelocityThatIsNotAlongXHasNoSign) {
  SpeedReader reader;
  const auto read = [&](double x, double y) {
    return reader.read(received(twistStamped(x, y))).speed;
  };
  EXPECT_EQ(read(-5, 0), -5);
  EXPECT_NEAR(read(-0.1, 1), -1, 0.01) << "too slow for a direction";
  EXPECT_TRUE(reader.hasVehicleAxes());
  EXPECT_EQ(read(-3, 4), 5);
  EXPECT_FALSE(reader.hasVehicleAxes());
  EXPECT_EQ(read(-5, 0), 5);
}

TEST(SpeedReader, RefusesWhatIsNoSpeedWithTheReason) {
  SpeedReader reader;
  expectThrows<MessageError>(
      [&] { reader.read(received(std_msgs::Float64())); },
      "has the type std_msgs/Float64, accepted are nav_msgs/Odometry, geometry_msgs/TwistStamped "
      "and geometry_msgs/TwistWithCovarianceStamped");
  geometry_msgs::TwistStamped without_stamp = twistStamped(1);
  without_stamp.header.stamp = ros::Time();
  expectThrows<MessageError>([&] { reader.read(received(without_stamp)); }, "stamp of zero");
  for (const double x : {kNan, std::numeric_limits<double>::infinity()}) {
    expectThrows<MessageError>([&] { reader.read(received(twistStamped(x))); }, "is not finite");
  }
  expectThrows<MessageError>([&] { reader.read(received(twistStamped(1), "another")); },
                             "cannot be read: ");
}

}  // namespace
}  // namespace ground_scale_vo
