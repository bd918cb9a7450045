#include "ground_scale_vo/io/image_reader.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/process_usage.hpp"

namespace ground_scale_vo {
namespace {

/// A 1 x 1 image whose grey value is its index.
cv::Mat numbered(std::size_t i) { return cv::Mat(1, 1, CV_8UC1, cv::Scalar(double(i))); }

TEST(ImageReader, ReturnsAllImagesInOrder) {
  for (const bool ahead : {false, true}) {
    ImageReader reader(20, numbered, ahead);
    for (int i = 0; i < 20; ++i) {
      const ImageReader::Image image = reader.next();
      EXPECT_EQ(image.image.at<unsigned char>(0), i);
      EXPECT_GE(image.decode_ms, 0);
      EXPECT_GE(image.decode_cpu_ms, 0);
    }
  }
}

TEST(ImageReader, ReadsOnTheCallersThreadUnlessAhead) {
  for (const bool ahead : {false, true}) {
    std::thread::id thread;
    ImageReader reader(
        1,
        [&](std::size_t i) {
          thread = std::this_thread::get_id();
          return numbered(i);
        },
        ahead);
    reader.next();
    EXPECT_EQ(thread == std::this_thread::get_id(), !ahead);
  }
}

TEST(ImageReader, TheProcessorTimeIsThatOfOneImage) {
  const double end = threadCpuMs() + 50;
  while (threadCpuMs() < end) {
  }
  ImageReader reader(1, numbered, false);  // on this thread
  EXPECT_LT(reader.next().decode_cpu_ms, 50);
}

TEST(ImageReader, TheWallTimeIncludesWaiting) {
  ImageReader reader(1, [](std::size_t i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return numbered(i);
  });
  EXPECT_GE(reader.next().decode_ms, 20);
}

TEST(ImageReader, ReadsEachImageOnceAndNoneBeyondTheLast) {
  std::multiset<std::size_t> read;
  {
    ImageReader reader(3, [&](std::size_t i) {
      read.insert(i);
      return numbered(i);
    });
    for (int i = 0; i < 3; ++i) reader.next();
  }
  EXPECT_EQ(read, (std::multiset<std::size_t>{0, 1, 2}));
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

TEST(ImageReader, AcceptsZeroImages) { ImageReader reader(0, numbered); }

}  // namespace
}  // namespace ground_scale_vo
