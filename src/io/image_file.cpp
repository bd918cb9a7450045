#include "ground_scale_vo/io/image_file.hpp"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/text_file.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;
constexpr std::int64_t kMaxPixels = 1 << 27;

/// True if the file has the end mark of its format. OpenCV fills the missing rows of a truncated
/// JPEG with grey and reports that on stderr only.
bool isComplete(const std::string& bytes) {
  const auto begins = [&](const std::string& s) { return bytes.compare(0, s.size(), s) == 0; };
  const auto ends = [&](const std::string& s) {
    return bytes.size() >= s.size() && bytes.compare(bytes.size() - s.size(), s.size(), s) == 0;
  };
  if (begins("\x89PNG")) return ends(std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12));
  if (begins("\xff\xd8")) return ends("\xff\xd9");
  return false;
}

/// Image size from the header of a PNG or JPEG file; 0x0 when it has none. The header of a small
/// file may state any size, and decoding it allocates that much memory.
cv::Size headerSize(const std::string& bytes) {
  const auto number = [&](std::size_t at, std::size_t length) {
    std::uint32_t value = 0;
    for (std::size_t k = at; k < at + length; ++k) {
      value = value << 8 | static_cast<unsigned char>(bytes[k]);
    }
    return static_cast<int>(value & 0x7fffffffu);
  };
  constexpr std::size_t kPngSize = 16;
  if (bytes[0] == '\x89') {
    return bytes.size() < kPngSize + 8 ? cv::Size()
                                       : cv::Size(number(kPngSize, 4), number(kPngSize + 4, 4));
  }
  // JPEG: segments of a marker, a length and that many bytes; the size is in the frame header
  // (SOF).
  for (std::size_t at = 2; at + 9 <= bytes.size() && bytes[at] == '\xff';) {
    const int marker = number(at + 1, 1);
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame) return {number(at + 7, 2), number(at + 5, 2)};
    at += marker == 0xff ? 1 : 2 + static_cast<std::size_t>(number(at + 2, 2));
  }
  return {};
}

}  // namespace

cv::Mat readGreyImage(const fs::path& file) {
  const std::string bytes = readFile(file, kMaxImageBytes);
  if (!isComplete(bytes)) throw DataError(file.string() + ": is not a whole PNG or JPEG file");
  const cv::Size size = headerSize(bytes);
  if (std::int64_t{size.width} * size.height > kMaxPixels) {
    throw DataError(file.string() + ": its header states " + std::to_string(size.width) + "x" +
                    std::to_string(size.height) + " pixels, more than are plausible");
  }
  cv::Mat image;
  try {
    const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1,
                         const_cast<char*>(bytes.data()));
    image = cv::imdecode(buffer, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) throw DataError(file.string() + ": cannot be decoded as an image");
  return image;
}

}  // namespace ground_scale_vo
