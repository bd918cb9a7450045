#include "ground_scale_vo/io/image_file.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "support/jpeg_to_be_turned.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using ImageFile = TemporaryFolder;

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
