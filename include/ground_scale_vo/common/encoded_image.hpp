#pragma once

#include <cstdint>
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

/// To be called before an image is decoded. Throws DataError ("is not a whole PNG or JPEG image",
/// "states no image size", "states W x H pixels, ..."; the caller adds the name of the image)
/// unless the bytes are a complete image of at most kMaxImagePixels.
void requireDecodable(std::string_view bytes);

}  // namespace ground_scale_vo
