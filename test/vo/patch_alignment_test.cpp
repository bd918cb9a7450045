#include "ground_scale_vo/vo/patch_alignment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/common/error.hpp"
#include "support/scene.hpp"
#include "vo/float_patch.hpp"

namespace ground_scale_vo {
namespace {

using test::kCamera;
constexpr double kHeight = 1.65;      // of the camera above the floor
constexpr double kWallDistance = 20;  // ahead of the first camera

/// Grey level of a surface at (a, b): smooth; on the wall and the near floor without a period
/// shorter than a patch.
double grey(double a, double b) {
  return 120 + 35 * std::sin(9.1 * a + 1.3 * std::sin(5.3 * b)) + 35 * std::sin(8.3 * b + 1.7 * a) +
         20 * std::sin(3.1 * a - 4.7 * b);
}

/// Image of the floor below the first camera, or with `wall` of a wall ahead of it, seen from
/// T_w_c.
cv::Mat render(const Eigen::Isometry3d& T_w_c, bool wall, double gain = 1, double offset = 0) {
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
      image.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(gain * value + offset);
    }
  }
  return image;
}

struct Errors {
  int tried = 0, found = 0;
  double rms_px = 0, mean_correlation = 0;
};

/// Aligns corners of the surface after a motion, from predictions that are half a pixel off.
Errors alignAll(bool wall, PatchSurface surface, const Eigen::Isometry3d& T_w_c, double gain = 1,
                double offset = 0) {
  const cv::Mat reference = render(Eigen::Isometry3d::Identity(), wall);
  const cv::Mat current = render(T_w_c, wall, gain, offset);
  const PatchAlignment alignment({});
  const Eigen::Isometry3d T_c_r = T_w_c.inverse();
  Errors errors;
  std::vector<cv::Point2f> corners;
  // Without the distant floor, which is aliased in the image.
  cv::Mat mask(reference.size(), CV_8UC1, cv::Scalar(255));
  if (!wall) mask.rowRange(0, 170) = 0;
  cv::goodFeaturesToTrack(reference, corners, 100, 0.05, 8, mask);
  for (const cv::Point2f& corner : corners) {
    const Eigen::Vector2d u_ref(corner.x, corner.y);
    const Eigen::Vector3d ray = kCamera.ray(u_ref);
    const Eigen::Vector3d p = ray * (wall ? kWallDistance : kHeight / ray.y());
    if (!wall && p.z() < 8) continue;
    const Eigen::Vector2d true_u = kCamera.project(T_c_r * p);
    if (!cv::Rect(10, 10, kCamera.width - 20, kCamera.height - 20)
             .contains(cv::Point(static_cast<int>(true_u.x()), static_cast<int>(true_u.y())))) {
      continue;
    }
    const auto warp = patchWarp(kCamera, p, T_c_r, surface);
    if (!warp) continue;
    ++errors.tried;
    const auto match =
        alignment.align(reference, u_ref, *warp, current, true_u + Eigen::Vector2d(0.4, -0.3));
    if (!match) continue;
    ++errors.found;
    errors.rms_px += (match->u - true_u).squaredNorm();
    errors.mean_correlation += match->correlation;
  }
  if (errors.found > 0) {
    errors.rms_px = std::sqrt(errors.rms_px / errors.found);
    errors.mean_correlation /= errors.found;
  }
  return errors;
}

TEST(PatchAlignment, alignsPatchesOfTheFloorAfterForwardMotion) {
  const auto T_w_c = test::pose({0.004, 0.02, 0}, {0.05, 0, 2.0});
  const Errors floor = alignAll(false, PatchSurface::kFloor, T_w_c);
  ASSERT_GT(floor.tried, 30);
  EXPECT_GT(floor.found, floor.tried * 8 / 10) << floor.tried;
  EXPECT_LT(floor.rms_px, 0.25);
  EXPECT_GT(floor.mean_correlation, 0.97);
  // With the model of a fronto-parallel surface the same patches fit worse.
  const Errors fronto_parallel = alignAll(false, PatchSurface::kFrontoParallel, T_w_c);
  EXPECT_LT(fronto_parallel.mean_correlation, floor.mean_correlation);
  EXPECT_GT(fronto_parallel.rms_px, 1.5 * floor.rms_px);
}

