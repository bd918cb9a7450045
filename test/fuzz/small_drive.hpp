#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo::fuzz {

/// The first frames of a rendered drive with small images.
struct SmallDrive {
  PinholeCamera camera;
  std::vector<cv::Mat> images;
  std::vector<std::int64_t> stamps_ns;
};

/// Rendered at the first call.
inline const SmallDrive& smallDrive() {
  static const SmallDrive kDrive = [] {
    SyntheticDrive::Options options;
    options.camera = {480, 150, 278, 278, 240, 55};
    options.frames = 24;
    const SyntheticDrive drive(options);
    SmallDrive small;
    small.camera = drive.camera();
    for (std::size_t i = 0; i < drive.size(); ++i) {
      small.images.push_back(drive.image(i));
      // Starts at 1 s: a stamp of 0 means "no stamp" in ROS.
      small.stamps_ns.push_back(drive.frame(i).stamp_ns + 1000000000);
    }
    return small;
  }();
  return kDrive;
}

}  // namespace ground_scale_vo::fuzz
