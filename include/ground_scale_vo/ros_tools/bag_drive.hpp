#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"

namespace ground_scale_vo {

/// A drive recorded in a bag, run through the offline pipeline.
struct BagDrive {
  struct Source {
    std::string bag;
    std::string image;              ///< topic; image + "/compressed" when the bag has only that
    std::string camera_info;        ///< topic
    std::string camera_file;        ///< replaces camera_info and rectified; empty: none
    std::string gps;                ///< topic of sensor_msgs/NavSatFix; empty: fixes are not read
    bool rectified = false;         ///< the images have no distortion, and P belongs to them
    double from_s = 0, to_s = 1e9;  ///< used part of the drive, from the first image on [s]
  };

  RunRecord record;
  std::vector<std::int64_t> stamps_ns;  ///< of every image of the bag, used or not
  std::vector<StampedPosition> fixes;   ///< [m] east, north, up from the first fix
  double fix_sigma = 0;                 ///< [m] median standard deviation of a fix
  std::size_t rejected_images = 0;
  std::string first_rejection;  ///< reason for the first rejected image
  /// A hint that Source::rectified is wrong (rectificationContradiction()), or empty.
  std::string rectification_warning;
};

/// Runs the bag's images through the pipeline. on_frame(frame, images) is called after each frame;
/// `images` is the number of images in the bag. Throws DataError when the bag, its calibration, its
/// fixes or all of its images cannot be used, or when the calibration excludes Source::rectified.
BagDrive runBagDrive(
    const BagDrive::Source& source, const OfflineRun::Options& options,
    const std::function<void(const RunFrame& frame, std::size_t images)>& on_frame);

}  // namespace ground_scale_vo
