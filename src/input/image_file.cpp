#include "ground_scale_vo/input/image_file.hpp"

#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/read_file.hpp"
#include "ground_scale_vo/input/encoded_image.hpp"
#include "ground_scale_vo/input/grey_converter.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;

}  // namespace

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
