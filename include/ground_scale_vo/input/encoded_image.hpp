#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

namespace ground_scale_vo {

/// True if the bytes are a PNG or JPEG image with the end mark of its format; zeros may follow it,
/// as cameras with MJPEG append them. OpenCV fills the missing rows of a truncated JPEG with grey
/// and reports that on stderr only.
bool isCompleteImage(std::string_view bytes);

struct ImageSize {
  std::int64_t width = 0, height = 0;  ///< [px]
};

/// Size in the header of a PNG or JPEG image; 0 x 0 if there is none. The header of a small image
/// may state any size, and decoding it allocates that much memory.
ImageSize encodedSize(std::string_view bytes);

/// The pixels of a PNG or JPEG image as they are stored, of 8 or 16 bits and 1, 3 (BGR) or 4 (BGRA)
/// channels; the orientation in its metadata is ignored, since calibrations are of the pixels.
/// Throws DataError ("is not a whole PNG or JPEG image", "states no image size", "states W x H
/// pixels, ...", "cannot be decoded"; the caller adds the name of the image).
cv::Mat decodePixels(std::string_view bytes);

/// The Bayer pattern of decodePixels(), for GreyConverter, from the format of a
/// sensor_msgs/CompressedImage, such as "bayer_rggb8; jpeg compressed". Empty without one: decoded
/// colours are BGR, whatever their order was before the compression.
std::string bayerPatternOf(const std::string& format);

}  // namespace ground_scale_vo
