#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/input/image.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using namespace std::string_literals;

// Only marks and headers; nothing decodes the pixels.
const std::string kPng =
    "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\x02\0\0\0\x03"s + "\0\0\0\0IEND\xae\x42\x60\x82"s;
const std::string kJpeg = "\xff\xd8\xff\xe0\0\x04JF\xff\xc0\0\x0b\x08\0\x03\x01\x02\x01\xff\xd9"s;

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
  EXPECT_EQ(refusal(kPng + "\0\0\0"s), "cannot be decoded as an image") << "padded: MJPEG";
  EXPECT_EQ(refusal(kPng.substr(0, kPng.size() - 1)), "is not a whole PNG or JPEG image");
  EXPECT_EQ(refusal(kPng.substr(0, kPng.size() / 2)), "is not a whole PNG or JPEG image");
  EXPECT_EQ(refusal(kJpeg.substr(1)), "is not a whole PNG or JPEG image");
  // OpenCV 4.6 decodes the beginning of a truncated JPEG and only prints a warning.
  EXPECT_EQ(refusal(kJpeg.substr(0, kJpeg.size() - 1)), "is not a whole PNG or JPEG image");
  EXPECT_EQ(refusal(""), "is not a whole PNG or JPEG image");
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

using ImageFile = TemporaryFolder;

/// The bytes of a JPEG file whose EXIF orientation says that a viewer should turn the image.
std::string jpegToBeTurned(const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", image, bytes);
  const std::string exif(
      "\xff\xe1\x00\x22"                                   // APP1, 34 bytes
      "Exif\0\0MM\0\x2a\0\0\0\x08"                         // big-endian TIFF, first table at 8
      "\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0",  // one entry: orientation 6
      36);
  std::string jpeg(bytes.begin(), bytes.end());
  return jpeg.insert(2, exif);
}

// The calibration is that of the sensor.
TEST_F(ImageFile, IsNotTurnedByItsOrientation) {
  cv::Mat image(16, 32, CV_8UC1, cv::Scalar(40));
  image.colRange(0, 16) = 200;
  const std::string jpeg = jpegToBeTurned(image);
  const cv::Mat buffer(1, static_cast<int>(jpeg.size()), CV_8UC1, const_cast<char*>(jpeg.data()));
  ASSERT_EQ(cv::imdecode(buffer, cv::IMREAD_GRAYSCALE).size(), cv::Size(16, 32));
  const cv::Mat read = readGreyImage(write("turned.jpg", jpeg));
  ASSERT_EQ(read.size(), image.size());
  EXPECT_LT(cv::norm(read, image, cv::NORM_INF), 5);
}

}  // namespace
}  // namespace ground_scale_vo
