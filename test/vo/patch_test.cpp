#include "vo/patch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "ground_scale_vo/vo/patch_alignment.hpp"
#include "support/scene.hpp"
#include "support/texture.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {
namespace {

using test::kCamera;
constexpr float kFar = std::numeric_limits<float>::infinity();
constexpr double kHeight = 1.65;      // of the camera above the floor
constexpr double kWallDistance = 20;  // ahead of the first camera

/// The place of the patch at `point` of an image in the next one.
std::optional<cv::Point2f> find(const cv::Mat& image, const cv::Mat& next, const cv::Point2f& point,
                                cv::Point2f guess, float max_distance = kFar) {
  Patch patch;
  if (!patch.cut(withBorder(image), point)) return std::nullopt;
  return patch.find(withBorder(next), max_distance, &guess) ? std::make_optional(guess)
                                                            : std::nullopt;
}

TEST(Patch, IsNotFoundWithoutTextureOutsideTheImageOrTooFarAway) {
  const cv::Mat image = test::blurredNoise(7);
  EXPECT_TRUE(find(image, image, {400, 124}, {401, 124}));
  const cv::Mat blank(image.size(), CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(find(blank, image, {400, 124}, {400, 124}));
  EXPECT_FALSE(find(image, image, {400, 124}, {-20, 124}));
  EXPECT_FALSE(find(image, image, {400, 124}, {400, 1e9f}));
  EXPECT_TRUE(find(image, image, {400, 124}, {401, 124}, 1.1f));
  EXPECT_FALSE(find(image, image, {400, 124}, {401, 124}, 0.9f));
  for (const bool turned : {false, true}) {
    for (const double across : {60.0, 3.0, 0.3}) {
      const cv::Mat edges = test::waves(across, turned);
      EXPECT_EQ(find(edges, edges, {400, 124}, {400, 124}).has_value(), across > 1)
          << across << turned;
    }
  }
}

// Also where it overlaps the border, at every place of a small image; and with full contrast, where
// the sums must not overflow.
TEST(Patch, IsFoundEverywhereInAnImage) {
  cv::Mat squares(37, 61, CV_8UC1);
  for (int y = 0; y < squares.rows; ++y) {
    for (int x = 0; x < squares.cols; ++x) {
      squares.at<unsigned char>(y, x) = (x % 6 < 3) != (y % 6 < 3) ? 0 : 255;
    }
  }
  const cv::Rect2f inside(5, 5, 50, 26);
  for (const cv::Mat& image : {test::blurredNoise(7)({100, 100, 61, 37}).clone(), squares}) {
    for (const cv::Point2f& u : test::gridPixels({73, 49}, 0, 3)) {
      const cv::Point2f at = u - cv::Point2f(5.7f, 5.4f);
      const auto found = find(image, image, at, at + cv::Point2f(0.4f, -0.3f));
      if (!inside.contains(at)) continue;
      ASSERT_TRUE(found) << at;
      EXPECT_LT(cv::norm(*found - at), 0.02) << at;
    }
  }
}

TEST(Patch, ItsCorrelationDoesNotDependOnTheIllumination) {
  const cv::Mat image = withBorder(test::blurredNoise(7));
  Patch patch;
  ASSERT_TRUE(patch.cut(image, {400, 124}));
  EXPECT_NEAR(patch.correlation(image, {400, 124}), 1, 1e-6);
  cv::Mat other;
  image.convertTo(other, CV_8U, 0.5, 40);
  EXPECT_GT(patch.correlation(withBorder(other), {400, 124}), 0.99);
  EXPECT_LT(patch.correlation(image, {430, 124}), 0.8);
  EXPECT_NEAR(patch.correlation(withBorder(image * 0), {400, 124}), 0, 1e-6);
}

/// Grey level of a surface at (a, b): smooth; on the wall and the near floor without a period
/// shorter than a patch.
double grey(double a, double b) {
  return 120 + 35 * std::sin(9.1 * a + 1.3 * std::sin(5.3 * b)) + 35 * std::sin(8.3 * b + 1.7 * a) +
         20 * std::sin(3.1 * a - 4.7 * b);
}

/// Image of the floor below the first camera, or with `wall` of a wall ahead of it, seen from
/// T_w_c.
cv::Mat render(const Eigen::Isometry3d& T_w_c, bool wall, double offset = 0) {
  const Eigen::Vector3d n = wall ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
  const double d = wall ? kWallDistance : kHeight;
  cv::Mat image(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(0));
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const Eigen::Vector3d ray = T_w_c.linear() * kCamera.ray({u, v});
      const double depth = (d - n.dot(T_w_c.translation())) / n.dot(ray);
      if (!(depth > 0 && depth < 200)) continue;
      const Eigen::Vector3d p = T_w_c.translation() + depth * ray;
      const double value = wall ? grey(p.x(), p.y()) : grey(p.x(), 0.5 * p.z());
      image.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(value + offset);
    }
  }
  return withBorder(image);
}

