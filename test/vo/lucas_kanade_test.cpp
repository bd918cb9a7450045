#include "vo/lucas_kanade.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <optional>

#include "support/texture.hpp"

namespace ground_scale_vo {
namespace {

using Pyramid = std::vector<cv::Mat>;

constexpr int kLevels = 4;

/// Searches the patch around each point of a pyramid, starting from `points`, which become the
/// results. Returns which have been found.
std::vector<unsigned char> trackAll(const Pyramid& from, const Pyramid& to,
                                    const std::vector<cv::Point2f>& from_points, int levels,
                                    std::vector<cv::Point2f>* points) {
  PyramidSearch search(from, to);
  std::vector<unsigned char> found;
  for (std::size_t i = 0; i < from_points.size(); ++i) {
    search.setPatch(from_points[i]);
    found.push_back(search.find(levels, &(*points)[i]));
  }
  return found;
}

/// The place of the patch at `point` of an image in the next one, if found in the full resolution.
std::optional<cv::Point2f> track(const cv::Mat& image, const cv::Mat& next,
                                 const cv::Point2f& point, const cv::Point2f& guess) {
  std::vector<cv::Point2f> points{guess};
  const auto found =
      trackAll(trackingPyramid(image, 0), trackingPyramid(next, 0), {point}, 0, &points);
  return found[0] ? std::make_optional(points[0]) : std::nullopt;
}

std::vector<cv::Point2f> cornersOf(const cv::Mat& image) {
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
  mask(cv::Rect(40, 40, image.cols - 80, image.rows - 80)) = 255;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(image, corners, 300, 0.01, 8, mask);
  return corners;
}

TEST(LucasKanade, AgreesWithOpenCv) {
  const cv::Mat image = test::blurredNoise(7), next = test::moved(image, 3.3, -1.6, 1.5, 1.04);
  const std::vector<cv::Point2f> corners = cornersOf(image);
  std::vector<cv::Point2f> points = corners, reference = corners;
  const auto found = trackAll(trackingPyramid(image, kLevels), trackingPyramid(next, kLevels),
                              corners, kLevels, &points);
  std::vector<unsigned char> status;
  cv::calcOpticalFlowPyrLK(
      image, next, corners, reference, status, cv::noArray(), {kTrackedSide, kTrackedSide}, kLevels,
      {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-3}, cv::OPTFLOW_USE_INITIAL_FLOW);
  std::size_t equal = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    equal += found[i] && status[i] && cv::norm(points[i] - reference[i]) < 0.02;
  }
  EXPECT_GT(equal, corners.size() * 8 / 10);
}

TEST(LucasKanade, DoesNotFindPointsWithoutTextureOrOutsideTheImage) {
  const cv::Mat image = test::blurredNoise(7);
  EXPECT_TRUE(track(image, image, {400, 124}, {401, 124}));
  const cv::Mat blank(image.size(), CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(track(blank, image, {400, 124}, {400, 124}));
  EXPECT_FALSE(track(image, image, {400, 124}, {-20, 124}));
  EXPECT_FALSE(track(image, image, {400, 124}, {400, 1e9f}));
  for (const bool turned : {false, true}) {
    for (const double across : {60.0, 3.0, 0.3}) {
      const cv::Mat edges = test::waves(across, turned);
      EXPECT_EQ(track(edges, edges, {400, 124}, {400, 124}).has_value(), across > 1)
          << across << turned;
    }
  }
}

// Also patches that overlap the border, at every place of a small image; and with full contrast,
// where the sums must not overflow.
TEST(LucasKanade, TracksPatchesEverywhereInAnImage) {
  cv::Mat squares(37, 61, CV_8UC1);
  for (int y = 0; y < squares.rows; ++y) {
    for (int x = 0; x < squares.cols; ++x) {
      squares.at<unsigned char>(y, x) = (x % 6 < 3) != (y % 6 < 3) ? 0 : 255;
    }
  }
  const cv::Rect2f inside(5, 5, 50, 26);
  std::vector<cv::Point2f> all;
  for (const cv::Point2f& u : test::gridPixels({73, 49}, 0, 3)) {
    all.push_back(u - cv::Point2f(5.7f, 5.4f));
  }
  for (const cv::Mat& image : {test::blurredNoise(7)({100, 100, 61, 37}).clone(), squares}) {
    const Pyramid pyramid = trackingPyramid(image, kLevels);
    std::vector<cv::Point2f> points = all;
    for (cv::Point2f& point : points) point += cv::Point2f(0.4f, -0.3f);
    const auto found = trackAll(pyramid, pyramid, all, 0, &points);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!inside.contains(all[i])) continue;
      EXPECT_TRUE(found[i]) << all[i];
      EXPECT_LT(cv::norm(points[i] - all[i]), 0.02) << all[i];
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