TEST(PatchAlignment, alignsPatchesOfAWallUnderOtherIllumination) {
  const auto T_w_c = test::pose({0.01, -0.02, 0.005}, {0.2, 0.05, 4.0});
  const Errors same = alignAll(true, PatchSurface::kFrontoParallel, T_w_c);
  ASSERT_GT(same.tried, 50);
  EXPECT_GT(same.found, same.tried * 9 / 10);
  EXPECT_LT(same.rms_px, 0.05);
  const Errors brighter = alignAll(true, PatchSurface::kFrontoParallel, T_w_c, 1, 25);
  EXPECT_GT(brighter.found, brighter.tried * 9 / 10);
  EXPECT_LT(brighter.rms_px, 0.05);
}

TEST(PatchAlignment, rejectsMissingAndTexturelessPatches) {
  const PatchAlignment alignment({});
  const auto identity = Eigen::Matrix2d::Identity();
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  const cv::Mat other = render(test::pose({0, 0, 0}, {1.3, 0.9, 0}), true);
  const cv::Mat blank(wall.size(), CV_8UC1, cv::Scalar(90));
  const Eigen::Vector2d u(400, 120);
  EXPECT_TRUE(alignment.align(wall, u, identity, wall, u));
  EXPECT_FALSE(alignment.align(blank, u, identity, wall, u)) << "no texture";
  EXPECT_FALSE(alignment.align(wall, u, identity, blank, u)) << "no matching patch";
  int wrong = 0;
  for (int x = 100; x < 700; x += 10) {
    const Eigen::Vector2d at(x, 120);
    wrong += alignment.align(wall, at, identity, other, at).has_value();
  }
  EXPECT_LT(wrong, 6) << "of 60 patches of another place";
  // Patches that leave an image.
  EXPECT_FALSE(alignment.align(wall, {2, 120}, identity, wall, u));
  EXPECT_FALSE(alignment.align(wall, u, identity, wall, {798, 120}));
  EXPECT_FALSE(alignment.align(wall, u, Eigen::Matrix2d::Zero(), wall, u));
}

// The memory beyond the borders of these parts of an image shows the rest of it, where a patch
// would fit.
TEST(PatchAlignment, usesNoPixelsOutsideTheImages) {
  const PatchAlignment alignment({});
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  const Eigen::Vector2d u(400, 120);
  const auto identity = Eigen::Matrix2d::Identity();
  const auto inCurrent = [&](int left, int top, int right, int bottom, double shift_px = 0) {
    const cv::Mat part = wall(cv::Rect(cv::Point(left, top), cv::Point(right, bottom)));
    const Eigen::Vector2d start = u - Eigen::Vector2d(left - shift_px, top);
    return alignment.align(wall, u, identity, part, start).has_value();
  };
  // Four pixels on each side, and one more to the right and below for the interpolation.
  EXPECT_TRUE(inCurrent(395, 115, 406, 126));
  EXPECT_FALSE(inCurrent(398, 115, 407, 127));
  EXPECT_FALSE(inCurrent(395, 118, 407, 127));
  EXPECT_FALSE(inCurrent(395, 115, 405, 127));
  EXPECT_FALSE(inCurrent(395, 115, 407, 125));
  EXPECT_TRUE(inCurrent(395, 115, 412, 127, 1.2));
  EXPECT_FALSE(inCurrent(397, 115, 412, 127, 1.2)) << "only the start is inside";

  // The warp halves the size: twice as many pixels of the reference.
  cv::Mat half;
  cv::resize(wall, half, {}, 0.5, 0.5, cv::INTER_AREA);
  const Eigen::Vector2d u_half = (u - Eigen::Vector2d(0.5, 0.5)) / 2;
  const auto inReference = [&](int left, int top, int right, int bottom) {
    const cv::Mat part = wall(cv::Rect(cv::Point(left, top), cv::Point(right, bottom)));
    const Eigen::Vector2d at = u - Eigen::Vector2d(left, top);
    return alignment.align(part, at, 0.5 * identity, half, u_half).has_value();
  };
  EXPECT_TRUE(inReference(388, 108, 414, 134));
  EXPECT_FALSE(inReference(391, 108, 414, 134));
  EXPECT_FALSE(inReference(388, 111, 414, 134));
  EXPECT_FALSE(inReference(388, 108, 410, 134));
  EXPECT_FALSE(inReference(388, 108, 414, 130));

  // The warp shears: the corners of the patch are five pixels farther to the left and right.
  Eigen::Matrix2d shear;
  shear << 1, 1, 0, 1;
  cv::Mat sheared;
  const cv::Mat M = (cv::Mat_<double>(2, 3) << 1, 1, -u.y(), 0, 1, 0);
  cv::warpAffine(wall, sheared, M, wall.size());
  const auto fromLeft = [&](int left) {
    const cv::Mat part = wall.colRange(left, wall.cols);
    return alignment.align(part, u - Eigen::Vector2d(left, 0), shear, sheared, u).has_value();
  };
  EXPECT_TRUE(fromLeft(388));
  EXPECT_FALSE(fromLeft(392));
}

