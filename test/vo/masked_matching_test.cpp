// The search for the pose after an interruption does not use masked regions.

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "support/scene.hpp"
#include "vo/descriptor_matching.hpp"
#include "vo/scaled_patches.hpp"

namespace ground_scale_vo {
namespace {

const cv::Rect kMasked(300, 60, 200, 100);

cv::Mat maskedTexture(std::uint64_t seed) {
  cv::Mat image(248, 800, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 2);
  return image;
}

/// The same outside of kMasked.
cv::Mat changedInside(const cv::Mat& image) {
  cv::Mat changed = image.clone();
  maskedTexture(99)(kMasked).copyTo(changed(kMasked));
  return changed;
}

cv::Mat mask() {
  cv::Mat mask(248, 800, CV_8UC1, cv::Scalar(255));
  mask(kMasked).setTo(0);
  return mask;
}

TEST(MaskedMatching, DescriptorsDoNotDependOnMaskedPixels) {
  const cv::Mat image = maskedTexture(1);
  std::vector<cv::Point2f> points;
  for (int y = 40; y < 220; y += 7) {
    for (int x = 40; x < 760; x += 7) points.emplace_back(x, y);
  }
  // Two descriptors of one point differ by 0 bits where neither depends on the region; a point
  // without any descriptor differs in all bits from every other.
  const auto differing = [&](const Descriptors& a, const Descriptors& b) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const int bits = a.distance(i, b, i);
      count += bits > 0 && bits < 256;
    }
    return count;
  };
  const cv::Mat other = changedInside(image);
  EXPECT_GT(differing({image, points}, {other, points}), 300u);
  const Descriptors masked(image, points, mask());
  const Descriptors masked_other(other, points, mask());
  EXPECT_EQ(differing(masked, masked_other), 0u);
  // A smaller image is compared with the coarser scales, which reach farther.
  constexpr float kSize = 0.55f;
  cv::Mat smaller;
  cv::resize(image, smaller, {}, kSize, kSize, cv::INTER_AREA);
  std::vector<cv::Point2f> points_in_smaller;
  for (const cv::Point2f& point : points) points_in_smaller.push_back(kSize * point);
  const Descriptors small(smaller, points_in_smaller);
  std::size_t different = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    different += masked.distance(i, small, i) != masked_other.distance(i, small, i);
  }
  EXPECT_EQ(different, 0u);
  EXPECT_GT(matchDescriptors(masked, {image, points}).size(), 1000u);
}

class MaskedPatches : public testing::Test {
 protected:
  static ScaledPatches patches(const cv::Mat& from, const cv::Mat& to) {
    return {test::testCamera(), from, to, mask(), 400};
  }
  const cv::Mat image_ = maskedTexture(2);
};

TEST_F(MaskedPatches, AreNotTakenFromTheMaskedRegion) {
  const cv::Mat other = changedInside(image_);
  ScaledPatches a = patches(image_, image_), b = patches(other, image_);
  int compared = 0;
  for (int size = -3; size <= 3; size += 3) {
    for (int x = 200; x < 600; x += 9) {
      for (int y = 40; y < 200; y += 9) {
        cv::Rect region(150, 10, 9, 9), same = region;
        const cv::Mat correlation = a.correlate({x, y}, size, &region);
        const cv::Mat from_other = b.correlate({x, y}, size, &same);
        ASSERT_EQ(correlation.empty(), from_other.empty());
        if (kMasked.contains({x, y})) {
          EXPECT_TRUE(correlation.empty());
        }
        if (correlation.empty()) continue;
        ++compared;
        EXPECT_EQ(cv::norm(correlation, from_other, cv::NORM_INF), 0) << x << ' ' << y;
      }
    }
  }
  EXPECT_GT(compared, 500);
}

TEST_F(MaskedPatches, AreNotFoundInTheMaskedRegion) {
  ScaledPatches a = patches(image_, image_), b = patches(image_, changedInside(image_));
  cv::Rect everywhere({0, 0}, a.size()), region = everywhere;
  const Eigen::Vector2d u(100, 60);
  const cv::Mat in_a = a.correlate(u, 0, &region), in_b = b.correlate(u, 0, &everywhere);
  ASSERT_FALSE(in_a.empty());
  EXPECT_LT(cv::norm(in_a, in_b, cv::NORM_INF), 1e-3);  // cv::matchTemplate uses a DFT
  const cv::Mat allowed = a.allowed(region);
  int masked = 0;
  for (int y = 0; y < in_a.rows; ++y) {
    for (int x = 0; x < in_a.cols; ++x) {
      const cv::Point at = region.tl() + cv::Point(x, y);
      EXPECT_EQ(a.isMasked(at), allowed.at<unsigned char>(y, x) == 0);
      if (kMasked.contains(2 * at)) {
        EXPECT_TRUE(a.isMasked(at)) << at;
      }
      if (!a.isMasked(at)) continue;
      ++masked;
      EXPECT_EQ(in_a.at<float>(y, x), -1);
    }
  }
  EXPECT_GE(masked, 100 * 50);
  EXPECT_LE(masked, 112 * 62);
}

}  // namespace
}  // namespace ground_scale_vo
