#include "ground_scale_vo/ros/frame_image_synchronizer.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

namespace ground_scale_vo {
namespace {

using Synchronizer = FrameImageSynchronizer<int, std::shared_ptr<int>>;

/// Frames and images are identified by their stamps.
class FrameImageSynchronization : public testing::Test {
 protected:
  static Synchronizer::Limits limits() {
    Synchronizer::Limits limits;
    limits.images = 5;
    limits.frames = 3;
    return limits;
  }
  void images(const std::vector<int>& stamps) {
    for (const int stamp : stamps) synchronizer_.addImage(stamp, std::make_shared<int>(stamp));
  }
  void frames(const std::vector<int>& stamps) {
    for (const int stamp : stamps) synchronizer_.addFrame(stamp, stamp, now_);
  }
  /// All frames returned now: "7 " for a frame with its image, "7- " for one without.
  std::string matches(bool may_wait = true) {
    std::string text;
    while (const auto match = synchronizer_.next(now_, may_wait)) {
      if (match->image) {
        EXPECT_EQ(*match->image, match->frame);
      }
      text += std::to_string(match->frame) + (match->image ? " " : "- ");
    }
    return text;
  }

  Synchronizer synchronizer_{limits()};
  Synchronizer::Clock::time_point now_;
};

TEST_F(FrameImageSynchronization, ReturnsAFrameAtOnceIfItsImageArrived) {
  images({1, 2, 3});
  frames({1, 3});
  EXPECT_EQ(matches(), "1 3 ");
}

TEST_F(FrameImageSynchronization, ReturnsAFrameAtOnceIfNoImageEverArrived) {
  frames({1, 2});
  EXPECT_EQ(matches(), "1- 2- ");
}

TEST(FrameImageSynchronizer, FramesWaitByDefault) {
  Synchronizer synchronizer({});
  const Synchronizer::Clock::time_point now;
  synchronizer.addImage(0, std::make_shared<int>(0));
  for (int stamp = 1; stamp <= 11; ++stamp) {
    EXPECT_FALSE(synchronizer.next(now)) << stamp;
    synchronizer.addFrame(stamp, stamp, now);
  }
  EXPECT_TRUE(synchronizer.next(now)) << "more than ten";
  EXPECT_FALSE(synchronizer.next(now));
}

TEST_F(FrameImageSynchronization, FramesWaitInOrderForLaterImages) {
  images({1});
  frames({1, 2, 3});
  EXPECT_EQ(matches(), "1 ");
  images({2});
  EXPECT_EQ(matches(), "2 ");
  images({3});
  EXPECT_EQ(matches(), "3 ");
}

TEST_F(FrameImageSynchronization, ReturnsAFrameAloneOnceALaterImageArrived) {
  images({1});
  frames({1, 2, 3});
  EXPECT_EQ(matches(), "1 ");
  images({3});
  EXPECT_EQ(matches(), "2- 3 ");
}

TEST_F(FrameImageSynchronization, ReturnsAFrameAloneWhenTooManyWait) {
  images({1});
  frames({1, 2, 3, 4, 5});
  EXPECT_EQ(matches(), "1 2- ");
  images({3, 4, 5});
  EXPECT_EQ(matches(), "3 4 5 ");
}

TEST_F(FrameImageSynchronization, StopsWaitingAfterATimeoutUntilImagesArriveAgain) {
  images({1});
  frames({1, 2});
  EXPECT_EQ(matches(), "1 ");
  now_ += std::chrono::milliseconds(499);
  frames({3});
  EXPECT_EQ(matches(), "");
  now_ += std::chrono::milliseconds(1);
  EXPECT_EQ(matches(), "2- 3- ");
  frames({4});
  EXPECT_EQ(matches(), "4- ");
  images({4});  // late
  frames({5});
  EXPECT_EQ(matches(), "");
  images({5});
  EXPECT_EQ(matches(), "5 ");
}

TEST_F(FrameImageSynchronization, StoresABoundedNumberOfImages) {
  images({1, 2, 3, 4, 5, 6});
  frames({1, 2, 6});
  EXPECT_EQ(matches(), "1- 2 6 ");
}

TEST_F(FrameImageSynchronization, ReleasesImagesUpToTheFrame) {
  std::vector<std::weak_ptr<int>> kept;
  for (int stamp = 1; stamp <= 4; ++stamp) {
    const auto image = std::make_shared<int>(stamp);
    kept.push_back(image);
    synchronizer_.addImage(stamp, image);
  }
  frames({3});
  EXPECT_EQ(matches(), "3 ");
  for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(kept[i].expired()) << i;
  EXPECT_FALSE(kept[3].expired());
}

TEST_F(FrameImageSynchronization, MatchesOnBothSidesOfAClockJump) {
  // A looped bag, whose images overtake its frames.
  images({98, 99, 1, 2});
  frames({98, 99});
  EXPECT_EQ(matches(), "98 99 ");
  synchronizer_.jumpBack(1);
  frames({1, 2});
  EXPECT_EQ(matches(), "1 2 ");
}

// As when a player goes back by a few images.
TEST_F(FrameImageSynchronization, MatchesTheImageFromAfterAClockJump) {
  images({1, 2});
  const auto again = std::make_shared<int>(1);
  synchronizer_.addImage(1, again);
  synchronizer_.jumpBack(1);
  frames({1});
  const auto match = synchronizer_.next(now_);
  ASSERT_TRUE(match);
  EXPECT_EQ(match->image, again);
}

TEST_F(FrameImageSynchronization, AClockJumpDropsTheImagesBeforeIt) {
  images({98, 99});
  frames({97, 98, 100});
  EXPECT_EQ(matches(), "97- 98 ");
  EXPECT_EQ(matches(false), "100- ");
  images({101});
  synchronizer_.jumpBack(1);
  frames({1});  // waits: image 101, from before the jump, must not count as a later one
  EXPECT_EQ(matches(), "");
  images({1});
  EXPECT_EQ(matches(), "1 ");
}

}  // namespace
}  // namespace ground_scale_vo