TEST(PatchAlignment, limitsTheShift) {
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  const PatchAlignment alignment({});
  const Eigen::Vector2d u(400, 120);
  const auto alignedFrom = [&](double x_px, double y_px) {
    return alignment.align(wall, u, Eigen::Matrix2d::Identity(), wall,
                           u + Eigen::Vector2d(x_px, y_px));
  };
  const double limit = PatchAlignment::Options().max_shift_px;
  for (const auto& match : {alignedFrom(0.9 * limit, 0), alignedFrom(0, 0.9 * limit)}) {
    ASSERT_TRUE(match);
    EXPECT_LT((match->u - u).norm(), 0.05);
  }
  EXPECT_FALSE(alignedFrom(1.1 * limit, 0));
  EXPECT_FALSE(alignedFrom(0, 1.1 * limit));
  EXPECT_FALSE(alignedFrom(0.8 * limit, 0.8 * limit));
}

TEST(PatchAlignment, needsCorrelationAndTextureInTwoDirections) {
  const auto identity = Eigen::Matrix2d::Identity();
  const Eigen::Vector2d u(400, 120);
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  cv::Mat noise(wall.size(), CV_8UC1), noisy;
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 70);
  cv::addWeighted(wall, 0.5, noise, 1, 0, noisy);
  PatchAlignment::Options options;
  options.min_correlation = 0.1;
  const auto match = PatchAlignment(options).align(wall, u, identity, noisy, u);
  ASSERT_TRUE(match);
  EXPECT_LT(match->correlation, PatchAlignment::Options().min_correlation);
  EXPECT_FALSE(PatchAlignment({}).align(wall, u, identity, noisy, u));

  const auto isAligned = [&](const cv::Mat& image) {
    return PatchAlignment({}).align(image, u, identity, image, u).has_value();
  };
  EXPECT_TRUE(isAligned(render(Eigen::Isometry3d::Identity(), true, 0.1, 100)));
  EXPECT_FALSE(isAligned(render(Eigen::Isometry3d::Identity(), true, 0.02, 100)));
  // turned: by 45 degrees
  const auto waves = [&](double across, bool turned) {
    cv::Mat image(wall.size(), CV_8UC1);
    for (int v = 0; v < image.rows; ++v) {
      for (int x = 0; x < image.cols; ++x) {
        const double a = turned ? (x + v) * M_SQRT1_2 : x, b = turned ? (x - v) * M_SQRT1_2 : v;
        image.at<unsigned char>(v, x) = cv::saturate_cast<unsigned char>(
            120 + 60 * std::sin(0.7 * a) + across * std::sin(0.7 * b));
      }
    }
    return image;
  };
  for (const bool turned : {false, true}) {
    EXPECT_TRUE(isAligned(waves(20, turned))) << turned;
    EXPECT_FALSE(isAligned(waves(0.7, turned))) << "nearly an edge, " << turned;
  }
}

TEST(PatchAlignment, TheCorrelationDoesNotDependOnTheContrast) {
  const Eigen::Vector2d u(400, 120);
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  for (const double contrast : {0.5, 0.8}) {
    const cv::Mat other = render(Eigen::Isometry3d::Identity(), true, contrast, 20);
    const auto match = PatchAlignment({}).align(wall, u, Eigen::Matrix2d::Identity(), other, u);
    ASSERT_TRUE(match) << contrast;
    EXPECT_GT(match->correlation, 0.97) << contrast;
    EXPECT_LE(match->correlation, 1 + 1e-6) << contrast;
  }
}

