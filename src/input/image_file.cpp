#include "ground_scale_vo/input/image_file.hpp"

#include <cstddef>
#include <cstdint>
#include <opencv2/imgcodecs.hpp>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/files.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/grey_converter.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;
constexpr std::string_view kPngBegin = "\x89PNG", kJpegBegin = "\xff\xd8", kJpegEnd = "\xff\xd9";
constexpr std::string_view kPngEnd("\0\0\0\0IEND\xae\x42\x60\x82", 12);

bool begins(std::string_view bytes, std::string_view mark) {
  return bytes.substr(0, mark.size()) == mark;
}
bool ends(std::string_view bytes, std::string_view mark) {
  return bytes.size() >= mark.size() && bytes.substr(bytes.size() - mark.size()) == mark;
}

struct ImageSize {
  std::int64_t width = 0, height = 0;  ///< [px]
};

/// OpenCV fills the missing rows of a truncated JPEG with grey and reports that on stderr only.
bool isComplete(std::string_view bytes) {
  while (!bytes.empty() && bytes.back() == '\0') bytes.remove_suffix(1);
  return (begins(bytes, kPngBegin) && ends(bytes, kPngEnd)) ||
         (begins(bytes, kJpegBegin) && ends(bytes, kJpegEnd));
}

/// In the header; 0 x 0 if there is none. The header of a small image may state any size, and
/// decoding it allocates that much memory.
ImageSize encodedSize(std::string_view bytes) {
  const auto number = [&](std::size_t at, std::size_t length) {
    std::int64_t value = 0;
    for (std::size_t k = at; k < at + length; ++k) {
      value = value << 8 | static_cast<unsigned char>(bytes[k]);
    }
    return value;
  };
  constexpr std::size_t kPngSize = 16;
  if (begins(bytes, kPngBegin)) {
    if (bytes.size() < kPngSize + 8) return {};
    return {number(kPngSize, 4), number(kPngSize + 4, 4)};
  }
  // JPEG: segments of a marker (2 bytes), a length (2 bytes, which it counts itself) and data; the
  // size is in the frame header (SOF), before the first scan (SOS). Decoders skip other bytes
  // between segments.
  for (std::size_t at = 2; at + 9 <= bytes.size();) {
    const std::int64_t marker = bytes[at] == '\xff' ? number(at + 1, 1) : 0xff;
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    const bool has_length = marker > 0x01 && marker < 0xff && (marker < 0xd0 || marker > 0xd8);
    if (is_frame) return {number(at + 7, 2), number(at + 5, 2)};
    if (marker == 0xda) break;
    at += marker == 0xff ? 1 : has_length ? 2 + static_cast<std::size_t>(number(at + 2, 2)) : 2;
  }
  return {};
}

/// Before an image is decoded: the bytes are a complete image of at most kMaxImagePixels.
void requireDecodable(std::string_view bytes) {
  if (!isComplete(bytes)) throw DataError("is not a whole PNG or JPEG image");
  const ImageSize size = encodedSize(bytes);
  if (size.width <= 0 || size.height <= 0) throw DataError("states no image size");
  if (static_cast<double>(size.width) * static_cast<double>(size.height) > kMaxImagePixels) {
    throw DataError("states " + std::to_string(size.width) + " x " + std::to_string(size.height) +
                    " pixels, more than are plausible");
  }
}

}  // namespace

cv::Mat decodePixels(std::string_view bytes) {
  requireDecodable(bytes);
  cv::Mat pixels;
  try {
    const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1,
                         const_cast<char*>(bytes.data()));
    pixels = cv::imdecode(buffer, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    pixels.release();
  }
  const bool has_integers = pixels.depth() == CV_8U || pixels.depth() == CV_16U;
  if (pixels.empty() || !has_integers || pixels.channels() == 2) {
    throw DataError("cannot be decoded as an image");
  }
  return pixels;
}

std::string bayerPatternOf(const std::string& format) {
  return format.rfind("bayer_", 0) == 0 ? format.substr(0, format.find(';')) : "";
}

cv::Mat readPixels(const std::filesystem::path& file) {
  const std::string bytes = readFile(file, kMaxImageBytes);
  try {
    return decodePixels(bytes);
  } catch (const DataError& error) {
    throw DataError(file.string() + ": " + error.what());
  }
}

cv::Mat readGreyImage(const std::filesystem::path& file) {
  return GreyConverter().convert(readPixels(file));
}

}  // namespace ground_scale_vo
