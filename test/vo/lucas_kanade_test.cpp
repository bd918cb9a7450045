#include "vo/lucas_kanade.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "ground_scale_vo/common/median.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kSide = 9, kLevels = 4;

/// Blurred noise over the full range of grey levels.
cv::Mat fullRangeTexture() {
  cv::Mat image(248, 800, CV_8UC1);
  cv::RNG generator(7);
  generator.fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 2.0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

/// Searches the patch around each point of a pyramid, starting from `points`, which become the
/// results. Returns which have been found.
std::vector<unsigned char> trackAll(const LucasKanade& lucas_kanade,
                                    const std::vector<cv::Mat>& from,
                                    const std::vector<cv::Mat>& to,
                                    const std::vector<cv::Point2f>& from_points, int levels,
                                    std::vector<cv::Point2f>* points) {
  PyramidSearch search(lucas_kanade, from, to);
  std::vector<unsigned char> found;
  for (std::size_t i = 0; i < from_points.size(); ++i) {
    search.setPatch(from_points[i]);
    found.push_back(search.find(levels, &(*points)[i]));
  }
  return found;
}

/// Rotated about the centre, enlarged and shifted.
cv::Mat motion(double degrees, double factor, double dx, double dy) {
  cv::Mat M = cv::getRotationMatrix2D({400, 124}, degrees, factor);
  M.at<double>(0, 2) += dx;
  M.at<double>(1, 2) += dy;
  return M;
}
cv::Mat moved(const cv::Mat& image, const cv::Mat& M) {
  cv::Mat result;
  cv::warpAffine(image, result, M, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return result;
}

std::vector<cv::Point2f> cornersOf(const cv::Mat& image, int border) {
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
  mask(cv::Rect(border, border, image.cols - 2 * border, image.rows - 2 * border)) = 255;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(image, corners, 300, 0.01, 8, mask);
  return corners;
}

TEST(LucasKanade, findsDisplacements) {
  const cv::Mat image = fullRangeTexture();
  const LucasKanade lucas_kanade(kSide);
  const auto from = lucas_kanade.pyramid(image, kLevels);
  const std::vector<cv::Point2f> corners = cornersOf(image, 40);
  ASSERT_GT(corners.size(), 250u);
  for (const cv::Point2d& shift : {cv::Point2d(0, 0), {0.3, -0.7}, {12.25, 5.5}, {-20.4, 3.1}}) {
    const auto to = lucas_kanade.pyramid(moved(image, motion(0, 1, shift.x, shift.y)), kLevels);
    std::vector<cv::Point2f> points = corners;
    const auto found = trackAll(lucas_kanade, from, to, corners, kLevels, &points);
    std::vector<double> errors;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (found[i]) errors.push_back(cv::norm(points[i] - corners[i] - cv::Point2f(shift)));
    }
    EXPECT_GT(errors.size(), corners.size() * 95 / 100) << shift;
    EXPECT_LT(median(&errors), 0.1) << shift;  // by the interpolation between pixels
  }
}

TEST(LucasKanade, agreesWithOpenCV) {
  const cv::Mat image = fullRangeTexture(), next = moved(image, motion(1.5, 1.04, 3.3, -1.6));
  const LucasKanade lucas_kanade(kSide);
  const std::vector<cv::Point2f> corners = cornersOf(image, 40);
  std::vector<cv::Point2f> points = corners, reference = corners;
  const auto found = trackAll(lucas_kanade, lucas_kanade.pyramid(image, kLevels),
                              lucas_kanade.pyramid(next, kLevels), corners, kLevels, &points);
  std::vector<unsigned char> status;
  cv::calcOpticalFlowPyrLK(image, next, corners, reference, status, cv::noArray(), {kSide, kSide},
                           kLevels, {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-3},
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::size_t equal = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    equal += found[i] && status[i] && cv::norm(points[i] - reference[i]) < 0.02;
  }
  EXPECT_GT(equal, corners.size() * 9 / 10) << corners.size();
}

TEST(LucasKanade, doesNotFindPointsWithoutTextureOrOutsideTheImage) {
  const cv::Mat image = fullRangeTexture();
  cv::Mat edge(image.size(), CV_8UC1, cv::Scalar(50));
  edge.colRange(400, 800) = 200;
  const LucasKanade lucas_kanade(kSide);
  const auto textured = lucas_kanade.pyramid(image, kLevels);
  const auto track = [&](const cv::Mat& from, cv::Point2f point, cv::Point2f guess) {
    std::vector<cv::Point2f> points{guess};
    return trackAll(lucas_kanade, lucas_kanade.pyramid(from, kLevels), textured, {point}, 1,
                    &points)[0];
  };
  EXPECT_TRUE(track(image, {400, 124}, {401, 124}));
  EXPECT_FALSE(track(cv::Mat(image.size(), CV_8UC1, cv::Scalar(90)), {400, 124}, {400, 124}));
  EXPECT_FALSE(track(edge, {400, 124}, {400, 124})) << "aperture problem";
  EXPECT_FALSE(track(image, {400, 124}, {-20, 124}));
  EXPECT_FALSE(track(image, {400, 124}, {400, 1e9f}));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(track(image, {400, 124}, {nan, 124}));
  EXPECT_FALSE(track(image, {nan, nan}, {400, 124}));
}

TEST(LucasKanade, needsAGradientInEachDirection) {
  const LucasKanade lucas_kanade(kSide);
  // turned: by 45 degrees
  const auto isFound = [&](double across, bool turned) {
    cv::Mat image(248, 800, CV_8UC1);
    for (int v = 0; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        const double a = turned ? (u + v) * M_SQRT1_2 : u, b = turned ? (u - v) * M_SQRT1_2 : v;
        image.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(
            120 + 60 * std::sin(0.7 * a) + across * std::sin(0.7 * b));
      }
    }
    const auto pyramid = lucas_kanade.pyramid(image, 0);
    std::vector<cv::Point2f> points{{400, 124}};
    return trackAll(lucas_kanade, pyramid, pyramid, points, 0, &points)[0] != 0;
  };
  for (const bool turned : {false, true}) {
    EXPECT_TRUE(isFound(60, turned)) << turned;
    EXPECT_TRUE(isFound(3, turned)) << turned;
    EXPECT_FALSE(isFound(0.3, turned)) << "nearly an edge, " << turned;
  }
}

