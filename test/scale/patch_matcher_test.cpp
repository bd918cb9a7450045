#include "scale/direct/patch_matcher.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>

namespace ground_scale_vo::direct {
namespace {

const PinholeCamera kCamera{320, 240, 300, 360, 160, 120};
constexpr float kGreyNoise = 0.5f;  // [grey levels]
/// Plane of a road 1.5 VO units below a camera that looks down a little.
const Eigen::Vector3f kPlane = Eigen::Vector3f(0.02f, -1, -0.05f).normalized() / 1.5f;

float waves(float u, float v) { return 100 + 30 * std::sin(0.21f * u) + 30 * std::sin(0.17f * v); }

/// A reference image with this texture, seen from another camera than the patch.
class PatchMatcherTest : public testing::Test {
 protected:
  PatchMatcherTest() {
    image_.roi = {0, 0, kCamera.width, kCamera.height};
    image_.storage.create(kCamera.height, kCamera.width, CV_32F);
    for (int v = 0; v < kCamera.height; ++v) {
      for (int u = 0; u < kCamera.width; ++u) {
        image_.storage.at<float>(v, u) = waves(static_cast<float>(u), static_cast<float>(v));
      }
    }
    reference_.image = &image_;
    reference_.R =
        Eigen::AngleAxisf(0.02f, Eigen::Vector3f(0.3f, 0.9f, 0.1f).normalized()).toRotationMatrix();
    setTranslation({0.03f, -0.02f, 0.5f});
    movePatch(190, 170);
    renderPatch();
  }

  /// To this upper left pixel.
  void movePatch(int left, int top) {
    for (int i = 0; i < kPatchSamples; ++i) {
      const auto u = static_cast<float>(left + 2 * (i % kPatchSide));
      const auto v = static_cast<float>(top + 2 * (i / kPatchSide));
      patch_.ray_x[i] = static_cast<float>((u - kCamera.cx) / kCamera.fx);
      patch_.ray_y[i] = static_cast<float>((v - kCamera.cy) / kCamera.fy);
    }
  }

  void setTranslation(const Eigen::Vector3f& t) {
    reference_.t = t;
    reference_.perpendicular[0] = t.norm() * t.unitOrthogonal();
    reference_.perpendicular[1] = t.cross(reference_.perpendicular[0]).normalized() * t.norm();
  }

  /// Sets the intensities and gradients of the patch to those that the reference image shows.
  void renderPatch() {
    constexpr float kStep_px = 0.5f;
    patch_.value = valuesOf(reference_, kPlane);
    const auto difference = [&](Samples* ray, double focal_length) -> Samples {
      const Samples centre = *ray;
      const auto step = static_cast<float>(kStep_px / focal_length);
      *ray = centre + step;
      const Samples after = valuesOf(reference_, kPlane);
      *ray = centre - step;
      const Samples before = valuesOf(reference_, kPlane);
      *ray = centre;
      return (after - before) / (2 * kStep_px);
    };
    const Samples grad_x = difference(&patch_.ray_x, kCamera.fx);
    const Samples grad_y = difference(&patch_.ray_y, kCamera.fy);
    deviation_ = normalise(kGreyNoise, &patch_.value, &patch_.texture);
    patch_.grad_x = grad_x / deviation_;
    patch_.grad_y = grad_y / deviation_;
  }

  Samples valuesOf(const Reference& reference, const Eigen::Vector3f& m) const {
    Samples values;
    EXPECT_TRUE(matcher_.sample(reference, patch_, m, &values));
    return values;
  }

  /// Where the reference image shows a sample of the patch.
  Eigen::Vector2d pixelOf(int sample) const {
    const Eigen::Vector3f ray(patch_.ray_x[sample], patch_.ray_y[sample], 1);
    const Eigen::Vector3f y = reference_.R * ray - reference_.t * kPlane.dot(ray);
    return kCamera.project(y.cast<double>());
  }

  Match linearised() const {
    Match match;
    matcher_.linearise(reference_, patch_, kPlane, &match);
    return match;
  }

