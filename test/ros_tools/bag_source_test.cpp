#include "ground_scale_vo/ros_tools/bag_drive.hpp"

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/NavSatFix.h>
#include <std_msgs/String.h>

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/image_message.hpp"
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

  /// Runs grey images with these stamps [s] and the fixes through the odometry. source: without bag
  /// and topics. Stores how often a frame was reported, and the number of images with it.
  BagDrive run(const std::vector<double>& stamps, const std::vector<sensor_msgs::NavSatFix>& fixes,
               BagDrive::Source source = {}) {
    source.bag = folder_ / "images.bag";
    source.image = "/camera/image_raw";
    source.camera_info = "/camera/camera_info";
    if (!fixes.empty()) source.gps = "/fix";
    {
      rosbag::Bag bag(source.bag, rosbag::bagmode::Write);
      if (first_info_) bag.write(source.camera_info, ros::Time(1), *first_info_);
      bag.write(source.camera_info, ros::Time(1), toCameraInfo({96, 64, 60, 60, 48, 32}));
      sensor_msgs::Image image;
      image.encoding = "mono8";
      image.width = image.step = 96;
      image.height = 64;
      image.data.assign(96 * 64, 100);
      ros::Time received(2);  // messages are played in the order in which they are written
      for (const double stamp : stamps) {
        image.header.stamp = ros::Time(stamp);
        bag.write(source.image, received += ros::Duration(0.1), image);
      }
      for (const auto& fix : fixes) bag.write("/fix", received += ros::Duration(0.1), fix);
    }
    OfflineRun::Options options;
    options.scale.camera_height = 1;
    return runBagDrive(source, options, [this](const RunFrame&, std::size_t images) {
      ++reported_;
      images_ = images;
    });
  }
  std::optional<sensor_msgs::CameraInfo> first_info_;  ///< before the valid one
  int reported_ = 0;
  std::size_t images_ = 0;
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
    BagDrive::Source source;
    source.bag = bagWith(topics);
    source.image = "/none";
    return dataErrorOf([&] { runBagDrive(source, {}, {}); }, folder_);
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
  const BagDrive drive =
      run({1, 2},
          {fix(0.5, kNan, kNan, 0), fix(1, 45, 8, 100, {2, 6}), fix(2, 45 + minute, 8, 100, {1, 1}),
           fix(2, 45, 8 + minute, 100), invalid, fix(3, 45, 8 + minute, 130)});
  ASSERT_EQ(drive.fixes.size(), 3u);  // not the second one of a stamp, nor those without position
  EXPECT_EQ(drive.fixes[2].stamp_ns, 3000000000);
  EXPECT_LT(drive.fixes[0].p.norm(), 1e-6);
  EXPECT_NEAR(drive.fixes[1].p.x(), 0, 0.1);
  EXPECT_NEAR(drive.fixes[1].p.y(), 1852.2, 0.2);
  EXPECT_NEAR(drive.fixes[2].p.x(), 1314.2, 0.2);
  EXPECT_NEAR(drive.fixes[2].p.z(), 30, 0.5);
  EXPECT_DOUBLE_EQ(drive.fix_sigma, 2);  // of 1 m, 2 m, and 2.5 m for the one of unknown accuracy
}

TEST_F(BagDrives, UseFixesWithoutAltitudeAndWithACovarianceOfZero) {
  const BagDrive drive =
      run({1, 2}, {fix(1, 45, 8, kNan, {0, 0}), fix(2, 45, 8.001, kNan, {0, 0})});
  ASSERT_EQ(drive.fixes.size(), 2u);
  EXPECT_NEAR(drive.fixes[1].p.x(), 78.85, 0.05);
  EXPECT_DOUBLE_EQ(drive.fix_sigma, 2.5);
}

TEST_F(BagDrives, UseTheGivenPartWithTheFirstValidCalibration) {
  first_info_ = sensor_msgs::CameraInfo();
  BagDrive::Source source;
  source.from_s = 1;
  source.to_s = 3;
  const BagDrive drive = run({10, 11, 12, 13, 14, 15}, {}, source);
  ASSERT_EQ(drive.record.frames().size(), 3u);
  EXPECT_EQ(drive.record.frames()[0].stamp_ns, 11000000000);
  EXPECT_EQ(drive.stamps_ns.size(), 6u);  // of all images
  EXPECT_EQ(reported_, 3);
  EXPECT_EQ(images_, 6u);
}

TEST_F(BagDrives, RejectImagesWhoseStampGoesBackOrFarAhead) {
  const BagDrive drive = run({10, 11, 10.5, 10.6, 5000, 12}, {});
  ASSERT_EQ(drive.record.frames().size(), 3u);
  EXPECT_EQ(drive.record.frames()[2].stamp_ns, 12000000000);
  EXPECT_EQ(drive.rejected_images, 3u);
  EXPECT_EQ(drive.first_rejection.find("the stamp 10.500000000 is not "), 0u)
      << drive.first_rejection;
}

TEST_F(BagDrives, RejectAFirstImageWhoseStampIsLaterThanTheNextOne) {
  BagDrive::Source source;
  source.to_s = 1.5;
  const BagDrive drive = run({5000, 10, 11, 12, 5}, {}, source);
  ASSERT_EQ(drive.record.frames().size(), 2u);
  EXPECT_EQ(drive.record.frames()[0].stamp_ns, 10000000000);
  EXPECT_EQ(drive.rejected_images, 2u);
  EXPECT_EQ(drive.first_rejection, "its stamp is later than that of the next image");
  EXPECT_EQ(drive.stamps_ns.size(), 5u);
}

}  // namespace
}  // namespace ground_scale_vo
