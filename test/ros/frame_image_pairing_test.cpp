#include "ground_scale_vo/ros/frame_image_pairing.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

namespace ground_scale_vo {
namespace {

using Pairing = FrameImagePairing<int, std::shared_ptr<int>>;

/// Frames and images are named by their stamps.
class Pairs : public testing::Test {
 protected:
  static Pairing::Limits limits() {
    Pairing::Limits limits;
    limits.images = 5;
    limits.frames = 3;
    return limits;
  }
  void images(const std::vector<int>& stamps) {
    for (const int stamp : stamps) pairing_.addImage(stamp, std::make_shared<int>(stamp));
  }
  void frames(const std::vector<int>& stamps) {
    for (const int stamp : stamps) pairing_.addFrame(stamp, stamp, now_);
  }
  /// What leaves now: "7" with its image, "7-" without.
  std::string out(bool may_wait = true) {
    std::string text;
    while (const auto pair = pairing_.next(now_, may_wait)) {
      if (pair->image) {
        EXPECT_EQ(*pair->image, pair->frame);
      }
      text += std::to_string(pair->frame) + (pair->image ? " " : "- ");
    }
    return text;
  }

  Pairing pairing_{limits()};
  Pairing::Clock::time_point now_;
};

TEST_F(Pairs, LeaveAtOnceWhenTheImageIsThere) {
  images({1, 2, 3});
  frames({1, 3});
  EXPECT_EQ(out(), "1 3 ");
}

TEST_F(Pairs, LeaveAtOnceWhenNoImageHasEverCome) {
  frames({1, 2});
  EXPECT_EQ(out(), "1- 2- ");
}

TEST_F(Pairs, WaitInOrderForTheImageThatComesLater) {
  images({1});
  frames({1, 2, 3});
  EXPECT_EQ(out(), "1 ");
  images({2});
  EXPECT_EQ(out(), "2 ");
  images({3});
  EXPECT_EQ(out(), "3 ");
}

TEST_F(Pairs, LeaveWithoutTheImageOnceALaterOneCame) {
  images({1});
  frames({1, 2, 3});
  EXPECT_EQ(out(), "1 ");
  images({3});
  EXPECT_EQ(out(), "2- 3 ");
}

TEST_F(Pairs, LeaveWithoutTheImageWhenTooManyWait) {
  images({1});
  frames({1, 2, 3, 4, 5});
  EXPECT_EQ(out(), "1 2- ");
  images({3, 4, 5});
  EXPECT_EQ(out(), "3 4 5 ");
}

TEST_F(Pairs, LeaveInTimeAndWaitAgainOnlyWhenImagesComeAgain) {
  images({1});
  frames({1, 2});
  EXPECT_EQ(out(), "1 ");
  now_ += limits().wait;
  frames({3});
  EXPECT_EQ(out(), "2- 3- ");
  frames({4});
  EXPECT_EQ(out(), "4- ");
  images({4});  // late
  frames({5});
  EXPECT_EQ(out(), "");
  images({5});
  EXPECT_EQ(out(), "5 ");
}

TEST_F(Pairs, KeepABoundedNumberOfImages) {
  images({1, 2, 3, 4, 5, 6});
  frames({1, 2, 6});
  EXPECT_EQ(out(), "1- 2 6 ");
}

TEST_F(Pairs, LetImagesGoWithTheFrameThatIsAsLate) {
  std::vector<std::weak_ptr<int>> kept;
  for (int stamp = 1; stamp <= 4; ++stamp) {
    const auto image = std::make_shared<int>(stamp);
    kept.push_back(image);
    pairing_.addImage(stamp, image);
  }
  frames({3});
  EXPECT_EQ(out(), "3 ");
  for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(kept[i].expired()) << i;
  EXPECT_FALSE(kept[3].expired());
}

TEST_F(Pairs, FindTheImagesOfBothClocksAroundAJump) {
  images({98, 99, 1, 2});  // of a looped bag: the frames come a little later
  frames({98, 99});
  EXPECT_EQ(out(), "98 99 ");
  pairing_.jumpBack(1);
  frames({1, 2});
  EXPECT_EQ(out(), "1 2 ");
}

TEST_F(Pairs, AJumpThrowsTheOldClockAway) {
  images({98, 99});
  frames({97, 98, 100});
  EXPECT_EQ(out(), "97- 98 ");
  EXPECT_EQ(out(false), "100- ");
  images({101});
  pairing_.jumpBack(1);
  frames({1});  // no later image of the old clock says that its own is lost
  EXPECT_EQ(out(), "");
  images({1});
  EXPECT_EQ(out(), "1 ");
}

}  // namespace
}  // namespace ground_scale_vo
