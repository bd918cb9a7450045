#include "vo/tracking.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "support/texture.hpp"
#include "vo/corners.hpp"
#include "vo/lucas_kanade.hpp"

namespace gsv {
namespace {

using test::blurredNoise;

std::vector<cv::Point2f> detect(const CornerDetector& detector, const cv::Mat& image,
                                const std::vector<cv::Point2f>& occupied = {}) {
  return detector.detect(trackingPyramid(image), occupied);
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
    const CornerDetector tracker(options, {});
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
    EXPECT_GT(detect(CornerDetector({}, {}), test::waves(40, turned)).size(), 200u);
    EXPECT_LT(detect(CornerDetector({}, {}), test::waves(12, turned)).size(), 10u);
  }
}

// 12.7 megapixels: the second level of the pyramid has 0.8, the first 3.2.
TEST(FeatureDetection, InALargeImageFindsTheCornersOfASmallerOne) {
  cv::Mat image;
  cv::resize(blurredNoise(1), image, {}, 8, 8, cv::INTER_CUBIC);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(2400, 640, 1600, 800);
  mask(region).setTo(0);
  const CornerDetector tracker({}, {}), masked({}, mask);
  const ImagePyramid pyramid = trackingPyramid(image);
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
  const auto all = detect(CornerDetector({}, {}), image);
  const cv::Rect region(300, 80, 200, 100);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(1));  // any value but 0 is scene
  mask(region).setTo(0);
  const auto allowed = detect(CornerDetector({}, mask), image);
  for (const cv::Point2f& u : allowed) {
    EXPECT_GT(distanceFrom(region, u), kTrackedSide / 2);
  }
  EXPECT_GT(allowed.size(), all.size() * 7 / 10);
}

TEST(FeatureTracker, DropsPointsThatLeaveTheImageOrEnterTheMask) {
  constexpr float kShift = 30;
  const cv::Mat next = test::moved(blurredNoise(3), kShift, 0);
  cv::Mat mask(next.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(400, 0, 100, next.rows);
  mask(region).setTo(0);
  const auto from = test::gridPixels(next.size(), 12, 16);
  auto predicted = from;
  for (cv::Point2f& u : predicted) u.x += kShift;
  const auto trackWith = [&](const cv::Mat& tracked_mask) {
    return trackPoints(trackingPyramid(blurredNoise(3)), trackingPyramid(next), from, predicted,
                       CornerDetector({}, tracked_mask).allowed());
  };
  const auto all = trackWith({}), masked = trackWith(mask);
  int entered = 0, remained = 0, left = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (from[i].x + kShift > 800) {
      ++left;
      EXPECT_FALSE(all[i] && all[i]->x > 799);
    }
    if (!all[i]) continue;
    const double distance = distanceFrom(region, *all[i]);
    if (distance < 5) {
      ++entered;
      EXPECT_FALSE(masked[i]) << all[i]->x;
    } else if (distance > 6) {
      ++remained;
      EXPECT_TRUE(masked[i]) << all[i]->x;
    }
  }
  EXPECT_GT(left, 10);
  EXPECT_GT(entered, 20);
  EXPECT_GT(remained, 200);
}

/// Blurred noise (grey 50-100), shifted left by shift_px.
cv::Mat scene(int shift_px = 0) {
  cv::Mat noise(24, 80 + 20, CV_8UC1);
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(noise, noise, {}, 1.5);
  cv::normalize(noise, noise, 50, 100, cv::NORM_MINMAX);
  return noise(cv::Rect(shift_px, 0, 80, 24)).clone();
}

TEST(Exposure, ReportsNoStepForOtherChanges) {
  EXPECT_EQ(exposureStep(scene(), scene()), 1);
  EXPECT_EQ(exposureStep(scene(), scene(7)), 1) << "motion";
  EXPECT_EQ(exposureStep(scene(), applyGain(scene(), 1.15)), 1) << "too small";
  EXPECT_EQ(exposureStep(applyGain(scene(), 0.3), applyGain(scene(), 1.8)), 1) << "too large";
  EXPECT_EQ(exposureStep(scene(), applyGain(scene(), 0)), 1) << "black";
  EXPECT_EQ(exposureStep(scene(), cv::Mat(24, 80, CV_8UC1, cv::Scalar(255))), 1) << "white";
  cv::Mat half = scene();
  half.colRange(0, 45) *= 0.4;
  EXPECT_EQ(exposureStep(scene(), half), 1) << "a dark object in front of half of the image";
  cv::Mat other(24, 80, CV_8UC1);
  cv::RNG(8).fill(other, cv::RNG::UNIFORM, 10, 120);
  EXPECT_EQ(exposureStep(scene(), other), 1) << "another scene";
  EXPECT_EQ(applyGain(scene(), 100).at<unsigned char>(5, 5), 255) << "saturates";
}

// Also from a wrong prediction, 40 px to the left.
TEST(LucasKanade, AgreesWithOpenCv) {
  const cv::Mat image = test::blurredNoise(7), next = test::moved(image, 3.3, -1.6, 1.5, 1.04);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
  mask(cv::Rect(40, 40, image.cols - 80, image.rows - 80)) = 255;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(image, corners, 300, 0.01, 8, mask);
  std::vector<cv::Point2f> reference = corners, wrong = corners;
  for (cv::Point2f& u : wrong) u.x -= 40;
  std::vector<unsigned char> status;
  cv::calcOpticalFlowPyrLK(image, next, corners, reference, status, cv::noArray(),
                           {kTrackedSide, kTrackedSide}, kPyramidLevels,
                           {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-3},
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  for (const bool is_wrong : {false, true}) {
    const auto tracks = trackPoints(trackingPyramid(image), trackingPyramid(next), corners,
                                    is_wrong ? wrong : corners, {});
    std::size_t equal = 0;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      equal += tracks[i] && status[i] && cv::norm(*tracks[i] - reference[i]) < 0.02;
    }
    EXPECT_GT(equal, corners.size() * (is_wrong ? 6 : 8) / 10);
  }
}

TEST(LucasKanade, DoesNotFindPointsWithoutTexture) {
  const auto isTracked = [](const cv::Mat& image) {
    const ImagePyramid pyramid = trackingPyramid(image);
    return trackPoints(pyramid, pyramid, {{400, 124}}, {}, {})[0].has_value();
  };
  EXPECT_FALSE(isTracked(cv::Mat(248, 800, CV_8UC1, cv::Scalar(90))));
  for (const bool turned : {false, true}) {
    for (const double across : {60.0, 3.0, 0.3}) {
      EXPECT_EQ(isTracked(test::waves(across, turned)), across > 1) << across << turned;
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
  std::vector<cv::Point2f> all, guesses;
  for (const cv::Point2f& u : test::gridPixels({73, 49}, 0, 3)) {
    all.push_back(u - cv::Point2f(5.7f, 5.4f));
    guesses.push_back(all.back() + cv::Point2f(0.4f, -0.3f));
  }
  for (const cv::Mat& image : {test::blurredNoise(7)({100, 100, 61, 37}).clone(), squares}) {
    ImagePyramid pyramid = trackingPyramid(image);
    pyramid.levels.resize(1);  // the squares repeat themselves
    const auto tracks = trackPoints(pyramid, pyramid, all, guesses, {});
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!inside.contains(all[i])) continue;
      ASSERT_TRUE(tracks[i]) << all[i];
      EXPECT_LT(cv::norm(*tracks[i] - all[i]), 0.02) << all[i];
    }
  }
}

}  // namespace
}  // namespace gsv
