#include "sequence_arguments.hpp"

#include "ground_scale_vo/common/set_option.hpp"

namespace ground_scale_vo {

void SequenceArguments::addTo(CommandLine* command_line, const std::string& out_help) {
  command_line->addPositional(
      "SEQ",
      "KITTI odometry folder (image_0/, calib.txt, times.txt; optional: ground truth\n"
      "     poses.txt or ../../poses/NN.txt, and ground.txt as written by render_drive) or KITTI "
      "raw\n"
      "     synced drive (image_00/data/, ../calib_cam_to_cam.txt; optional: ground truth from "
      "oxts/)",
      &sequence);
  command_line->options().add_options()  //
      ("camera-height", requiredValue(&options.scale.camera_height, "M"),
       "height of the camera above the road [m] (required)")  //
      ("out", requiredValue(&out, "DIR"), out_help.c_str())   //
      ("set", settingsValue(&settings), kSettingsHelp);
}

void SequenceArguments::check() {
  for (const std::string& setting : settings) setOption(options, setting);
  options.validate();
}

}  // namespace ground_scale_vo
