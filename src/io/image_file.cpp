#include "ground_scale_vo/io/image_file.hpp"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/encoded_image.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/text_file.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;
constexpr std::int64_t kMaxPixels = 1 << 27;
constexpr std::int64_t kMaxSide = kMaxPixels;  // keeps the product within its type

}  // namespace

cv::Mat readGreyImage(const fs::path& file) {
  const std::string bytes = readFile(file, kMaxImageBytes);
  if (!isCompleteImage(bytes)) throw DataError(file.string() + ": is not a whole PNG or JPEG file");
  const ImageSize size = encodedSize(bytes);
  if (size.width > kMaxSide || size.height > kMaxSide || size.width * size.height > kMaxPixels) {
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
