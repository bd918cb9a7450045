#include "ground_scale_vo/input/image_file.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

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
