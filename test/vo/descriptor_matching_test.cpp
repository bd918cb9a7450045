#include "vo/descriptor_matching.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

namespace ground_scale_vo {
namespace {

cv::Mat describedTexture(std::uint64_t seed) {
  cv::Mat image(248, 400, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 2);
  return image;
}

const cv::Point2f kPoint(200, 120);

TEST(DescriptorMatching, AMatchIsTheBestInBothDirections) {
  const cv::Mat image = describedTexture(1);
  const Descriptors twice(image, {kPoint, kPoint}), once(image, {kPoint});
  const auto matches = matchDescriptors(twice, once);
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].from, 0u);
  EXPECT_EQ(matches[0].to, 0u);
}

TEST(DescriptorMatching, AMatchIsDistinctlyBetterThanTheSecondBest) {
  const cv::Mat image = describedTexture(1);
  const Descriptors once(image, {kPoint}), twice(image, {kPoint, kPoint});
  EXPECT_TRUE(matchDescriptors(once, twice).empty());
  const Descriptors other(image, {{100, 60}, kPoint});
  const auto matches = matchDescriptors(once, other);
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].to, 1u);
}

// Two points near each one of the first image are about equally similar to it.
TEST(DescriptorMatching, TheOrderOfThePointsIsIrrelevant) {
  const cv::Mat image = describedTexture(1);
  std::vector<cv::Point2f> points, near, reversed;
  for (int x = 50; x < 350; x += 15) {
    const cv::Point2f u(static_cast<float>(x), 120);
    points.push_back(u);
    near.insert(near.end(), {u - cv::Point2f(1, 0), u + cv::Point2f(1, 0)});
  }
  reversed.assign(near.rbegin(), near.rend());
  const auto matchesOf = [&](const std::vector<cv::Point2f>& to) {
    std::vector<std::pair<std::size_t, cv::Point2f>> matches;
    const Descriptors from(image, points);
    for (const DescriptorMatch& match : matchDescriptors(from, {image, to})) {
      matches.emplace_back(match.from, to[match.to]);
    }
    return matches;
  };
  EXPECT_LT(matchesOf(near).size(), points.size());
  EXPECT_TRUE(matchesOf(near) == matchesOf(reversed));
}

TEST(DescriptorMatching, UnrelatedDescriptorsDoNotMatch) {
  const Descriptors a(describedTexture(1), {kPoint}), b(describedTexture(2), {kPoint});
  EXPECT_TRUE(matchDescriptors(a, b).empty());
}

TEST(DescriptorMatching, MatchesAreWithinTheRadiusOfTheirCentres) {
  const cv::Mat image = describedTexture(1);
  const Descriptors points(image, {kPoint});
  const auto matchesAround = [&](const cv::Point2f& centre) {
    return matchDescriptors(points, points, {{centre}, 10}).size();
  };
  EXPECT_EQ(matchesAround(kPoint + cv::Point2f(0, 9.9f)), 1u);
  EXPECT_EQ(matchesAround(kPoint + cv::Point2f(0, 10.1f)), 0u);
  const Descriptors two(image, {kPoint, {100, 60}});
  EXPECT_EQ(matchDescriptors(two, two, {two.points(), 10}).size(), 2u);
}

TEST(DescriptorMatching, MatchesPointsOfAnotherSize) {
  const cv::Mat image = describedTexture(3);
  const double scale = 1.9;  // about the square of the ratio between neighbouring scales
  cv::Mat larger;
  cv::resize(image, larger, {}, scale, scale, cv::INTER_CUBIC);
  std::vector<cv::Point2f> points, in_larger;
  for (int y = 50; y < 200; y += 15) {
    for (int x = 50; x < 350; x += 15) {
      points.emplace_back(x, y);
      in_larger.emplace_back(scale * (x + 0.5) - 0.5, scale * (y + 0.5) - 0.5);
    }
  }
  const Descriptors a(image, points), b(larger, in_larger);
  for (const auto& matches : {matchDescriptors(a, b), matchDescriptors(b, a)}) {
    EXPECT_GT(matches.size(), points.size() / 2);
    for (const DescriptorMatch& match : matches) EXPECT_EQ(match.from, match.to);
  }
}

TEST(DescriptorMatching, PointsMoveLikeTheMatchesNearest) {
  // The points on the left move to the place of those on the right, and these move down a little.
  const auto moved = [](const cv::Point2f& u) {
    return u + (u.x < 200 ? cv::Point2f(250, 2) : cv::Point2f(-5, 3));
  };
  std::vector<cv::Point2f> from, to;
  std::vector<DescriptorMatch> matches;
  for (int y = 0; y < 200; y += 20) {
    for (int x = 0; x < 400; x += 20) {
      from.emplace_back(x, y);
      to.push_back(moved(from.back()));
      if ((x + y) % 40 == 0) matches.push_back({from.size() - 1, to.size() - 1});
    }
  }
  const auto predicted = predictPixels(from, to, matches);
  ASSERT_EQ(predicted.size(), from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (std::abs(from[i].x - 200) < 60) continue;
    EXPECT_EQ(predicted[i], moved(from[i])) << from[i];
  }
}

}  // namespace
}  // namespace ground_scale_vo
