#pragma once

#include <rosbag/bag.h>
#include <rosbag/exceptions.h>

#include <memory>
#include <string>
#include <vector>

#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"

namespace ground_scale_vo {

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

/// A drive in a bag. Topic names with and without a leading slash are the same.
struct BagInput {
  std::string bag;
  std::string image;        ///< topic of Image or CompressedImage; also TOPIC/compressed of TOPIC
  std::string camera_info;  ///< topic; empty: camera_info beside the images
  std::string camera_file;  ///< replaces camera_info and rectified; empty: none
  bool rectified = false;   ///< the images have no distortion, and P belongs to them
  DriveReader::Options options;
};

/// The first valid calibration serves for the whole bag. Throws DataError when the bag, its
/// calibration or its images cannot be used, or when the calibration excludes `rectified`.
std::unique_ptr<DriveReader> openBag(const BagInput& input);

/// The fixes on a topic of sensor_msgs/NavSatFix.
struct BagFixes {
  std::vector<StampedPosition> fixes;  ///< [m] east, north, up from the first fix
  double sigma = 0;                    ///< [m] median standard deviation of a fix
};
/// Throws DataError.
BagFixes readFixes(const std::string& bag, const std::string& topic);

}  // namespace ground_scale_vo
