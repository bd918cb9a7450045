#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "support/texture.hpp"
#include "vo/tracking.hpp"

namespace ground_scale_vo {
namespace {

using test::blurredNoise;

std::vector<cv::Point2f> detect(const FeatureTracker& tracker, const cv::Mat& image,
                                const std::vector<cv::Point2f>& occupied = {}) {
  return tracker.detect(tracker.pyramid(image), occupied);
}

/// Distance of a pixel from the nearest one of a rectangle, along the farther axis; 0 inside.
double distanceFrom(const cv::Rect& rectangle, const cv::Point2d& u) {
  const cv::Point2d first = rectangle.tl(), last = rectangle.br() - cv::Point(1, 1);
  return std::max({0.0, first.x - u.x, u.x - last.x, first.y - u.y, u.y - last.y});
}

/// The corners are local maxima of OpenCV's corner strength, everywhere in the image.
void expectCorners(const cv::Mat& image) {
  cv::Mat strength, largest;
  cv::cornerMinEigenVal(image, strength, 5, 3);
  cv::dilate(strength, largest, cv::Mat::ones(3, 3, CV_8U));
  OdometryOptions options;
  for (const double cell_size : {options.cell_size, 0.005}) {
    options.cell_size = cell_size;
    const FeatureTracker tracker(options);
    const auto corners = detect(tracker, image);
    ASSERT_GT(corners.size(), 400u);
    int quarter[4] = {0, 0, 0, 0};
    const double distance = std::floor(std::max(8.0, cell_size * image.cols) / 2);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const cv::Point at(corners[i]);
      ++quarter[(at.x > 400 ? 1 : 0) + (at.y > 124 ? 2 : 0)];
      EXPECT_GE(strength.at<float>(at), 0.999f * largest.at<float>(at)) << at;
      for (std::size_t k = 0; k < i; ++k) EXPECT_GE(cv::norm(corners[i] - corners[k]), distance);
    }
    for (const int n : quarter) EXPECT_GT(n, static_cast<int>(corners.size()) / 6);
    EXPECT_TRUE(detect(tracker, cv::Mat(248, 800, CV_8UC1, cv::Scalar(90))).empty());
    EXPECT_TRUE(detect(tracker, blurredNoise(1, {4, 4})).empty());
    EXPECT_LT(detect(tracker, image, corners).size(), corners.size() / 3);
  }
}

// With little and with full contrast: no sum of gradients overflows.
TEST(FeatureDetection, FindsLocalMaximaEverywhereApartFromEachOther) {
  expectCorners(blurredNoise(1));
  expectCorners(blurredNoise(1, {800, 248}, 3) > 128);
}

TEST(FeatureDetection, RejectsEdges) {
  for (const bool turned : {false, true}) {
    EXPECT_GT(detect(FeatureTracker({}), test::waves(40, turned)).size(), 200u);
    EXPECT_LT(detect(FeatureTracker({}), test::waves(12, turned)).size(), 10u);
  }
}

// 12.7 megapixels: the second level of the pyramid has 0.8, the first 3.2.
TEST(FeatureDetection, InALargeImageFindsTheCornersOfASmallerOne) {
  cv::Mat image;
  cv::resize(blurredNoise(1), image, {}, 8, 8, cv::INTER_CUBIC);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(2400, 640, 1600, 800);
  mask(region).setTo(0);
  const FeatureTracker tracker({}), masked({}, mask);
  const ImagePyramid pyramid = tracker.pyramid(image);
  const auto corners = tracker.detect(pyramid, {});
  auto expected = detect(tracker, pyramid.levels[2]);
  for (cv::Point2f& u : expected) u *= 4;
  EXPECT_GT(corners.size(), 400u);
  EXPECT_EQ(corners, expected);
  for (const cv::Point2f& u : masked.detect(pyramid, {})) EXPECT_GT(distanceFrom(region, u), 4);
}

// The patch around a corner shows no masked pixel.
TEST(FeatureDetection, FindsNoCornersWhosePatchTouchesTheMask) {
  const cv::Mat image = blurredNoise(1);
  const auto all = detect(FeatureTracker({}), image);
  const cv::Rect region(300, 80, 200, 100);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(1));  // any value but 0 is scene
  mask(region).setTo(0);
  const auto allowed = detect(FeatureTracker({}, mask), image);
  for (const cv::Point2f& u : allowed) {
    EXPECT_GT(distanceFrom(region, u), FeatureTracker::kPatchSide / 2);
  }
  EXPECT_GT(allowed.size(), all.size() * 7 / 10);
}

/// Points on a grid, tracked from a textured image to the next.
struct Tracked {
  std::vector<cv::Point2f> from = test::gridPixels({800, 248}, 12, 16);
  FeatureTracker::Tracks tracks;

  /// predicted_x: predicted displacement [px].
  Tracked(const FeatureTracker& tracker, const cv::Mat& next, float predicted_x) {
    std::vector<cv::Point2f> predicted = from;
    for (cv::Point2f& u : predicted) u.x += predicted_x;
    tracks =
        tracker.track(tracker.pyramid(blurredNoise(3)), tracker.pyramid(next), from, predicted);
  }
  /// Errors of the points found, from this displacement [px].
  std::vector<double> errors(const cv::Point2f& displacement) const {
    std::vector<double> result;
    for (std::size_t i = 0; i < from.size(); ++i) {
      if (tracks.ok[i]) result.push_back(cv::norm(tracks.points[i] - from[i] - displacement));
    }
    return result;
  }
};

TEST(FeatureTracker, MeasuresAShiftToATenthOfAPixelAlsoFromAWrongPrediction) {
  const cv::Mat next = test::moved(blurredNoise(3), 6.3, -2.7);
  for (const float predicted_x : {0.f, -40.f}) {
    const Tracked tracked(FeatureTracker({}), next, predicted_x);
    const std::vector<double> errors = tracked.errors({6.3f, -2.7f});
    const auto within = [&](double limit) {
      return std::count_if(errors.begin(), errors.end(), [&](double e) { return e < limit; });
    };
    const auto all = static_cast<double>(tracked.from.size());
    EXPECT_GT(within(0.3), 0.7 * all) << predicted_x;
    EXPECT_GT(within(0.1), 0.4 * all) << predicted_x;
  }
}

TEST(FeatureTracker, DropsPointsThatLeaveTheImageOrEnterTheMask) {
  constexpr float kShift = 30;
  const cv::Mat next = test::moved(blurredNoise(3), kShift, 0);
  cv::Mat mask(next.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(400, 0, 100, next.rows);
  mask(region).setTo(0);
  const Tracked all(FeatureTracker({}), next, kShift);
  const Tracked masked(FeatureTracker({}, mask), next, kShift);
  int entered = 0, remained = 0, left = 0;
  for (std::size_t i = 0; i < all.from.size(); ++i) {
    if (all.from[i].x + kShift > 800) {
      ++left;
      EXPECT_FALSE(all.tracks.ok[i] && all.tracks.points[i].x > 799);
    }
    if (!all.tracks.ok[i]) continue;
    const double distance = distanceFrom(region, all.tracks.points[i]);
    if (distance < 5) {
      ++entered;
      EXPECT_FALSE(masked.tracks.ok[i]) << masked.tracks.points[i];
    } else if (distance > 6) {
      ++remained;
      EXPECT_TRUE(masked.tracks.ok[i]) << masked.tracks.points[i];
    }
  }
  EXPECT_GT(left, 10);
  EXPECT_GT(entered, 20);
  EXPECT_GT(remained, 200);
}

}  // namespace
}  // namespace ground_scale_vo
