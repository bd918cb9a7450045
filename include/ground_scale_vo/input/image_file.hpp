#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// The pixels of a PNG or JPEG file (decodePixels()). Throws DataError that names the file: not
/// readable, truncated, not decodable, or of an implausible size.
cv::Mat readPixels(const std::filesystem::path& file);

/// The same as 8-bit grey, for a single image such as a mask. The images of a drive need one
/// GreyConverter for all.
cv::Mat readGreyImage(const std::filesystem::path& file);

}  // namespace ground_scale_vo
