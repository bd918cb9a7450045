#include "ground_scale_vo/vo/feature_tracker.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <future>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "vo/patch_arithmetic.hpp"

namespace ground_scale_vo {
namespace {

/// Blurred noise over the full range of grey values.
cv::Mat trackedTexture(int seed) {
  cv::Mat noise(248, 800, CV_8UC1), image;
  cv::RNG generator(static_cast<std::uint64_t>(seed));
  generator.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, image, {0, 0}, 2.0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

std::vector<cv::Point2f> detect(const FeatureTracker& tracker, const cv::Mat& image,
                                const std::vector<cv::Point2f>& occupied) {
  return tracker.detect(tracker.pyramid(image), occupied);
}

cv::Mat shifted(const cv::Mat& image, double dx, double dy) {
  cv::Mat result;
  const cv::Mat M = (cv::Mat_<double>(2, 3) << 1, 0, dx, 0, 1, dy);
  cv::warpAffine(image, result, M, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return result;
}

TEST(FeatureTracker, findsCornersEverywhereInATexturedImage) {
  const FeatureTracker tracker({});
  const auto corners = detect(tracker, trackedTexture(1), {});
  ASSERT_GT(corners.size(), 400u);
  int quarter[4] = {0, 0, 0, 0};
  for (const auto& u : corners) ++quarter[(u.x > 400 ? 1 : 0) + (u.y > 124 ? 2 : 0)];
  for (const int n : quarter) EXPECT_GT(n, static_cast<int>(corners.size()) / 6);
}

TEST(FeatureTracker, cornersAreLocalMaximaApartFromEachOther) {
  FeatureTracker::Options options;
  const cv::Mat image = trackedTexture(1);
  cv::Mat strength, largest;
  cv::cornerMinEigenVal(image, strength, 5, 3);
  cv::dilate(strength, largest, cv::Mat::ones(3, 3, CV_8U));
  for (const double cell_size : {options.cell_size, 0.005}) {  // 10 and 4 px
    options.cell_size = cell_size;
    const auto corners = detect(FeatureTracker(options), image, {});
    const double distance = std::floor(std::max(8.0, cell_size * image.cols) / 2);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const cv::Point at(corners[i]);
      EXPECT_GE(strength.at<float>(at), 0.999f * largest.at<float>(at)) << at;
      for (std::size_t k = 0; k < i; ++k) EXPECT_GE(cv::norm(corners[i] - corners[k]), distance);
    }
  }
}

TEST(FeatureTracker, findsNothingWithoutTexture) {
  const FeatureTracker tracker({});
  EXPECT_TRUE(detect(tracker, cv::Mat(248, 800, CV_8UC1, cv::Scalar(90)), {}).empty());
  EXPECT_TRUE(detect(tracker, cv::Mat(4, 4, CV_8UC1, cv::Scalar(90)), {}).empty());
}

TEST(FeatureTracker, skipsOccupiedCells) {
  const FeatureTracker tracker({});
  const cv::Mat image = trackedTexture(2);
  const auto first = detect(tracker, image, {});
  const auto second = detect(tracker, image, first);
  for (const auto& u : second) {
    for (const auto& v : first) EXPECT_GT(cv::norm(u - v), 3.0);
  }
  EXPECT_LT(second.size(), first.size() / 3);
}

// Existing features exclude a disc of half a cell around them; here the discs cover a free cell.
TEST(FeatureTracker, skipsAFreeCellThatItsNeighboursMask) {
  FeatureTracker::Options options;
  options.min_corner_strength = 0;
  options.window_px = 9;
  options.cell_size = 10.0 / 800;
  // Features all around the cell [205, 214] x [105, 114] (the grid starts at a border of 5 px),
  // none in it.
  std::vector<cv::Point2f> occupied;
  for (int i = 0; i < 12; ++i) {
    const auto along = static_cast<float>(i);
    occupied.insert(occupied.end(), {{204 + along, 104}, {204 + along, 115}});
    occupied.insert(occupied.end(), {{204, 104 + along}, {215, 104 + along}});
  }
  std::vector<cv::Point2f> corners;
  ASSERT_NO_THROW(corners = detect(FeatureTracker(options), trackedTexture(3), occupied));
  EXPECT_GT(corners.size(), 300u);
  for (const cv::Point2f& u : corners) {
    EXPECT_FALSE(u.x > 204 && u.x < 215 && u.y > 104 && u.y < 115) << u;
  }
}

TEST(FeatureTracker, rejectsEdges) {
  // Diagonal bars with a little noise, and a patch of corners.
  cv::Mat image(248, 800, CV_8UC1);
  cv::RNG generator(5);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const bool bright = ((2 * x + 3 * y) / 120) % 2 == 0;
      image.at<unsigned char>(y, x) =
          static_cast<unsigned char>((bright ? 180 : 60) + generator.uniform(-3, 4));
    }
  }
  trackedTexture(6)(cv::Rect(300, 80, 120, 90)).copyTo(image(cv::Rect(300, 80, 120, 90)));
  FeatureTracker::Options options;
  const auto outside = [](const std::vector<cv::Point2f>& corners) {
    return std::count_if(corners.begin(), corners.end(), [](const cv::Point2f& u) {
      return !cv::Rect2f(290, 70, 140, 110).contains(u);
    });
  };
  const auto corners = detect(FeatureTracker(options), image, {});
  EXPECT_GT(corners.size() - static_cast<std::size_t>(outside(corners)), 30u);
  EXPECT_LT(outside(corners), 10);
  options.min_corner_ratio = 0;
  EXPECT_GT(outside(detect(FeatureTracker(options), image, {})), 200)
      << "the test image has too few edge pixels that pass without the ratio test";
}

TEST(FeatureTracker, measuresAShiftToATenthOfAPixel) {
  const FeatureTracker tracker({});
  const cv::Mat a = trackedTexture(3), b = shifted(a, 6.3, -2.7);
  const auto corners = detect(tracker, a, {});
  const auto tracks = tracker.track(tracker.pyramid(a), tracker.pyramid(b), corners, corners);
  std::vector<double> error;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (tracks.ok[i])
      error.push_back(cv::norm(tracks.points[i] - corners[i] - cv::Point2f(6.3f, -2.7f)));
  }
  ASSERT_GT(error.size(), corners.size() * 8 / 10);
  std::sort(error.begin(), error.end());
  EXPECT_LT(error[error.size() / 2], 0.1);
  EXPECT_LT(error[error.size() * 95 / 100], 0.3);
}

