#include "ground_scale_vo/ros_tools/bag_source.hpp"

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/NavSatFix.h>
#include <std_msgs/String.h>

#include <limits>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/conversions.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class BagDrives : public TemporaryFolder {
 protected:
  /// A bag with a text on each topic. A repeated topic has several publishers.
  std::string bagWith(const std::vector<std::string>& topics) const {
    const std::string file = folder_ / "drive.bag";
    rosbag::Bag bag(file, rosbag::bagmode::Write);
    for (std::size_t i = 0; i < topics.size(); ++i) {
      const auto header = boost::make_shared<ros::M_string>();
      (*header)["callerid"] = "/publisher_" + std::to_string(i);
      bag.write(topics[i], ros::Time(1), std_msgs::String(), header);
    }
    return file;
  }

  /// Writes grey images with these stamps [s] and the fixes.
  std::string write(const std::vector<double>& stamps,
                    const std::vector<sensor_msgs::NavSatFix>& fixes = {}) const {
    const std::string file = folder_ / "images.bag";
    rosbag::Bag bag(file, rosbag::bagmode::Write);
    bag.write("/camera/camera_info", ros::Time(1), sensor_msgs::CameraInfo());  // not valid
    bag.write("/camera/camera_info", ros::Time(1),
              toCameraInfo(PinholeCamera{96, 64, 60, 60, 48, 32}));
    sensor_msgs::Image image;
    image.encoding = "mono8";
    image.width = image.step = 96;
    image.height = 64;
    image.data.assign(96 * 64, 100);
    ros::Time received(2);  // messages are played in the order in which they are written
    for (const double stamp : stamps) {
      image.header.stamp = ros::Time(stamp);
      bag.write("/camera/image_raw", received += ros::Duration(0.1), image);
    }
    for (const auto& fix : fixes) bag.write("/fix", received += ros::Duration(0.1), fix);
    return file;
  }
};

/// variances: of east and north [m^2]; empty: not known.
sensor_msgs::NavSatFix fix(double stamp, double latitude, double longitude, double altitude,
                           const std::vector<double>& variances = {}) {
  using sensor_msgs::NavSatFix;
  NavSatFix fix;
  fix.header.stamp = ros::Time(stamp);
  fix.latitude = latitude;
  fix.longitude = longitude;
  fix.altitude = altitude;
  fix.position_covariance_type = variances.empty() ? NavSatFix::COVARIANCE_TYPE_UNKNOWN
                                                   : NavSatFix::COVARIANCE_TYPE_DIAGONAL_KNOWN;
  fix.position_covariance[0] = variances.empty() ? 0.01 : variances[0];
  fix.position_covariance[4] = variances.empty() ? 0.01 : variances[1];
  return fix;
}

TEST_F(BagDrives, NameTheTopicsOfABagWithoutImages) {
  const auto error = [this](const std::vector<std::string>& topics) {
    BagInput input;
    input.bag = bagWith(topics);
    input.image = "/none";
    return dataErrorOf([&] { openBag(input); }, folder_);
  };
  EXPECT_EQ(error({"/camera/image", "/camera", "/camera/image", "/camera/im"}),
            "the bag /drive.bag has no images on /none; it holds /camera, /camera/im, "
            "/camera/image");
  EXPECT_EQ(error({}), "the bag /drive.bag has no images on /none; it holds nothing");
}

TEST_F(BagDrives, ReadFixesInMetresEastNorthUpFromTheFirst) {
  // A minute of latitude at 45 deg north is 1852.2 m, one of longitude 1314.2 m (WGS84).
  const double minute = 1. / 60;
  sensor_msgs::NavSatFix invalid = fix(2.5, 1, 1, 0);
  invalid.status.status = sensor_msgs::NavSatStatus::STATUS_NO_FIX;
  const BagFixes drive =
      readFixes(write({1, 2}, {fix(0.5, kNan, kNan, 0), fix(1, 45, 8, 100, {2, 6}),
                               fix(2, 45 + minute, 8, 100, {1, 1}), fix(2, 45, 8 + minute, 100),
                               invalid, fix(3, 45, 8 + minute, 130)}),
                "/fix");
  ASSERT_EQ(drive.fixes.size(), 3u);  // not the second one of a stamp, nor those without position
  EXPECT_EQ(drive.fixes[2].stamp_ns, 3000000000);
  EXPECT_LT(drive.fixes[0].p.norm(), 1e-6);
  EXPECT_NEAR(drive.fixes[1].p.x(), 0, 0.1);
  EXPECT_NEAR(drive.fixes[1].p.y(), 1852.2, 0.2);
  EXPECT_NEAR(drive.fixes[2].p.x(), 1314.2, 0.2);
  EXPECT_NEAR(drive.fixes[2].p.z(), 30, 0.5);
  EXPECT_DOUBLE_EQ(drive.sigma, 2);  // of 1 m, 2 m, and 2.5 m for the one of unknown accuracy
}

TEST_F(BagDrives, UseFixesWithoutAltitudeAndWithACovarianceOfZero) {
  const BagFixes drive = readFixes(
      write({1, 2}, {fix(1, 45, 8, kNan, {0, 0}), fix(2, 45, 8.001, kNan, {0, 0})}), "/fix");
  ASSERT_EQ(drive.fixes.size(), 2u);
  EXPECT_NEAR(drive.fixes[1].p.x(), 78.85, 0.05);
  EXPECT_DOUBLE_EQ(drive.sigma, 2.5);
}

TEST_F(BagDrives, AreReadWithTheFirstValidCalibration) {
  BagInput input;
  input.bag = write({10, 11, 10.5, 10.6, 5000, 12, 0});
  input.image = "camera/image_raw";  // without its slash
  const auto drive = openBag(input);
  EXPECT_EQ(drive->camera().camera().fx, 60);
  EXPECT_EQ(drive->count(), 7u);
  std::vector<std::int64_t> stamps;
  while (const auto image = drive->next()) {
    if (!image->given.empty()) stamps.push_back(image->stamp_ns);
  }
  EXPECT_EQ(stamps, (std::vector<std::int64_t>{10000000000, 11000000000, 12000000000}));
  ASSERT_EQ(drive->warnings().size(), 1u);
  EXPECT_EQ(drive->warnings().front().find("4 of 7 images have a stamp that does not continue the "
                                           "others and are not used, the first one because the "
                                           "stamp 10.500000000 is not "),
            0u)
      << drive->warnings().front();
}

}  // namespace
}  // namespace ground_scale_vo
