#include "ground_scale_vo/evaluation/repeated_drive.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

class RepeatedDrives : public TemporaryFolder {
 protected:
  /// Three images of 64x48 pixels, whose grey value is their number.
  void SetUp() override {
    TemporaryFolder::SetUp();
    for (int i = 0; i < 3; ++i) {
      std::vector<unsigned char> bytes;
      cv::imencode(".png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(i)), bytes);
      write("image_0/" + std::to_string(i) + ".png", {bytes.begin(), bytes.end()});
    }
    write("calib.txt", "P0: 70 0 32 0 0 71 24 0 0 0 1 0\n");
    write("times.txt", "10\n11\n13\n");
  }
};

TEST_F(RepeatedDrives, GoForwardsAndBackwardsInTurnAndAreResized) {
  const RepeatedDrive drive(folder_, 3, 0.5);
  std::vector<int> images;
  std::vector<std::int64_t> seconds;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    images.push_back(drive.image(i).at<unsigned char>(0));
    seconds.push_back(drive.stampNs(i) / 1000000000);
  }
  EXPECT_EQ(images, (std::vector<int>{0, 1, 2, 1, 0, 1, 2}));
  EXPECT_EQ(seconds, (std::vector<std::int64_t>{10, 11, 13, 15, 16, 17, 19}));
  EXPECT_EQ(drive.image(0).size(), cv::Size(32, 24));
  EXPECT_EQ(drive.camera().width, 32);
  EXPECT_DOUBLE_EQ(drive.camera().fx, 35);
  EXPECT_DOUBLE_EQ(drive.camera().cy, 24.5 / 2 - 0.5);
}

}  // namespace
}  // namespace ground_scale_vo