// With more contrast each step goes too far, to the other side, and with less it is too short.
TEST(LucasKanade, findsAPatchOfOtherContrast) {
  const LucasKanade lucas_kanade(kSide);
  const auto pyramidOf = [&](double contrast) {
    cv::Mat image(248, 800, CV_8UC1);
    for (int v = 0; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        const double grey =
            std::round(25 * std::cos(0.2 * (u - 400)) + 25 * std::cos(0.2 * (v - 124)));
        image.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(120 + contrast * grey);
      }
    }
    return lucas_kanade.pyramid(image, 0);
  };
  const cv::Point2f corner(400, 124);
  const auto error_px = [&](double contrast, const cv::Point2f& offset) {
    std::vector<cv::Point2f> points{corner + offset};
    EXPECT_TRUE(trackAll(lucas_kanade, pyramidOf(1), pyramidOf(contrast), {corner}, 0, &points)[0]);
    return cv::norm(points[0] - corner);
  };
  EXPECT_LT(error_px(2, {0.1f, -0.1f}), 0.05);
  EXPECT_LT(error_px(0.4, {2, -2}), 0.05);
}

// Also patches that overlap the border, of every size, at every place of a small image.
TEST(LucasKanade, tracksEverywhereInAnImage) {
  const cv::Mat image = fullRangeTexture()({100, 100, 61, 37}).clone();
  std::vector<cv::Point2f> all;
  for (int y = -6; y < image.rows + 6; y += 3) {
    for (int x = -6; x < image.cols + 6; x += 3) {
      all.emplace_back(static_cast<float>(x) + 0.3f, static_cast<float>(y) + 0.6f);
    }
  }
  for (int side = 5; side <= kMaxPatchSide; side += 2) {
    const LucasKanade lucas_kanade(side);
    const auto pyramid = lucas_kanade.pyramid(image, kLevels);
    std::vector<cv::Point2f> points = all;
    const auto found = trackAll(lucas_kanade, pyramid, pyramid, all, kLevels, &points);
    const auto inside = cv::Rect2f(5, 5, 50, 26);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!inside.contains(all[i])) continue;
      EXPECT_TRUE(found[i]) << all[i] << side;
      EXPECT_LT(cv::norm(points[i] - all[i]), 0.01) << all[i] << side;
    }
  }
}

TEST(LucasKanade, theBorderOfAnImageInMemoryMirrorsIt) {
  for (const cv::Mat& level : LucasKanade(kSide).pyramid(fullRangeTexture(), kLevels)) {
    cv::Mat with_border = level, expected;
    with_border.adjustROI(kSide, kSide, kSide, kSide);
    cv::copyMakeBorder(level.clone(), expected, kSide, kSide, kSide, kSide, cv::BORDER_REFLECT_101);
    ASSERT_EQ(with_border.size(), expected.size());
    EXPECT_EQ(cv::norm(with_border, expected, cv::NORM_INF), 0);
  }
}

TEST(LucasKanade, pyramidEndsWithAnImageLargerThanAPatch) {
  const LucasKanade lucas_kanade(kSide);
  const auto pyramid = lucas_kanade.pyramid(fullRangeTexture()({0, 0, 200, 70}), 8);
  ASSERT_EQ(pyramid.size(), 3u);
  EXPECT_EQ(pyramid[1].size(), cv::Size(100, 35));
  EXPECT_EQ(pyramid[2].size(), cv::Size(50, 18));
  EXPECT_EQ(lucas_kanade.pyramid(fullRangeTexture(), 0).size(), 1u);
  EXPECT_EQ(lucas_kanade.pyramid(cv::Mat(4, 4, CV_8UC1, cv::Scalar(1)), 4).size(), 1u);
}

}  // namespace
}  // namespace ground_scale_vo
