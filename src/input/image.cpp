#include "ground_scale_vo/input/image.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

/// Share of the pixels that may be brighter than the range: defective ones, and reflections.
constexpr double kMaxShareOutOfRange = 0.001;

/// The type of a pixel, and OpenCV's conversion to grey (none: it is grey).
using Encoding = std::pair<int, std::optional<cv::ColorConversionCodes>>;

/// By the name in sensor_msgs. Channels without a meaning are read as OpenCV orders them: one is
/// grey, three or four are blue, green, red (and alpha). OpenCV names a Bayer pattern by its second
/// row.
const std::map<std::string, Encoding>& encodings() {
  static const std::map<std::string, Encoding> all = [] {
    const Encoding uyvy{CV_8UC2, cv::COLOR_YUV2GRAY_UYVY}, yuyv{CV_8UC2, cv::COLOR_YUV2GRAY_YUY2};
    std::map<std::string, Encoding> map = {{"yuv422", uyvy},
                                           {"uyvy", uyvy},
                                           {"yuv422_yuy2", yuyv},
                                           {"yuyv", yuyv},
                                           {"nv12", {CV_8UC1, {}}}};
    for (const int depth : {CV_8U, CV_16U}) {
      const std::string bits = depth == CV_8U ? "8" : "16";
      const Encoding grey{CV_MAKETYPE(depth, 1), {}};
      const Encoding bgr{CV_MAKETYPE(depth, 3), cv::COLOR_BGR2GRAY};
      const Encoding bgra{CV_MAKETYPE(depth, 4), cv::COLOR_BGRA2GRAY};
      map["mono" + bits] = map[bits + "UC1"] = grey;
      map["bgr" + bits] = map[bits + "UC3"] = bgr;
      map["bgra" + bits] = map[bits + "UC4"] = bgra;
      map["rgb" + bits] = {bgr.first, cv::COLOR_RGB2GRAY};
      map["rgba" + bits] = {bgra.first, cv::COLOR_RGBA2GRAY};
      map["bayer_rggb" + bits] = {grey.first, cv::COLOR_BayerBG2GRAY};
      map["bayer_bggr" + bits] = {grey.first, cv::COLOR_BayerRG2GRAY};
      map["bayer_gbrg" + bits] = {grey.first, cv::COLOR_BayerGR2GRAY};
      map["bayer_grbg" + bits] = {grey.first, cv::COLOR_BayerGB2GRAY};
    }
    return map;
  }();
  return all;
}

const Encoding& encodingOf(const std::string& name) {
  const auto found = encodings().find(name);
  if (found != encodings().end()) return found->second;
  throw DataError("the encoding \"" + name +
                  "\" cannot be converted to grey; supported are mono, colour and Bayer of 8 or "
                  "16 bits, yuv422 (uyvy), yuv422_yuy2 (yuyv) and nv12");
}

/// Throws DataError.
void requireWholeImage(const RawImage& image, int type) {
  const std::size_t step = image.step;
  if (step < std::size_t{image.width} * CV_ELEM_SIZE(type) || step % CV_ELEM_SIZE1(type) != 0) {
    throw DataError("the step of " + std::to_string(step) + " bytes does not fit " +
                    std::to_string(image.width) + " pixels of " + image.encoding);
  }
  // The colours of nv12 follow its grey values.
  const std::size_t rows = image.encoding == "nv12" ? image.height * 3 / 2 : image.height;
  if (image.bytes != step * rows) {
    throw DataError("the image holds " + std::to_string(image.bytes) + " bytes instead of " +
                    std::to_string(step * rows));
  }
}

/// Other byte order of 16-bit pixels, in new memory.
cv::Mat swapBytes(const cv::Mat& pixels) {
  cv::Mat swapped = pixels.clone();
  const int row_numbers = swapped.cols * swapped.channels();
  for (int row = 0; row < swapped.rows; ++row) {
    auto* const first = swapped.ptr<std::uint16_t>(row);
    std::transform(first, first + row_numbers, first,
                   [](std::uint16_t n) { return static_cast<std::uint16_t>(n << 8 | n >> 8); });
  }
  return swapped;
}

