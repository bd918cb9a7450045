#include "ground_scale_vo/input/encoded_image.hpp"

#include <gtest/gtest.h>

#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

using namespace std::string_literals;

// Only marks and headers; nothing decodes the pixels.
const std::string kPng =
    "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\x02\0\0\0\x03"s + "\0\0\0\0IEND\xae\x42\x60\x82"s;
const std::string kJpeg = "\xff\xd8\xff\xe0\0\x04JF\xff\xc0\0\x0b\x08\0\x03\x01\x02\x01\xff\xd9"s;

TEST(EncodedImage, IsCompleteWithItsEndMark) {
  for (const std::string& image : {kPng, kJpeg}) {
    EXPECT_TRUE(isCompleteImage(image));
    EXPECT_TRUE(isCompleteImage(image + "\0\0\0"s)) << "padded, as by MJPEG cameras";
    EXPECT_FALSE(isCompleteImage(image.substr(0, image.size() - 1)));
    EXPECT_FALSE(isCompleteImage(image.substr(1)));
  }
  EXPECT_FALSE(isCompleteImage(""));
}

TEST(EncodedImage, HasTheSizeOfItsHeader) {
  // Length of the bytes up to the size.
  for (const auto& [image, needed] : {std::pair(kPng, 24u), std::pair(kJpeg, 17u)}) {
    for (std::size_t length = 0; length <= image.size(); ++length) {
      const ImageSize size = encodedSize(std::string_view(image).substr(0, length));
      EXPECT_EQ(size.width, length < needed ? 0 : 258) << length;
      EXPECT_EQ(size.height, length < needed ? 0 : 3) << length;
    }
  }
  // Segments whose markers lie among those of frame headers: DHT, JPG, DAC.
  for (const char* marker : {"\xff\xc4", "\xff\xc8", "\xff\xcc"}) {
    std::string jpeg = kJpeg;
    jpeg.insert(jpeg.find("\xff\xc0"), marker + "\0\x0b"s + std::string(9, '\x7f'));
    EXPECT_EQ(encodedSize(jpeg).width, 258);
    EXPECT_EQ(encodedSize(jpeg).height, 3);
  }
}

TEST(EncodedImage, IsDecodedOnlyIfItIsWholeAndOfAPlausibleSize) {
  const auto refusal = [](const std::string& image) -> std::string {
    try {
      decodePixels(image);
    } catch (const DataError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(kPng), "cannot be decoded as an image");
  EXPECT_EQ(refusal(kJpeg.substr(1)), "is not a whole PNG or JPEG image");
  // Bytes that decoders skip: a marker without a length, and one that is not part of a segment.
  for (const std::string& skipped : {"\xff\x01"s, "\0"s}) {
    std::string jpeg = kJpeg;
    jpeg[13] = jpeg[15] = '\x7f';  // height and width
    jpeg.insert(2, skipped);
    EXPECT_EQ(refusal(jpeg), "states 32514 x 32515 pixels, more than are plausible");
  }
  EXPECT_EQ(refusal("\xff\xd8\xff\xd9"s), "states no image size");
  std::string flat = kPng;
  flat[23] = 0;  // the least significant byte of the height
  EXPECT_EQ(refusal(flat), "states no image size");
  std::string huge = kPng;
  huge[16] = huge[20] = '\x7f';  // the most significant bytes of width and height
  EXPECT_EQ(refusal(huge), "states 2130706690 x 2130706435 pixels, more than are plausible");
}

TEST(EncodedImage, OfColourIsBgrWhateverItWasBefore) {
  EXPECT_EQ(bayerPatternOf("bayer_rggb8; jpeg compressed "), "bayer_rggb8");
  for (const char* format : {"rgb8; jpeg compressed bgr8", "mono8; png compressed ", "jpeg", ""}) {
    EXPECT_EQ(bayerPatternOf(format), "") << format;
  }
}

}  // namespace
}  // namespace ground_scale_vo
