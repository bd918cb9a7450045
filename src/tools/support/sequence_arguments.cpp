#include "sequence_arguments.hpp"

#include "ground_scale_vo/common/set_option.hpp"

namespace ground_scale_vo {

void SequenceArguments::addTo(CommandLine* command_line, const std::string& out_help) {
  command_line->addPositional(
      "SEQ",
      "KITTI odometry folder (image_0/, calib.txt, times.txt; ground truth poses.txt or\n"
      "     ../../poses/NN.txt; ground.txt as of render_drive) or KITTI raw synced drive\n"
      "     (image_00/data/, ../calib_cam_to_cam.txt; ground truth from oxts/)",
      &sequence);
  command_line->options().add_options()  //
      ("camera-height", requiredValue(&options.scale.camera_height, "M"),
       "height of the camera above the road [m]; there is no default")  //
      ("out", requiredValue(&out, "DIR"), out_help.c_str())             //
      ("set", settingsValue(&settings), kSettingsHelp);
}

void SequenceArguments::check() {
  for (const std::string& setting : settings) setOption(options, setting);
  options.validate();
}

}  // namespace ground_scale_vo
