#include "scale/direct/patch.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

namespace ground_scale_vo::direct {
namespace {

const PinholeCamera kLargeCamera{1280, 960, 1200, 1230, 641, 239};
const LaneRegion kNarrowLane({}, 0, 3, 20, 0.3);

TEST(PatchExtractor, AReducedPixelIsTheCentreOfItsPixels) {
  const PinholeCamera small = PatchExtractor(kLargeCamera, 0.03, 1, {}).camera();
  EXPECT_EQ(small.width, 640);
  EXPECT_EQ(small.height, 480);
  EXPECT_LT((small.ray({0, 0}) - kLargeCamera.ray({0.5, 0.5})).norm(), 1e-12);
  EXPECT_LT((small.ray({100, 50}) - kLargeCamera.ray({200.5, 100.5})).norm(), 1e-12);
}

TEST(PatchExtractor, StoresTheReducedAndSmoothedLaneRegion) {
  PatchExtractor extractor(kLargeCamera, 0.03, 1, {});
  cv::Mat image(kLargeCamera.height, kLargeCamera.width, CV_8U), small, once, twice;
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::resize(image, small, {kLargeCamera.width / 2, kLargeCamera.height / 2}, 0, 0, cv::INTER_AREA);
  small.convertTo(small, CV_32F);
  cv::GaussianBlur(small, once, {5, 5}, 0.6);
  cv::GaussianBlur(once, twice, {5, 5}, 0.6);
  for (const bool backwards : {false, true}) {
    RoadImage road;
    std::vector<Patch> patches;
    extractor.extract(image, kNarrowLane, backwards, &road, &patches);
    ASSERT_GT(patches.size(), 5u);
    EXPECT_GT(road.roi.x, 5);  // inside the image on three sides
    EXPECT_GT(road.roi.y, 5);
    EXPECT_LT(road.roi.br().x, small.cols - 5);
    const cv::Rect inner(4, 4, road.roi.width - 8, road.roi.height - 8);
    const cv::Mat expected = (backwards ? twice : once)(road.roi);
    EXPECT_LT(cv::norm(road.pixels(inner), expected(inner), cv::NORM_INF), 1);
    // The images of which the patches are compared with references are the smoother ones.
    const cv::Mat& sampled = backwards ? once : twice;
    for (const Patch& patch : patches) {
      const cv::Point first = patch.corner + cv::Point(1, 1), next = first + cv::Point(2, 0);
      EXPECT_GT(
          (sampled.at<float>(next) - sampled.at<float>(first)) * (patch.value[1] - patch.value[0]),
          -1e-3);
    }
  }
}

TEST(PatchExtractor, WithoutVisibleLaneThereAreNoPatches) {
  const LaneRegion empty_region({}, 0, 50, 20, 0.3);  // begins beyond its end
  RoadImage road;
  const cv::Mat image(kLargeCamera.height, kLargeCamera.width, CV_8U, cv::Scalar(90));
  std::vector<Patch> patches;
  PatchExtractor(kLargeCamera, 0.03, 1, {}).extract(image, empty_region, false, &road, &patches);
  EXPECT_TRUE(patches.empty());
  EXPECT_TRUE(road.roi.empty());
}

}  // namespace
}  // namespace ground_scale_vo::direct
