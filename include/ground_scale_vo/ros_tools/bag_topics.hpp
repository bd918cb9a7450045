#pragma once

#include <rosbag/bag.h>
#include <rosbag/exceptions.h>

#include <string>
#include <vector>

namespace gsv {

/// Images of the left grey camera in a bag of kitti2bag: of an odometry sequence (and of
/// kitti_to_bag), of a raw drive, and of either in bags of an older branch.
inline const std::vector<std::string> kKittiImageTopics = {"/kitti/camera_gray_left/image_rect",
                                                           "/kitti/camera_gray_left/image_raw",
                                                           "/kitti/camera_gray_left/image"};
inline constexpr const char* kKittiCameraInfoTopic = "/kitti/camera_gray_left/camera_info";

/// The topics of this name as they are written in bags: with a leading slash by `rosbag record`,
/// as the caller spells them by rosbag::Bag::write().
std::vector<std::string> spellingsOf(const std::string& topic);

/// The spellings in the bags of the topic that holds images, raw or compressed: `topic`, or
/// topic + "/compressed" where no bag has images on `topic`. Empty if neither exists.
std::vector<std::string> imageTopics(const std::vector<const rosbag::Bag*>& bags,
                                     const std::string& topic);

/// Opens a bag for reading. Throws DataError when there is no such file, and rosbag::BagException.
void openBag(const std::string& file, rosbag::Bag* bag);

/// Why a bag cannot be read, in one sentence that says what to do.
std::string unreadableBag(const std::string& file, const std::exception& error);

}  // namespace gsv