constexpr std::size_t kMaxImageBytes = 256u << 20;
constexpr std::string_view kPngBegin = "\x89PNG", kJpegBegin = "\xff\xd8", kJpegEnd = "\xff\xd9";
constexpr std::string_view kPngEnd("\0\0\0\0IEND\xae\x42\x60\x82", 12);

bool begins(std::string_view bytes, std::string_view mark) {
  return bytes.substr(0, mark.size()) == mark;
}
bool ends(std::string_view bytes, std::string_view mark) {
  return bytes.size() >= mark.size() && bytes.substr(bytes.size() - mark.size()) == mark;
}

/// OpenCV fills the missing rows of a truncated JPEG with grey and reports that on stderr only.
bool isComplete(std::string_view bytes) {
  while (!bytes.empty() && bytes.back() == '\0') bytes.remove_suffix(1);
  return (begins(bytes, kPngBegin) && ends(bytes, kPngEnd)) ||
         (begins(bytes, kJpegBegin) && ends(bytes, kJpegEnd));
}

}  // namespace

cv::Mat pixelsOf(const RawImage& image) {
  if (image.width == 0 || image.height == 0) throw DataError("the image has no pixels");
  if (image.width > kMaxImageSide || image.height > kMaxImageSide) {
    throw DataError("the image size " + std::to_string(image.width) + " x " +
                    std::to_string(image.height) + " is not plausible for a camera");
  }
  const int type = encodingOf(image.encoding).first;
  requireWholeImage(image, type);
  // cv::Mat has no constant pixels; nobody writes to these.
  const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), type,
                       const_cast<std::uint8_t*>(image.data), image.step);
  const bool is_swapped = image.is_bigendian && pixels.depth() == CV_16U;
  return is_swapped ? swapBytes(pixels) : pixels;
}

cv::Mat decodePixels(std::string_view bytes) {
  if (!isComplete(bytes)) throw DataError("is not a whole PNG or JPEG image");
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
  if (static_cast<double>(pixels.total()) > kMaxImagePixels) {
    throw DataError("has " + sizeText(pixels.cols, pixels.rows) +
                    " pixels, more than are plausible");
  }
  return pixels;
}

std::string encodePng(const cv::Mat& pixels) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", pixels, bytes);
  return {bytes.begin(), bytes.end()};
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

cv::Mat GreyConverter::convert(const cv::Mat& pixels, const std::string& encoding) {
  const auto named = encodings().find(encoding);
  const bool fits = named != encodings().end() && named->second.first == pixels.type();
  const std::string generic =
      std::string(pixels.depth() == CV_16U ? "16" : "8") + "UC" + std::to_string(pixels.channels());
  if (pixels.depth() != CV_8U && pixels.depth() != CV_16U) {
    throw DataError("its pixels are neither of 8 nor of 16 bits");
  }
  const auto conversion = fits ? named->second.second : encodingOf(generic).second;
  cv::Mat grey;
  if (conversion) {
    cv::cvtColor(pixels, grey, *conversion);
  } else {
    grey = pixels;
  }
  return grey.depth() == CV_16U ? scaleToEightBits(grey) : grey;
}

cv::Mat GreyConverter::scaleToEightBits(const cv::Mat& grey) {
  const double allowed = kMaxShareOutOfRange * static_cast<double>(grey.total());
  const auto fitsIn = [&](int bits) {
    return cv::countNonZero(grey >= std::ldexp(1.0, bits)) <= allowed;
  };
  while (bits_in_use_ < 16 && !fitsIn(bits_in_use_)) bits_in_use_ += 2;
  // One bit less than the narrower range, so that a change of the light does not widen it again.
  dark_images_ = bits_in_use_ > 8 && fitsIn(bits_in_use_ - 3) ? dark_images_ + 1 : 0;
  if (dark_images_ == kImagesUntilNarrower) {
    bits_in_use_ -= 2;
    dark_images_ = 0;
  }
  cv::Mat eight_bits;
  grey.convertTo(eight_bits, CV_8U, 255 / (std::ldexp(1.0, bits_in_use_) - 1));
  return eight_bits;
}

}  // namespace gsv