  const PatchMatcher matcher_{kCamera, kGreyNoise, {}};
  RoadImage image_;
  Reference reference_;
  Patch patch_;
  float deviation_ = 0;  ///< of the patch's intensities [grey levels]
};

/// The inverse depth -q of all rays changes with the third component of m.
Eigen::Vector3f planeMovedBy(float dq) { return kPlane + Eigen::Vector3f(0, 0, dq); }

TEST_F(PatchMatcherTest, JacobianIsTheDerivativeByQ) {
  const Match match = linearised();
  EXPECT_TRUE(match.observable);
  constexpr float kStep = 0.01f;
  Samples expected =
      (valuesOf(reference_, planeMovedBy(kStep)) - valuesOf(reference_, planeMovedBy(-kStep))) /
      (2 * kStep * deviation_);
  expected -= expected.mean();
  EXPECT_LT((match.jacobian - expected).abs().maxCoeff(), 0.05f * expected.abs().maxCoeff());
}

TEST_F(PatchMatcherTest, MotionIsTheShiftByAnErrorOfTheMotion) {
  const Match match = linearised();
  constexpr float kStep = 0.002f;
  for (int k = 0; k < 5; ++k) {
    const auto moved = [&](float error) {
      Reference reference = reference_;
      if (k < 3) {
        const Eigen::AngleAxisf rotation(error, Eigen::Vector3f::Unit(k));
        reference.R = rotation * reference_.R;
        reference.t = rotation * reference_.t;
      } else {
        reference.t += error * reference_.perpendicular[k - 3];
      }
      return valuesOf(reference, kPlane);
    };
    const Samples derivative = (moved(kStep) - moved(-kStep)) / (2 * kStep * deviation_);
    const float expected = (match.jacobian * derivative).sum() / match.jacobian.square().sum();
    EXPECT_NEAR(match.motion[k], expected, 0.03f * match.motion.cwiseAbs().maxCoeff()) << k;
  }
}

TEST_F(PatchMatcherTest, UsesNoMaskedPixelAndNoneOutsideTheImage) {
  Samples values;
  cv::Mat allowed(kCamera.height, kCamera.width, CV_8U, cv::Scalar(255));
  EXPECT_TRUE(
      PatchMatcher(kCamera, kGreyNoise, allowed).sample(reference_, patch_, kPlane, &values));
  const Eigen::Vector2d u = pixelOf(9);
  allowed.at<unsigned char>(static_cast<int>(u.y()), static_cast<int>(u.x())) = 0;
  EXPECT_FALSE(
      PatchMatcher(kCamera, kGreyNoise, allowed).sample(reference_, patch_, kPlane, &values));
  // Of the stored part of the image the pixels around all samples are needed.
  Eigen::Vector2d first = pixelOf(0), last = first;
  for (int i = 1; i < kPatchSamples; ++i) {
    first = first.cwiseMin(pixelOf(i));
    last = last.cwiseMax(pixelOf(i));
  }
  const cv::Point begin(cvFloor(first.x()), cvFloor(first.y()));
  const cv::Point end(cvFloor(last.x()) + 2, cvFloor(last.y()) + 2);
  const auto isSampled = [&](const cv::Rect& roi) {
    RoadImage part;
    part.roi = roi;
    part.storage = image_.storage(roi).clone();
    Reference reference = reference_;
    reference.image = &part;
    return matcher_.sample(reference, patch_, kPlane, &values);
  };
  ASSERT_TRUE(isSampled({begin, end}));
  EXPECT_LT((values - valuesOf(reference_, kPlane)).abs().maxCoeff(), 0.01f);
  const cv::Point column(1, 0), row(0, 1);
  EXPECT_FALSE(isSampled({begin + column, end}));
  EXPECT_FALSE(isSampled({begin + row, end}));
  EXPECT_FALSE(isSampled({begin, end - column}));
  EXPECT_FALSE(isSampled({begin, end - row}));
}

}  // namespace
}  // namespace ground_scale_vo::direct
