#include "ground_scale_vo/io/image_reader.hpp"

#include <gtest/gtest.h>

#include <atomic>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// A 1 x 1 image whose grey value is its index.
cv::Mat numbered(std::size_t i) { return cv::Mat(1, 1, CV_8UC1, cv::Scalar(double(i))); }

TEST(ImageReader, ReturnsAllImagesInOrder) {
  for (const bool ahead : {false, true}) {
    ImageReader reader(20, numbered, ahead);
    for (int i = 0; i < 20; ++i) EXPECT_EQ(reader.next().image.at<unsigned char>(0), i);
  }
}

TEST(ImageReader, AnUnreadableImageThrowsAtItsTurn) {
  for (const bool ahead : {false, true}) {
    ImageReader reader(
        3,
        [](std::size_t i) {
          if (i == 1) throw DataError("broken");
          return numbered(i);
        },
        ahead);
    EXPECT_NO_THROW(reader.next());
    EXPECT_THROW(reader.next(), DataError);
  }
}

TEST(ImageReader, MayBeDestroyedWhileReading) {
  std::atomic<int> read{0};
  {
    ImageReader reader(100, [&](std::size_t i) {
      ++read;
      return numbered(i);
    });
    reader.next();
  }
  const int images_read = read;  // the one returned and at most one ahead
  EXPECT_LE(images_read, 2);
}

}  // namespace
}  // namespace ground_scale_vo
