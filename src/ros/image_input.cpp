#include "ros/image_input.hpp"

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"

namespace gsv {

std::unique_ptr<CameraInput> openCameraInput(bool image_is_rectified, const std::string& mask_file,
                                             const std::string& camera_file) {
  const char* parameter = "mask";
  try {
    const cv::Mat mask = mask_file.empty() ? cv::Mat() : readGreyImage(mask_file);
    auto input =
        std::make_unique<CameraInput>(image_is_rectified, mask, "parameter mask: " + mask_file);
    if (camera_file.empty()) return input;
    parameter = "camera_file";
    const CameraCalibration calibration = readCameraFile(camera_file);
    if (!calibration.hasSize()) {
      throw DataError(camera_file + ": contains no image size, which a live camera needs");
    }
    input->setCalibration(calibration, "parameter camera_file: " + camera_file);
    return input;
  } catch (const DataError& error) {  // it begins with the name of the file
    throw OptionError("parameter " + std::string(parameter) + ": " + error.what());
  }
}

}  // namespace gsv
