#include "scale/patch_matcher.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>

namespace gsv::direct {
namespace {

const PinholeCamera kCamera{320, 240, 300, 360, 160, 120};
constexpr float kGreyNoise = 0.5f;   // [grey levels]
constexpr double kPatchSize = 0.03;  // [focal lengths], of extracted ones
/// Plane of a road 1.5 VO units below a camera that looks down a little.
const Eigen::Vector3d kPlane = Eigen::Vector3d(0.02, -1, -0.05).normalized() / 1.5;

float waves(float u, float v) { return 100 + 30 * std::sin(0.21f * u) + 30 * std::sin(0.17f * v); }

/// A reference image with this texture, seen from another camera than the patch.
class PatchMatcherTest : public testing::Test {
 protected:
  PatchMatcherTest() {
    reference_.image.roi = {0, 0, kCamera.width, kCamera.height};
    reference_.image.pixels.create(kCamera.height, kCamera.width, CV_32F);
    for (int v = 0; v < kCamera.height; ++v) {
      for (int u = 0; u < kCamera.width; ++u) {
        reference_.image.pixels.at<float>(v, u) =
            waves(static_cast<float>(u), static_cast<float>(v));
      }
    }
    reference_.T_r_c = Eigen::Translation3d(0.03, -0.02, 0.5) *
                       Eigen::AngleAxisd(0.02, Eigen::Vector3d(0.3, 0.9, 0.1).normalized());
    for (int i = 0; i < kPatchSamples; ++i) {
      const auto u = static_cast<float>(190 + 2 * (i % kPatchSide));
      const auto v = static_cast<float>(170 + 2 * (i / kPatchSide));
      patch_.ray_x[i] = static_cast<float>((u - kCamera.cx) / kCamera.fx);
      patch_.ray_y[i] = static_cast<float>((v - kCamera.cy) / kCamera.fy);
    }
    renderPatch();
  }

  /// Sets the intensities and gradients of the patch to those that the reference image shows.
  void renderPatch() {
    constexpr float kStep_px = 0.5f;
    patch_.value = valuesOf(reference_, kPlane);
    const auto difference = [&](Samples* ray, double focal_length) -> Samples {
      const Samples centre = *ray;
      const auto valuesAt = [&](float shift_px) {
        *ray = centre + shift_px / static_cast<float>(focal_length);
        return valuesOf(reference_, kPlane);
      };
      const Samples result = (valuesAt(kStep_px) - valuesAt(-kStep_px)) / (2 * kStep_px);
      *ray = centre;
      return result;
    };
    const Samples grad_x = difference(&patch_.ray_x, kCamera.fx);
    const Samples grad_y = difference(&patch_.ray_y, kCamera.fy);
    deviation_ = normalise(kGreyNoise, &patch_.value, &patch_.texture);
    patch_.grad_x = grad_x / deviation_;
    patch_.grad_y = grad_y / deviation_;
  }

  Samples valuesOf(const Reference& reference, const Eigen::Vector3d& m) const {
    Samples values;
    EXPECT_TRUE(matcher_.sample(reference, patch_, m, &values));
    return values;
  }

  /// Where the reference image shows a sample of the patch.
  Eigen::Vector2d pixelOf(int sample) const {
    const Eigen::Vector3d ray(patch_.ray_x[sample], patch_.ray_y[sample], 1);
    return kCamera.project(reference_.T_r_c.linear() * ray -
                           reference_.T_r_c.translation() * kPlane.dot(ray));
  }

  Match linearised() const {
    Match match;
    matcher_.linearise(reference_, patch_, kPlane, &match);
    return match;
  }

