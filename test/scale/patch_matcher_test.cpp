#include "scale/direct/patch_matcher.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "scale/direct/height_search.hpp"

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
  explicit PatchMatcherTest(const std::function<float(float, float)>& texture = waves) {
    image_.roi = {0, 0, kCamera.width, kCamera.height};
    image_.storage.create(kCamera.height, kCamera.width, CV_32F);
    for (int v = 0; v < kCamera.height; ++v) {
      for (int u = 0; u < kCamera.width; ++u) {
        image_.storage.at<float>(v, u) = texture(static_cast<float>(u), static_cast<float>(v));
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

  /// The same values from an image of which only a part is stored; none if samples are outside.
  std::optional<Samples> valuesInPart(const cv::Rect& roi, const cv::Mat& allowed = {}) const {
    RoadImage part;
    part.roi = roi;
    part.storage = image_.storage(roi).clone();
    Reference reference = reference_;
    reference.image = &part;
    Samples values;
    if (!PatchMatcher(kCamera, kGreyNoise, allowed).sample(reference, patch_, kPlane, &values)) {
      return std::nullopt;
    }
    return values;
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

TEST_F(PatchMatcherTest, MeasuresTheShiftDespiteOutliers) {
  Match match = linearised();
  const float information = match.jacobian.square().sum();
  matcher_.measure(reference_, patch_, kPlane, &match);
  ASSERT_TRUE(match.valid);
  EXPECT_NEAR(match.shift, 0, 1e-5f);
  EXPECT_NEAR(match.correlation, 1, 1e-3f);
  EXPECT_GT(match.variance * information, 0.005f) << "also of an exact match";
  EXPECT_EQ(match.ray.z(), 1);
  EXPECT_NEAR(match.ray.x(), patch_.ray_x.mean(), 0.01);
  EXPECT_NEAR(match.ray.y(), patch_.ray_y.mean(), 0.01);

  constexpr float kShift = 0.002f;
  matcher_.measure(reference_, patch_, planeMovedBy(-kShift), &match);
  const float without_outliers = match.shift;
  // Less, because the normalisation of the intensities removes a part of the change.
  EXPECT_GT(without_outliers, 0.5f * kShift);
  EXPECT_LT(without_outliers, 1.1f * kShift);
  // As a shadow in one of the images: all on the same side of the gradient.
  for (int i = 0, outliers = 0; i < kPatchSamples && outliers < 6; ++i) {
    if (match.jacobian[i] < 0.5f * match.jacobian.maxCoeff()) continue;
    patch_.value[i] += 4;
    ++outliers;
  }
  matcher_.measure(reference_, patch_, planeMovedBy(-kShift), &match);
  const Samples residual = patch_.value - valuesOf(reference_, planeMovedBy(-kShift)) / deviation_;
  const Samples zero_mean = residual - residual.mean();
  const float least_squares = (match.jacobian * zero_mean).sum() / information;
  EXPECT_LT(std::abs(match.shift - without_outliers),
            0.5f * std::abs(least_squares - without_outliers));
}

// All residuals have the same size, so the robust weights do not change their variance.
TEST_F(PatchMatcherTest, TheVarianceIsThatOfTheResidual) {
  constexpr float kResidual = 0.5f, kWeight = 0.8f;  // 1 / (1 + 1 / 2^2)
  constexpr float kLeastVariance = 0.01f;            // of a residual, which is added
  Match match = linearised();
  for (int i = 0; i < kPatchSamples; ++i) patch_.value[i] += i % 2 == 0 ? kResidual : -kResidual;
  matcher_.measure(reference_, patch_, kPlane, &match);
  ASSERT_TRUE(match.valid);
  const float information = kWeight * match.jacobian.square().sum();
  EXPECT_NEAR(match.variance * information, kResidual * kResidual + kLeastVariance, 0.01f);
}

// Before a surface parallel to the image, gradients keep their direction.
TEST_F(PatchMatcherTest, NeedsGradientsAlongTheEpipolarLine) {
  const Eigen::Vector3f surface(0, 0, -0.5f);
  patch_.ray_x.setConstant(0.5f);
  patch_.ray_y.setConstant(0);
  reference_.R.setIdentity();
  Samples alternating;
  for (int i = 0; i < kPatchSamples; ++i) alternating[i] = i % 2 == 0 ? 1 : -1;
  // And the direction of the line.
  const std::pair<Eigen::Vector3f, Eigen::Vector2f> motions[] = {
      {{0.4f, 0, 0}, {1, 0}}, {{0, 0.4f, 0}, {0, 1}}, {{0, 0, 2}, {1, 0}}};
  for (const auto& [t, line] : motions) {
    setTranslation(t);
    // constant: of a gradient across the line in all samples, which only changes the mean.
    const auto isObservable = [&, line = line](float cosine, float constant) {
      const float sine = std::sqrt(1 - cosine * cosine);
      patch_.grad_x = alternating * (cosine * line.x() - sine * line.y()) - constant * line.y();
      patch_.grad_y = alternating * (cosine * line.y() + sine * line.x()) + constant * line.x();
      Match match;
      matcher_.linearise(reference_, patch_, surface, &match);
      return match.observable;
    };
    EXPECT_TRUE(isObservable(1, 0)) << t.transpose();
    EXPECT_TRUE(isObservable(0.25f, 0)) << t.transpose();
    EXPECT_TRUE(isObservable(0.25f, 5)) << t.transpose();
    EXPECT_FALSE(isObservable(0.15f, 0)) << t.transpose();
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
  setTranslation({0, 0, -4});  // nearer to the road: the patch leaves the image
  EXPECT_FALSE(matcher_.sample(reference_, patch_, kPlane, &values));
}

TEST_F(PatchMatcherTest, NeedsThePixelsAroundAllSamplesInTheStoredPart) {
  Eigen::Vector2d first = pixelOf(0), last = first;
  for (int i = 1; i < kPatchSamples; ++i) {
    first = first.cwiseMin(pixelOf(i));
    last = last.cwiseMax(pixelOf(i));
  }
  const cv::Point begin(cvFloor(first.x()), cvFloor(first.y()));
  const cv::Point end(cvFloor(last.x()) + 2, cvFloor(last.y()) + 2);
  const auto values = valuesInPart({begin, end});
  ASSERT_TRUE(values);
  EXPECT_LT((*values - valuesOf(reference_, kPlane)).abs().maxCoeff(), 0.01f);
  const cv::Point column(1, 0), row(0, 1);
  EXPECT_FALSE(valuesInPart({begin + column, end}));
  EXPECT_FALSE(valuesInPart({begin + row, end}));
  EXPECT_FALSE(valuesInPart({begin, end - column}));
  EXPECT_FALSE(valuesInPart({begin, end - row}));

  // The mask is that of the whole image.
  cv::Mat allowed(kCamera.height, kCamera.width, CV_8U, cv::Scalar(0));
  allowed(cv::Rect(begin, end)) = 255;
  EXPECT_TRUE(valuesInPart({begin, end}, allowed));
  allowed.at<unsigned char>(cvFloor(pixelOf(9).y()), cvFloor(pixelOf(9).x())) = 0;
  EXPECT_FALSE(valuesInPart({begin, end}, allowed));
}

// Seen from twice as far beyond the road, the patch is behind the camera, and its rays, extended
// backwards, meet the image.
TEST_F(PatchMatcherTest, UsesNoPointBehindTheReferenceCamera) {
  const Eigen::Vector3f ray(patch_.ray_x.mean(), patch_.ray_y.mean(), 1);
  reference_.R.setIdentity();
  setTranslation(2 * ray / kPlane.dot(ray));
  for (int i = 0; i < kPatchSamples; ++i) {
    const Eigen::Vector2d u = pixelOf(i);
    ASSERT_TRUE(cv::Rect2d(1, 1, kCamera.width - 3, kCamera.height - 3).contains({u.x(), u.y()}));
  }
  Samples values;
  EXPECT_FALSE(matcher_.sample(reference_, patch_, kPlane, &values));
}

/// Lines along the path, which look the same at any distance.
class PatchMatcherLines : public PatchMatcherTest {
 protected:
  PatchMatcherLines()
      : PatchMatcherTest(
            [](float u, float v) { return waves(100 * (u - 160) / (v - 100.5f), 0); }) {}
};

TEST_F(PatchMatcherLines, AreNotObservable) {
  reference_.R.setIdentity();
  // The lines meet at (160, 100.5), so the epipole has to be there.
  setTranslation({0, -0.5f * 19.5f / 300, 0.5f});
  renderPatch();
  Match match = linearised();
  EXPECT_FALSE(match.observable);
  matcher_.measure(reference_, patch_, kPlane, &match);
  EXPECT_FALSE(match.valid);
}

float spots(float u, float v) {
  static const cv::Mat texture = [] {
    cv::Mat texture(kCamera.height, kCamera.width, CV_32F);
    cv::RNG(5).fill(texture, cv::RNG::UNIFORM, 0, 255);
    cv::GaussianBlur(texture, texture, {0, 0}, 2);
    return texture;
  }();
  return texture.at<float>(static_cast<int>(v), static_cast<int>(u));
}

class HeightSearchTest : public PatchMatcherTest {
 protected:
  explicit HeightSearchTest(const std::function<float(float, float)>& texture = spots)
      : PatchMatcherTest(texture) {
    setTranslation({0.03f, -0.02f, 2});
  }

  void addPatches(int top, int bottom) {
    for (int u = 60; u < 260; u += 4) {
      for (int v = top; v < bottom; v += 8) {
        movePatch(u, v);
        renderPatch();
        patches_.push_back(patch_);
      }
    }
  }

  /// With a reference image of which columns `first` to `end` are stored.
  std::optional<GroundPlane> findIn(int first, int end) const {
    RoadImage part;
    part.roi = {first, 0, end - first, kCamera.height};
    part.storage = image_.storage(part.roi).clone();
    Reference reference = reference_;
    reference.image = &part;
    NormalPrior prior;
    prior.n_c = kPlane.normalized().cast<double>();
    return HeightSearch({}).find(patches_, {reference, reference}, matcher_, prior, 1.2);
  }

  std::vector<Patch> patches_;
};

TEST_F(HeightSearchTest, NeedsHalfOfTheTextureInTheImage) {
  addPatches(160, 210);
  const auto found = findIn(0, kCamera.width);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->height, 1.5, 0.05);
  EXPECT_TRUE(findIn(130, kCamera.width));
  EXPECT_FALSE(findIn(190, kCamera.width));
}

/// Lines across the path that repeat every kPeriod_px rows of the reference image.
class HeightSearchOverLines : public HeightSearchTest {
 protected:
  static constexpr int kPeriod_px = 24;
  HeightSearchOverLines()
      : HeightSearchTest([](float, float v) {
          return spots(100, 20 + static_cast<float>(static_cast<int>(v) % kPeriod_px));
        }) {}
};

// At greater heights the rows move less than a period, at smaller ones more.
TEST_F(HeightSearchOverLines, ALowerHeightThatFitsAsWellIsARival) {
  addPatches(196, 197);
  EXPECT_FALSE(findIn(0, kCamera.width));
}

}  // namespace
}  // namespace ground_scale_vo::direct
