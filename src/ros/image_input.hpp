#pragma once

#include <memory>
#include <string>

#include "input/camera_input.hpp"

namespace gsv {

/// mask_file: image file of the images' size, black where they never show the scene; empty: no such
/// region. camera_file: readCameraFile(), instead of camera_info; empty: camera_info. Throws
/// OptionError that names the parameter (mask, camera_file) and the file.
std::unique_ptr<CameraInput> openCameraInput(bool image_is_rectified,
                                             const std::string& mask_file = {},
                                             const std::string& camera_file = {});

}  // namespace gsv
