#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

namespace ground_scale_vo {

/// The pixels of a whole PNG or JPEG image as they are stored, of 8 or 16 bits and 1, 3 (BGR) or 4
/// (BGRA) channels; the orientation in its metadata is ignored, since calibrations are of the
/// pixels. Zeros may follow the image, as cameras with MJPEG append them. Throws DataError ("is not
/// a whole PNG or JPEG image", "states no image size", "states W x H pixels, ...", "cannot be
/// decoded"; the caller adds the name of the image).
cv::Mat decodePixels(std::string_view bytes);

/// The Bayer pattern of decodePixels(), for GreyConverter, from the format of a
/// sensor_msgs/CompressedImage, such as "bayer_rggb8; jpeg compressed". Empty without one: decoded
/// colours are BGR, whatever their order was before the compression.
std::string bayerPatternOf(const std::string& format);

/// The pixels of a file. Throws DataError that names it: not readable, or as decodePixels().
cv::Mat readPixels(const std::filesystem::path& file);

/// The same as 8-bit grey, for a single image such as a mask. The images of a drive need one
/// GreyConverter for all.
cv::Mat readGreyImage(const std::filesystem::path& file);

}  // namespace ground_scale_vo
