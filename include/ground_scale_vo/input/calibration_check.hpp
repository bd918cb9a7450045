#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/input/camera_calibration.hpp"

namespace ground_scale_vo {

/// Whether a calibration can be that of images of this size. Where it has a size, that must be the
/// images'. Its principal point must not be that of images of another size: then it lies at the
/// centre of the image times one factor in both coordinates.
///
/// source: names the calibration in the sentences. Throws DataError with the likely size. Returns a
/// warning when the principal point is far from the centre of the image, as of cropped images, else
/// an empty text.
std::string checkCalibration(const CameraCalibration& calibration, const std::string& source,
                             const cv::Size& images);

}  // namespace ground_scale_vo
