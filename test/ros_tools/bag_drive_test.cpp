#include "ground_scale_vo/ros_tools/bag_drive.hpp"

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <std_msgs/String.h>

#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

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

  std::string errorWithoutImages(const std::vector<std::string>& topics) const {
    BagDrive::Source source;
    source.bag = bagWith(topics);
    source.image = "/none";
    return dataErrorOf([&] { runBagDrive(source, {}, {}); }, folder_);
  }
};

TEST_F(BagDrives, NameEachTopicOfABagWithoutImagesOnce) {
  EXPECT_EQ(errorWithoutImages({"/camera/image", "/camera", "/camera/image", "/camera/im"}),
            "the bag /drive.bag has no images on /none; it holds /camera, /camera/im, "
            "/camera/image");
}

TEST_F(BagDrives, SayWhenABagIsEmpty) {
  EXPECT_EQ(errorWithoutImages({}), "the bag /drive.bag has no images on /none; it holds nothing");
}

}  // namespace
}  // namespace ground_scale_vo
