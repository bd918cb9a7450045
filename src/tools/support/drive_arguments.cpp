#include "drive_arguments.hpp"

#include <cstdio>

namespace ground_scale_vo {

void addDriveOptions(DriveInput* input, po::options_description* options) {
  constexpr double kMaxRate = 1000;
  options->add_options()  //
      ("camera", po::value(&input->camera_file)->value_name("FILE"),
       "calibration of the images as they come, instead of that of the drive: YAML of "
       "camera_calibration, Kalibr, OpenCV, ORB-SLAM or VINS, or calib.txt of KITTI")  //
      ("mask", optionalValue(&input->options.mask_file, "FILE"),
       "image of the size of those of the drive, black where they never show the scene (own "
       "vehicle, watermark); these regions are not used")  //
      ("fps", numberInRange("--fps", &input->options.fps, "HZ", 0, kMaxRate),
       "the images have this rate; their stamps are not used")  //
      ("unrectified", po::bool_switch(&input->unrectified),
       "the images of a KITTI raw drive are not rectified: K and D are used");
}

int report(const std::string& name, const DriveRun& run, const std::string& folder,
           bool is_strict) {
  for (const std::string& sentence : run.warnings) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), sentence.c_str());
  }
  std::printf("%s: %s%s\n", name.c_str(), run.summary().c_str(),
              folder.empty() ? "" : ("; written to " + folder).c_str());
  if (!run.failure.empty()) std::fprintf(stderr, "%s: %s\n", name.c_str(), run.failure.c_str());
  return run.exitStatus(is_strict);
}

}  // namespace ground_scale_vo
