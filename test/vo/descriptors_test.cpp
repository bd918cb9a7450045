#include "vo/descriptors.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "support/texture.hpp"

namespace gsv {
namespace {

const cv::Size kSize(400, 248);

TEST(DescriptorMatching, MatchesPointsOfAnotherSize) {
  const cv::Mat image = test::blurredNoise(3, kSize);
  const double scale = 1.9;  // about the square of the ratio between neighbouring scales
  cv::Mat larger;
  cv::resize(image, larger, {}, scale, scale, cv::INTER_CUBIC);
  const std::vector<cv::Point2f> points = test::gridPixels(kSize, 50, 15);
  std::vector<cv::Point2f> in_larger;
  for (const cv::Point2d u : points) {
    in_larger.emplace_back(scale * (u.x + 0.5) - 0.5, scale * (u.y + 0.5) - 0.5);
  }
  const Descriptors a(image, points), b(larger, in_larger);
  for (const auto& matches : {matchDescriptors(a, b), matchDescriptors(b, a)}) {
    EXPECT_GT(matches.size(), points.size() / 2);
    for (const DescriptorMatch& match : matches) EXPECT_EQ(match.from, match.to);
  }
}

TEST(DescriptorMatching, DescriptorsDoNotDependOnMaskedPixels) {
  const cv::Rect masked(100, 60, 200, 100);
  const cv::Mat image = test::blurredNoise(1, kSize), other = image.clone();
  test::blurredNoise(99, kSize)(masked).copyTo(other(masked));
  cv::Mat mask(kSize, CV_8UC1, cv::Scalar(255));
  mask(masked).setTo(0);
  const std::vector<cv::Point2f> points = test::gridPixels(kSize, 20, 7);
  const Descriptors reference(test::blurredNoise(5, kSize), points);
  const auto differing = [&](const Descriptors& a, const Descriptors& b) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      count += a.distance(i, reference, i) != b.distance(i, reference, i);
    }
    return count;
  };
  EXPECT_GT(differing({image, points}, {other, points}), 300u);
  const Descriptors in_image(image, points, mask);
  EXPECT_EQ(differing(in_image, {other, points, mask}), 0u);
  EXPECT_GT(matchDescriptors(in_image, {image, points}).size(), 300u);
}

}  // namespace
}  // namespace gsv