  const PatchMatcher matcher_{kCamera, kPatchSize, kGreyNoise, {}};
  Reference reference_;
  Patch patch_;
  float deviation_ = 0;  ///< of the patch's intensities [grey levels]
};

TEST_F(PatchMatcherTest, JacobianIsTheDerivativeByQ) {
  const Match match = linearised();
  EXPECT_TRUE(match.observable);
  constexpr float kStep = 0.01f;
  // The inverse depth -q of all rays changes with the third component of m.
  const auto moved = [&](float dq) {
    return valuesOf(reference_, kPlane + Eigen::Vector3d(0, 0, dq));
  };
  Samples expected = (moved(kStep) - moved(-kStep)) / (2 * kStep * deviation_);
  expected -= expected.mean();
  EXPECT_LT((match.jacobian - expected).abs().maxCoeff(), 0.05f * expected.abs().maxCoeff());
}

TEST_F(PatchMatcherTest, MotionIsTheShiftByAnErrorOfTheMotion) {
  const Match match = linearised();
  constexpr float kStep = 0.002f;
  for (int k = 0; k < 5; ++k) {
    const auto moved = [&](float error) {
      Reference reference = reference_;
      const Eigen::Vector3d t = reference_.T_r_c.translation();
      const Eigen::Vector3d side = t.cast<float>().unitOrthogonal().cast<double>();
      if (k < 3) {
        reference.T_r_c = Eigen::AngleAxisd(error, Eigen::Vector3d::Unit(k)) * reference_.T_r_c;
      } else {
        reference.T_r_c.translation() += error * (k == 3 ? t.norm() * side : t.cross(side));
      }
      return valuesOf(reference, kPlane);
    };
    const Samples derivative = (moved(kStep) - moved(-kStep)) / (2 * kStep * deviation_);
    const float expected = (match.jacobian * derivative).sum() / match.jacobian.square().sum();
    EXPECT_NEAR(match.motion[k], expected, 0.03f * match.motion.cwiseAbs().maxCoeff()) << k;
  }
}

TEST_F(PatchMatcherTest, UsesNoPixelOutsideTheImage) {
  Samples values;
  // The stored part of the image must contain the pixels around all samples.
  Eigen::Vector2d first = pixelOf(0), last = first;
  for (int i = 1; i < kPatchSamples; ++i) {
    first = first.cwiseMin(pixelOf(i));
    last = last.cwiseMax(pixelOf(i));
  }
  const cv::Point begin(cvFloor(first.x()), cvFloor(first.y()));
  const cv::Point end(cvFloor(last.x()) + 2, cvFloor(last.y()) + 2);
  const auto isSampled = [&](const cv::Rect& roi) {
    Reference reference = reference_;
    reference.image.roi = roi;
    reference.image.pixels = reference_.image.pixels(roi).clone();
    return matcher_.sample(reference, patch_, kPlane, &values);
  };
  ASSERT_TRUE(isSampled({begin, end}));
  EXPECT_LT((values - valuesOf(reference_, kPlane)).abs().maxCoeff(), 0.01f);
  for (const cv::Point& one : {cv::Point(1, 0), cv::Point(0, 1)}) {
    EXPECT_FALSE(isSampled({begin + one, end})) << one;
    EXPECT_FALSE(isSampled({begin, end - one})) << one;
  }
}

TEST_F(PatchMatcherTest, NoiseDoesNotLowerTheCorrelation) {
  Match match = linearised();
  matcher_.measure(reference_, patch_, kPlane, &match);
  EXPECT_NEAR(match.correlation, 1, 1e-3);
  EXPECT_NEAR(match.shift, 0, 1e-3);
  constexpr float kNoise = 20;
  patch_.value *= deviation_;
  normalise(kNoise, &patch_.value, &patch_.texture);
  EXPECT_LT(patch_.texture, 0.9f);
  const PatchMatcher noisy(kCamera, kPatchSize, kNoise, {});
  noisy.measure(reference_, patch_, kPlane, &match);
  EXPECT_NEAR(match.correlation, 1, 1e-3);
  reference_.image.pixels = 200 - 0.5 * reference_.image.pixels;
  noisy.measure(reference_, patch_, kPlane, &match);
  EXPECT_NEAR(match.correlation, -1, 1e-3);
  reference_.image.pixels.setTo(90);
  noisy.measure(reference_, patch_, kPlane, &match);
  EXPECT_EQ(match.correlation, 0);
}

}  // namespace
}  // namespace gsv::direct
