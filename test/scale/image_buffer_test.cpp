#include "scale/direct/image_buffer.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo::direct {
namespace {

constexpr double kBufferHeight = 2;  // [VO units]
constexpr double kBaseline = 1;      // [camera heights]

/// A buffer after images every `step` [VO units] along z, the last of which is the current one.
ImageBuffer drive(int frames, double step) {
  ImageBuffer buffer(kBaseline);
  for (int i = 0; i < frames; ++i) {
    if (i > 0) buffer.keepCurrent(kBufferHeight);
    buffer.current().roi = {0, 0, 8, 8};
    buffer.current().T_w_c.translation() = Eigen::Vector3d(0, 0, step * i);
  }
  return buffer;
}

double distanceOf(const Reference& reference) { return reference.t.norm(); }

TEST(ImageBuffer, SelectsReferencesAtOneAndTwoBaselines) {
  const ImageBuffer buffer = drive(10, 0.5);
  const std::vector<Reference> references = buffer.selectReferences(kBufferHeight);
  ASSERT_EQ(references.size(), 2u);
  EXPECT_NEAR(distanceOf(references[0]), 2, 1e-6);
  EXPECT_NEAR(distanceOf(references[1]), 4, 1e-6);
  for (const Reference& reference : references) {
    EXPECT_NEAR(reference.perpendicular[0].dot(reference.t), 0, 1e-5);
    EXPECT_NEAR(reference.perpendicular[1].dot(reference.t), 0, 1e-5);
    EXPECT_NEAR(reference.perpendicular[1].norm(), reference.t.norm(), 1e-5);
  }
}

// Steps of 2.5 first baselines: the nearest image is the best for both baselines.
TEST(ImageBuffer, NoImageIsSelectedTwice) {
  EXPECT_EQ(drive(2, 5).selectReferences(kBufferHeight).size(), 1u);
  const ImageBuffer buffer = drive(4, 5);
  const std::vector<Reference> references = buffer.selectReferences(kBufferHeight);
  ASSERT_EQ(references.size(), 2u);
  EXPECT_NEAR(distanceOf(references[0]), 5, 1e-6);
  EXPECT_NEAR(distanceOf(references[1]), 10, 1e-6);
}

TEST(ImageBuffer, HasNoReferenceWithoutMotionAndNoneTooFarAway) {
  EXPECT_TRUE(drive(1, 0.5).selectReferences(kBufferHeight).empty());
  EXPECT_TRUE(drive(10, 0).selectReferences(kBufferHeight).empty());
  EXPECT_TRUE(drive(2, 0.3).selectReferences(kBufferHeight).empty()) << "0.15 first baselines";
  // At many first baselines an image shows the road in another resolution.
  EXPECT_TRUE(drive(2, 20 * kBaseline * kBufferHeight).selectReferences(kBufferHeight).empty());
  ImageBuffer buffer = drive(10, 0.5);
  EXPECT_NEAR(buffer.stepLength(), 0.5, 1e-12);
  buffer.clear();
  EXPECT_TRUE(buffer.empty());
  EXPECT_TRUE(buffer.selectReferences(kBufferHeight).empty());
}

// Behind a vehicle that hides the road for a while.
TEST(ImageBuffer, ImagesWithoutRoadAreNotKept) {
  ImageBuffer buffer = drive(10, 0.5);
  for (int i = 10; i < 24; ++i) {
    buffer.keepCurrent(kBufferHeight);
    buffer.current().roi = {};
    buffer.current().T_w_c.translation() = Eigen::Vector3d(0, 0, 0.5 * i);
  }
  const std::vector<Reference> references = buffer.selectReferences(kBufferHeight);
  ASSERT_EQ(references.size(), 2u);
  EXPECT_NEAR(distanceOf(references[0]), 0.5 * (23 - 9), 1e-6);
}

}  // namespace
}  // namespace ground_scale_vo::direct
