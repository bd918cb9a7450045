#include "ground_scale_vo/io/image_file.hpp"

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/encoded_image.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/text_file.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;

}  // namespace

cv::Mat readGreyImage(const fs::path& file) {
  const std::string bytes = readFile(file, kMaxImageBytes);
  try {
    requireDecodable(bytes);
  } catch (const DataError& error) {
    throw DataError(file.string() + ": " + error.what());
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