TEST(FeatureTracker, recoversFromAWrongPrediction) {
  const FeatureTracker tracker({});
  const cv::Mat a = trackedTexture(4), b = shifted(a, 4, 0);
  const auto corners = detect(tracker, a, {});
  auto wrong = corners;
  for (auto& u : wrong) u.x -= 40;
  const auto tracks = tracker.track(tracker.pyramid(a), tracker.pyramid(b), corners, wrong);
  std::size_t right = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    right += tracks.ok[i] && cv::norm(tracks.points[i] - corners[i] - cv::Point2f(4, 0)) < 0.5;
  }
  EXPECT_GT(right, corners.size() * 6 / 10);
}

TEST(FeatureTracker, rejectsPointsThatLeaveTheImage) {
  const FeatureTracker tracker({});
  const cv::Mat a = trackedTexture(5), b = shifted(a, 60, 0);
  const auto corners = detect(tracker, a, {});
  auto predicted = corners;
  for (auto& u : predicted) u.x += 60;
  const auto tracks = tracker.track(tracker.pyramid(a), tracker.pyramid(b), corners, predicted);
  int leaving = 0, tracked_outside = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i].x < 750) continue;
    ++leaving;
    tracked_outside += tracks.ok[i] && tracks.points[i].x > 799;
  }
  EXPECT_GT(leaving, 20);
  EXPECT_EQ(tracked_outside, 0);
}

/// Distance of a pixel from the nearest one of a rectangle, along the farther axis; 0 inside.
double distanceFrom(const cv::Rect& rectangle, const cv::Point2d& u) {
  const cv::Point2d first = rectangle.tl(), last = rectangle.br() - cv::Point(1, 1);
  return std::max({0.0, first.x - u.x, u.x - last.x, first.y - u.y, u.y - last.y});
}

// 12.7 megapixels: the second level of the pyramid has 0.8, the first 3.2.
TEST(FeatureTracker, inALargeImageFindsTheCornersOfASmallerOne) {
  cv::Mat image;
  cv::resize(trackedTexture(1), image, {}, 8, 8, cv::INTER_CUBIC);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(2400, 640, 1600, 800);
  mask(region).setTo(0);
  const FeatureTracker tracker({}), masked({}, mask);
  const auto corners = detect(tracker, image, {});
  const ImagePyramid pyramid = tracker.pyramid(image);
  auto expected = detect(tracker, pyramid.levels[2], {});
  for (cv::Point2f& u : expected) u *= 4;
  ASSERT_GT(corners.size(), 400u);
  EXPECT_EQ(corners, expected);
  EXPECT_LT(tracker.detect(pyramid, corners).size(), corners.size() / 3);
  for (const cv::Point2f& u : detect(masked, image, {})) EXPECT_GT(distanceFrom(region, u), 4);
}

TEST(FeatureTracker, findsCornersInALargeImageWithFewLevels) {
  FeatureTracker::Options options;
  for (options.pyramid_levels = 0; options.pyramid_levels < 2; ++options.pyramid_levels) {
    const double scale = 2.8 * (1 << options.pyramid_levels);  // the last level is large, too
    cv::Mat image;
    cv::resize(trackedTexture(1), image, {}, scale, scale, cv::INTER_CUBIC);
    EXPECT_GT(detect(FeatureTracker(options), image, {}).size(), 100u) << scale;
  }
}

