#include "scale/direct/patch.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo::direct {
namespace {

TEST(PatchExtractor, AUniformImageHasNoGradientAlsoAtTheEdgeOfTheRegion) {
  // With so short a focal length the margin of the region is less than a pixel.
  const PinholeCamera camera{640, 480, 20, 20, 320, 240};
  const cv::Mat uniform(camera.height, camera.width, CV_8UC1, cv::Scalar(100));
  RoadImage current;
  current.storage.create(camera.height, camera.width, CV_32F);
  std::vector<Patch> patches;
  PatchExtractor(camera, 1, PatchGrid(camera, 0.03), 1, {})
      .extract(uniform, LaneRegion({}, {}, 0, 0.1, 20, 5), false, &current, &patches);
  ASSERT_FALSE(patches.empty());
  for (const Patch& patch : patches) {
    ASSERT_LT(patch.grad_x.abs().maxCoeff(), 1e-3) << patch.corner;
    ASSERT_LT(patch.grad_y.abs().maxCoeff(), 1e-3) << patch.corner;
  }
}

}  // namespace
}  // namespace ground_scale_vo::direct
