#include "drive_arguments.hpp"

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/options.hpp"

namespace gsv {

void DriveArguments::addTo(CommandLine* command_line, const std::string& out_help) {
  constexpr double kMaxRate = 1000;
  command_line->addPositional(
      "SEQ",
      "KITTI odometry folder (image_0/, calib.txt, times.txt; optional: ground truth\n"
      "     poses.txt or ../../poses/NN.txt, and ground.txt as written by render_drive), KITTI "
      "raw\n"
      "     synced drive (image_00/data/, ../calib_cam_to_cam.txt; optional: ground truth from "
      "oxts/),\n"
      "     or, with --camera, a folder of images with times.txt, or a video",
      &drive.path);
  command_line->options().add_options()  //
      ("camera-height",
       po::value(&options.scale.camera_height)->value_name("M")->notifier([](double height) {
         requireInRange("camera_height", height, kMinCameraHeight, kMaxCameraHeight);
       }),
       "height of the camera above the road [m] (required without speeds)")  //
      ("out", requiredValue(&out, "DIR"), out_help.c_str())                  //
      ("camera", po::value(&drive.camera_file)->value_name("FILE"),
       "calibration of the images as they come, instead of that of the drive: YAML of "
       "camera_calibration, Kalibr, OpenCV, ORB-SLAM or VINS, or calib.txt of KITTI")  //
      ("mask", optionalValue(&drive.options.mask_file, "FILE"),
       "image of the size of those of the drive, black where they never show the scene (own "
       "vehicle, watermark); these regions are not used")  //
      ("fps", numberInRange("--fps", &drive.options.fps, "HZ", 0, kMaxRate),
       "the images have this rate; their stamps are not used")  //
      ("unrectified", po::bool_switch(&drive.unrectified),
       "the images of a KITTI raw drive are not rectified: K and D are used")  //
      ("options", optionalValue(&options_file, "FILE"),
       "YAML with options, such as config/paper.yaml; --set takes precedence")  //
      ("set", settingsValue(&settings), kSettingsHelp);
}

void DriveArguments::check() {
  if (!options_file.empty()) {
    for (const std::string& setting : readOptions(options_file)) setOption(options, setting);
  }
  for (const std::string& setting : settings) setOption(options, setting);
  if (speed_file.empty() && (!speed_unit.empty() || speed_offset != 0)) {
    throw OptionError("--speed-unit and --speed-offset are for --speed");
  }
  if (!speed_unit.empty()) speedUnit(speed_unit);
  if (!speed_file.empty()) {
    options.scale.use_speed = true;
  } else if (options.scale.camera_height == 0) {
    throw OptionError("--camera-height is missing, see --help");
  }
  options.validate();
}

}  // namespace gsv