TEST(FeatureTracker, instancesInThreadsAreIndependent) {
  const auto isRepeatable = [](int width) {
    cv::Mat image;
    cv::resize(trackedTexture(1), image, {width, 248});
    const FeatureTracker tracker({});
    const auto corners = detect(tracker, image, {});
    for (int i = 0; i < 20; ++i) {
      if (detect(tracker, image, {}) != corners) return false;
    }
    return !corners.empty();
  };
  std::vector<std::future<bool>> threads;
  for (const int width : {800, 500, 640, 320}) {
    threads.push_back(std::async(std::launch::async, isRepeatable, width));
  }
  for (std::future<bool>& thread : threads) EXPECT_TRUE(thread.get());
}

// With a margin: the patch around a corner, here of 9 px, shows no masked pixel.
TEST(FeatureTracker, findsNoCornersWhosePatchTouchesTheMask) {
  const cv::Rect region(300, 80, 200, 100);
  const cv::Mat image = trackedTexture(1);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  mask(region).setTo(0);
  const auto near = [&](const std::vector<cv::Point2f>& corners) {
    return std::count_if(corners.begin(), corners.end(),
                         [&](const cv::Point2f& u) { return distanceFrom(region, u) <= 4; });
  };
  const auto all = detect(FeatureTracker({}), image, {});
  const auto allowed = detect(FeatureTracker({}, mask), image, {});
  EXPECT_GT(near(all), 80);
  EXPECT_EQ(near(allowed), 0);
  EXPECT_GT(allowed.size(), all.size() - static_cast<std::size_t>(near(all)) - 30);
  FeatureTracker::Options large_patches;
  large_patches.window_px = 21;
  for (const cv::Point2f& u : detect(FeatureTracker(large_patches, mask), image, {})) {
    EXPECT_GT(distanceFrom(region, u), 10);
  }
  // One masked pixel is enough, and any value but 0 is scene.
  mask.setTo(1);
  mask.at<unsigned char>(90, 400) = 0;
  const auto almost_all = detect(FeatureTracker({}, mask), image, {});
  for (const cv::Point2f& u : almost_all) EXPECT_GT(distanceFrom({400, 90, 1, 1}, u), 4);
  EXPECT_GT(almost_all.size(), all.size() - 5);
}

TEST(FeatureTracker, dropsFeaturesThatMoveIntoTheMask) {
  const cv::Mat a = trackedTexture(5), b = shifted(a, 30, 0);
  cv::Mat mask(a.size(), CV_8UC1, cv::Scalar(255));
  const cv::Rect region(400, 0, 100, a.rows);
  mask(region).setTo(0);
  const FeatureTracker tracker({}), masked({}, mask);
  const auto corners = detect(masked, a, {});
  auto predicted = corners;
  for (auto& u : predicted) u.x += 30;
  const auto all = tracker.track(tracker.pyramid(a), tracker.pyramid(b), corners, predicted);
  const auto tracks = masked.track(masked.pyramid(a), masked.pyramid(b), corners, predicted);
  int entered = 0, remained = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (!all.ok[i]) continue;
    const bool touches = distanceFrom(region, all.points[i]) < 5;
    (touches ? entered : remained) += 1;
    if (touches) {
      EXPECT_FALSE(tracks.ok[i]) << tracks.points[i];
    } else if (distanceFrom(region, all.points[i]) > 6) {
      EXPECT_TRUE(tracks.ok[i]) << tracks.points[i];
    }
  }
  EXPECT_GT(entered, 20);
  EXPECT_GT(remained, 200);
}

TEST(FeatureTracker, aBlankImageGivesNoTracks) {
  const FeatureTracker tracker({});
  const cv::Mat a = trackedTexture(5), b(a.size(), CV_8UC1, cv::Scalar(0));
  const auto corners = detect(tracker, a, {});
  const auto tracks = tracker.track(tracker.pyramid(a), tracker.pyramid(b), corners, corners);
  EXPECT_EQ(std::count(tracks.ok.begin(), tracks.ok.end(), 1), 0);
}

TEST(FeatureTracker, acceptsAnEmptyList) {
  const FeatureTracker tracker({});
  const auto pyramid = tracker.pyramid(trackedTexture(7));
  EXPECT_TRUE(tracker.track(pyramid, pyramid, {}, {}).points.empty());
}

TEST(FeatureTracker, rejectsOptionsOutOfRange) {
  FeatureTracker::Options options;
  options.window_px = 10;
  try {
    FeatureTracker{options};
    ADD_FAILURE() << "accepted";
  } catch (const OptionError& error) {
    EXPECT_STREQ(error.what(), "tracker/window_px must be odd");
  }
  options.window_px = kMaxPatchSide;
  EXPECT_NO_THROW(FeatureTracker{options});
  options.window_px += 2;
  EXPECT_THROW(FeatureTracker{options}, OptionError) << "has no room for larger ones";
  options = {};
  options.cell_size = 0;
  EXPECT_THROW(FeatureTracker{options}, OptionError);
  options = {};
  options.forward_backward_px = -1;
  EXPECT_THROW(FeatureTracker{options}, OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