struct Errors {
  int tried = 0, found = 0;
  double rms_px = 0;
};

/// Warps patches of the surface and finds them after a motion, from half a pixel off.
Errors findWarped(bool wall, PatchSurface surface, const Eigen::Isometry3d& T_w_c,
                  double offset = 0) {
  const cv::Mat reference = render(Eigen::Isometry3d::Identity(), wall);
  const cv::Mat current = render(T_w_c, wall, offset);
  Errors errors;
  for (const cv::Point2f& pixel : test::gridPixels(reference.size(), 20, 16)) {
    const Eigen::Vector3d ray = kCamera.ray({pixel.x, pixel.y});
    // Without the distant floor, which is aliased in the image.
    if (!wall && ray.y() < kHeight / 15) continue;
    const Eigen::Vector3d p = ray * (wall ? kWallDistance : kHeight / ray.y());
    const cv::Point2f true_u = toCv(kCamera.project(T_w_c.inverse() * p));
    const auto warp = patchWarp(kCamera, p, T_w_c.inverse(), surface);
    if (!warp || !cv::Rect(10, 10, 780, 228).contains(cv::Point(true_u))) continue;
    ++errors.tried;
    Patch patch;
    cv::Point2f point = true_u + cv::Point2f(0.4f, -0.3f);
    if (!patch.cut(reference, pixel, warp->inverse().cast<float>()) ||
        !patch.find(current, 1.5f, &point) || patch.correlation(current, point) < 0.8f) {
      continue;
    }
    ++errors.found;
    errors.rms_px += std::pow(cv::norm(point - true_u), 2);
  }
  errors.rms_px = std::sqrt(errors.rms_px / std::max(1, errors.found));
  return errors;
}

TEST(Patch, OfTheFloorIsFoundAfterForwardMotion) {
  const auto T_w_c = test::pose({0.004, 0.02, 0}, {0.05, 0, 2.0});
  const Errors floor = findWarped(false, PatchSurface::kFloor, T_w_c);
  ASSERT_GT(floor.tried, 30);
  EXPECT_GT(floor.found, floor.tried * 8 / 10) << floor.tried;
  EXPECT_LT(floor.rms_px, 0.25);
  // With the model of a fronto-parallel surface the same patches fit worse.
  EXPECT_GT(findWarped(false, PatchSurface::kFrontoParallel, T_w_c).rms_px, 1.3 * floor.rms_px);
}

TEST(Patch, OfAWallIsFoundUnderOtherIllumination) {
  const auto T_w_c = test::pose({0.01, -0.02, 0.005}, {0.2, 0.05, 4.0});
  for (const double offset : {0, 25}) {
    const Errors errors = findWarped(true, PatchSurface::kFrontoParallel, T_w_c, offset);
    ASSERT_GT(errors.tried, 50);
    EXPECT_GT(errors.found, errors.tried * 9 / 10) << offset;
    EXPECT_LT(errors.rms_px, 0.05) << offset;
  }
}

// The memory beyond the borders of the parts shows the rest of the image.
TEST(Patch, ThatIsWarpedHasNoPixelsOutsideTheImage) {
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  const auto isCut = [&](int left, int top, int right, int bottom) {
    const cv::Mat part = wall(cv::Rect(400 - left, 120 - top, left + right, top + bottom));
    const cv::Point2f at(static_cast<float>(left), static_cast<float>(top));
    return Patch().cut(part, at, 2 * Eigen::Matrix2f::Identity());
  };
  constexpr int kEnough = 14, kTooFew = 9;
  EXPECT_TRUE(isCut(kEnough, kEnough, kEnough, kEnough));
  EXPECT_FALSE(isCut(kTooFew, kEnough, kEnough, kEnough));
  EXPECT_FALSE(isCut(kEnough, kTooFew, kEnough, kEnough));
  EXPECT_FALSE(isCut(kEnough, kEnough, kTooFew, kEnough));
  EXPECT_FALSE(isCut(kEnough, kEnough, kEnough, kTooFew));
}

}  // namespace
}  // namespace ground_scale_vo
