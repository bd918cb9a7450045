#include "scale/direct/static_mask.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace ground_scale_vo::direct {
namespace {

const PinholeCamera kMaskCamera{160, 120, 100, 100, 80, 30};
constexpr float kMaskImageNoise = 1;  // [grey levels]

cv::Mat noiseImage() {
  cv::Mat image(kMaskCamera.height, kMaskCamera.width, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 2);
  return image;
}

/// The mask and its inputs. The reference image shows what the first of the images shows.
struct Masking {
  /// Returns the share of the patches that are masked.
  double update(const cv::Mat& image, float distance, bool is_aligned, float rate = 1) {
    RoadImage later;
    extractor.extract(image, lane, false, reference.image ? &later : &first, &patches);
    EXPECT_GT(patches.size(), 10u);
    if (!reference.image) reference.image = &first;
    reference.R.setIdentity();
    reference.t = {0, 0, distance};
    mask.update(patches, reference, PatchMatcher(kMaskCamera, kMaskImageNoise, {}), {0, -1, 0},
                is_aligned, rate);
    double masked = 0;
    for (const Patch& patch : patches) masked += mask.contains(patch.cell);
    return masked / static_cast<double>(patches.size());
  }

  const PatchGrid grid{kMaskCamera, 0.03};
  const LaneRegion lane{{}, {}, 0, 0.5, 3, 1};
  PatchExtractor extractor{kMaskCamera, 1, grid, kMaskImageNoise, {}};
  StaticMask mask{kMaskCamera, grid};
  RoadImage first;
  Reference reference;
  std::vector<Patch> patches;
};

/// Share of the patches that are masked when the image does not change while the camera moves
/// ahead by `distance` [camera heights] over a level road.
double maskedShare(const cv::Mat& image, float distance, bool is_aligned) {
  return Masking().update(image, distance, is_aligned);
}

TEST(StaticMask, ContainsWhatDoesNotMoveInTheImage) {
  EXPECT_EQ(maskedShare(noiseImage(), 0.7f, false), 1);
  EXPECT_GT(maskedShare(noiseImage(), 0.7f, true), 0.9);
  // The road, too, would move by less than 0.004 focal lengths.
  EXPECT_EQ(maskedShare(noiseImage(), 0.002f, false), 0);
  const cv::Mat uniform(kMaskCamera.height, kMaskCamera.width, CV_8UC1, cv::Scalar(100));
  EXPECT_EQ(maskedShare(uniform, 0.7f, false), 0);
}

// Dirt on the lens is washed off.
TEST(StaticMask, ForgetsWhatMovesAgain) {
  Masking masking;
  EXPECT_EQ(masking.update(noiseImage(), 0.7f, false, 0.4f), 0);
  EXPECT_EQ(masking.update(noiseImage(), 0.7f, false, 0.4f), 1);
  cv::Mat moved;
  cv::flip(noiseImage(), moved, 1);
  EXPECT_EQ(masking.update(moved, 0.7f, false, 0.4f), 0);
}

// Lines along the path look the same from everywhere.
TEST(StaticMask, DoesNotContainWhatAnEstimatedPlaneExplains) {
  cv::Mat lines(kMaskCamera.height, kMaskCamera.width, CV_8UC1, cv::Scalar(110));
  for (int v = 40; v < lines.rows; ++v) {
    for (int u = 0; u < lines.cols; ++u) {
      const double lateral = (u - kMaskCamera.cx) / (v - kMaskCamera.cy);  // [camera heights]
      lines.at<unsigned char>(v, u) =
          static_cast<unsigned char>(std::lround(110 + 60 * std::sin(20 * lateral)));
    }
  }
  EXPECT_LT(maskedShare(lines, 0.7f, true), 0.2);  // the interpolation blurs distant lines
  EXPECT_GT(maskedShare(lines, 0.7f, false), 0.9);
}

}  // namespace
}  // namespace ground_scale_vo::direct