TEST(PatchWarp, isTheDerivativeOfTheProjection) {
  const auto T_c_r = test::pose({0.01, 0.03, -0.02}, {0.1, 0.05, -1.5});
  const Eigen::Vector3d p(1.2, kHeight, 11);
  const std::pair<PatchSurface, Eigen::Vector3d> surfaces[] = {
      // and a displacement along it
      {PatchSurface::kFloor, {0.002, 0, 0.01}},
      {PatchSurface::kWall, {0, 0.002, 0.01}},
      {PatchSurface::kFrontoParallel, {0.002, 0.003, 0}}};
  for (const auto& [surface, displacement] : surfaces) {
    const auto warp = patchWarp(kCamera, p, T_c_r, surface);
    ASSERT_TRUE(warp);
    const Eigen::Vector3d q = p + displacement;
    const Eigen::Vector2d moved_r = kCamera.project(q) - kCamera.project(p);
    const Eigen::Vector2d moved_c = kCamera.project(T_c_r * q) - kCamera.project(T_c_r * p);
    EXPECT_LT((*warp * moved_r - moved_c).norm(), 0.05 * moved_c.norm()) << int(surface);
  }
}

TEST(PatchWarp, isEmptyForSurfacesSeenEdgeOnOrFromBehind) {
  const Eigen::Isometry3d identity = Eigen::Isometry3d::Identity();
  EXPECT_TRUE(patchWarp(kCamera, {1, 1.65, 10}, identity, PatchSurface::kFloor));
  EXPECT_FALSE(patchWarp(kCamera, {1, 0, 10}, identity, PatchSurface::kFloor)) << "edge-on";
  EXPECT_FALSE(patchWarp(kCamera, {1, 0.15, 10}, identity, PatchSurface::kFloor)) << "nearly";
  EXPECT_TRUE(patchWarp(kCamera, {1, 0.3, 10}, identity, PatchSurface::kFloor));
  EXPECT_FALSE(patchWarp(kCamera, {1, 1.65, -10}, identity, PatchSurface::kFrontoParallel))
      << "behind";
  EXPECT_FALSE(patchWarp(kCamera, {1, 1.65, 10}, test::pose({0, 0, 0}, {0, 0, -11}),
                         PatchSurface::kFrontoParallel))
      << "behind the current camera";
  // The line of sight two pixels below meets the surface, which is above the camera, behind it.
  const PinholeCamera wide_angle{160, 120, 50, 50, 80, 60};
  EXPECT_FALSE(patchWarp(wide_angle, {0, -0.25, 10}, test::pose({0, 0, 0}, {0, 0, 20}),
                         PatchSurface::kFloor));
}

TEST(PatchWarp, isEmptyForLargeChangesOfSize) {
  const auto hasWarp = [](double from, double to) {
    return patchWarp(kCamera, {0, 0, from}, test::pose({0, 0, 0}, {0, 0, to - from}),
                     PatchSurface::kFrontoParallel)
        .has_value();
  };
  EXPECT_TRUE(hasWarp(12, 4));  // nine times the area
  EXPECT_FALSE(hasWarp(14, 4));
  EXPECT_TRUE(hasWarp(4, 12));
  EXPECT_FALSE(hasWarp(4, 14));
}

TEST(PatchAlignment, rejectsOptionsOutOfRange) {
  PatchAlignment::Options options;
  options.window_px = 8;
  try {
    PatchAlignment{options};
    ADD_FAILURE() << "accepted";
  } catch (const OptionError& error) {
    EXPECT_STREQ(error.what(), "alignment/window_px must be odd");
  }
  options = {};
  options.min_correlation = 2;
  EXPECT_THROW(PatchAlignment{options}, OptionError);
}

TEST(PatchAlignment, alignsPatchesOfEverySize) {
  const Eigen::Vector2d u(400, 120), shift(0.4, -0.3);
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  PatchAlignment::Options options;
  for (options.window_px = 5; options.window_px <= kMaxWindow; options.window_px += 2) {
    const auto match =
        PatchAlignment(options).align(wall, u, Eigen::Matrix2d::Identity(), wall, u + shift);
    ASSERT_TRUE(match) << options.window_px;
    EXPECT_LT((match->u - u).norm(), 0.02) << options.window_px;
  }
  EXPECT_THROW(PatchAlignment{options}, OptionError) << "has no room for larger ones";
}

}  // namespace
}  // namespace ground_scale_vo
