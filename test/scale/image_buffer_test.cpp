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
  ImageBuffer buffer = drive(10, 0.5);
  std::vector<Reference> references = buffer.selectReferences(kBufferHeight);
  ASSERT_EQ(references.size(), 2u);
  EXPECT_NEAR(distanceOf(references[0]), 2, 1e-6);
  EXPECT_NEAR(distanceOf(references[1]), 4, 1e-6);
  for (const Reference& reference : references) {
    EXPECT_NEAR(reference.perpendicular[0].dot(reference.t), 0, 1e-5);
    EXPECT_NEAR(reference.perpendicular[1].dot(reference.t), 0, 1e-5);
    EXPECT_NEAR(reference.perpendicular[1].norm(), reference.t.norm(), 1e-5);
  }
  // Images without road are not kept: behind a vehicle that hides the road for a while.
  for (int i = 10; i < 24; ++i) {
    buffer.keepCurrent(kBufferHeight);
    buffer.current().roi = {};
    buffer.current().T_w_c.translation() = Eigen::Vector3d(0, 0, 0.5 * i);
  }
  references = buffer.selectReferences(kBufferHeight);
  ASSERT_EQ(references.size(), 2u);
  EXPECT_NEAR(distanceOf(references[0]), 0.5 * (23 - 9), 1e-6);
  buffer.clear();
  EXPECT_TRUE(buffer.selectReferences(kBufferHeight).empty());
}

TEST(ImageBuffer, HasNoReferenceWithoutMotionAndNoneTooFarAway) {
  EXPECT_TRUE(drive(1, 0.5).selectReferences(kBufferHeight).empty());
  EXPECT_TRUE(drive(10, 0).selectReferences(kBufferHeight).empty());
  EXPECT_TRUE(drive(2, 0.3).selectReferences(kBufferHeight).empty()) << "0.15 first baselines";
  // At many first baselines an image shows the road in another resolution.
  EXPECT_TRUE(drive(2, 20 * kBaseline * kBufferHeight).selectReferences(kBufferHeight).empty());
}

}  // namespace
}  // namespace ground_scale_vo::direct
