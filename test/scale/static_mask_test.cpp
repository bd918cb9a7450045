#include "scale/direct/static_mask.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::direct {
namespace {

const PinholeCamera kMaskCamera{160, 120, 100, 100, 80, 30};
constexpr float kMaskImageNoise = 1;  // [grey levels]

/// Share of the patches that are masked when the image does not change while the camera moves
/// ahead by `distance` [camera heights] over a level road.
double maskedShare(const cv::Mat& image, float distance, bool is_aligned) {
  const PatchGrid grid(kMaskCamera, 0.03);
  RoadImage current;
  std::vector<Patch> patches;
  PatchExtractor(kMaskCamera, 1, grid, kMaskImageNoise, {})
      .extract(image, LaneRegion({}, {}, 0, 0.5, 3, 1), false, &current, &patches);
  EXPECT_GT(patches.size(), 10u);
  Reference reference;
  reference.image = &current;
  reference.R.setIdentity();
  reference.t = {0, 0, distance};
  StaticMask mask(kMaskCamera, grid);
  mask.update(patches, reference, PatchMatcher(kMaskCamera, kMaskImageNoise, {}), {0, -1, 0},
              is_aligned, 1);
  double masked = 0;
  for (const Patch& patch : patches) masked += mask.contains(patch.cell);
  return masked / static_cast<double>(patches.size());
}

cv::Mat noiseImage() {
  cv::Mat image(kMaskCamera.height, kMaskCamera.width, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 2);
  return image;
}

TEST(StaticMask, ContainsWhatDoesNotMoveInTheImage) {
  EXPECT_EQ(maskedShare(noiseImage(), 0.7f, false), 1);
  EXPECT_GT(maskedShare(noiseImage(), 0.7f, true), 0.9);
}

// The road, too, would move by less than 0.004 focal lengths.
TEST(StaticMask, DoesNotContainWhatNeedNotMove) {
  EXPECT_EQ(maskedShare(noiseImage(), 0.002f, false), 0);
}

// Dirt on the lens is washed off.
TEST(StaticMask, ForgetsWhatMovesAgain) {
  const PatchGrid grid(kMaskCamera, 0.03);
  const PatchMatcher matcher(kMaskCamera, kMaskImageNoise, {});
  PatchExtractor extractor(kMaskCamera, 1, grid, kMaskImageNoise, {});
  RoadImage before, after;
  std::vector<Patch> patches;
  const LaneRegion lane({}, {}, 0, 0.5, 3, 1);
  Reference reference;
  reference.image = &before;
  reference.R.setIdentity();
  reference.t = {0, 0, 0.7f};
  StaticMask mask(kMaskCamera, grid);
  const auto update = [&](float rate) {
    mask.update(patches, reference, matcher, {0, -1, 0}, false, rate);
    double masked = 0;
    for (const Patch& patch : patches) masked += mask.contains(patch.cell);
    return masked / static_cast<double>(patches.size());
  };
  extractor.extract(noiseImage(), lane, false, &before, &patches);
  EXPECT_EQ(update(0.4f), 0);
  EXPECT_EQ(update(0.4f), 1);
  cv::Mat moved;
  cv::flip(noiseImage(), moved, 1);
  extractor.extract(moved, lane, false, &after, &patches);
  EXPECT_EQ(update(0.4f), 0);
}

TEST(StaticMask, DoesNotContainWhatTheReferenceShowsOnlyInPart) {
  const PatchGrid grid(kMaskCamera, 0.03);
  RoadImage current;
  std::vector<Patch> patches;
  PatchExtractor(kMaskCamera, 1, grid, kMaskImageNoise, {})
      .extract(noiseImage(), LaneRegion({}, {}, 0, 0.5, 3, 1), false, &current, &patches);
  ASSERT_GT(patches.size(), 10u);
  RoadImage part;
  part.roi = {patches.front().corner, patches.back().corner};  // half of the cells at its borders
  part.roi += cv::Point(grid.patch_px / 2, grid.patch_px / 2);
  part.storage = current.storage(part.roi - current.roi.tl());
  Reference reference;
  reference.image = &part;
  reference.R.setIdentity();
  reference.t = {0, 0, 0.7f};
  StaticMask mask(kMaskCamera, grid);
  mask.update(patches, reference, PatchMatcher(kMaskCamera, kMaskImageNoise, {}), {0, -1, 0}, false,
              1);
  int inside = 0;
  for (const Patch& patch : patches) {
    const cv::Rect cell(patch.corner, cv::Size(grid.patch_px, grid.patch_px));
    const bool is_inside = (cell & part.roi) == cell;
    EXPECT_EQ(mask.contains(patch.cell), is_inside) << patch.corner;
    inside += is_inside;
  }
  EXPECT_GT(inside, 0);
}

TEST(StaticMask, DoesNotContainUniformPatches) {
  const cv::Mat uniform(kMaskCamera.height, kMaskCamera.width, CV_8UC1, cv::Scalar(100));
  EXPECT_EQ(maskedShare(uniform, 0.7f, false), 0);
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
