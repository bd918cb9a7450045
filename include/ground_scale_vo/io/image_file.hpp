#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Reads a PNG or JPEG file as 8-bit grey, one channel. Throws DataError that names the file: not
/// readable, truncated, not decodable, or of an implausible size.
cv::Mat readGreyImage(const std::filesystem::path& file);

}  // namespace ground_scale_vo
