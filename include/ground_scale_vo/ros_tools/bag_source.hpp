#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"

namespace ground_scale_vo {

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
