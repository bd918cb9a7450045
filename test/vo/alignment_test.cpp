#include "vo/alignment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/vo/vo_options.hpp"
#include "support/scene.hpp"
#include "support/texture.hpp"
#include "support/wall.hpp"
#include "vo/feature.hpp"
#include "vo/lucas_kanade.hpp"

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
  return image;
}

std::optional<PatchMatch> align(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                                const Eigen::Matrix2d& warp, const cv::Mat& current,
                                const Eigen::Vector2d& start) {
  return alignPatch(reference, u_ref, warp, current, start, OdometryOptions().min_correlation);
}

struct Errors {
  int tried = 0, found = 0;
  double rms_px = 0;
};

/// Aligns patches of the surface after a motion, from predictions that are half a pixel off.
Errors alignAll(bool wall, PatchSurface surface, const Eigen::Isometry3d& T_w_c,
                double offset = 0) {
  const cv::Mat reference = render(Eigen::Isometry3d::Identity(), wall);
  const cv::Mat current = render(T_w_c, wall, offset);
  Errors errors;
  for (const cv::Point2f& pixel : test::gridPixels(reference.size(), 20, 16)) {
    const Eigen::Vector3d ray = kCamera.ray({pixel.x, pixel.y});
    // Without the distant floor, which is aliased in the image.
    if (!wall && ray.y() < kHeight / 15) continue;
    const Eigen::Vector3d p = ray * (wall ? kWallDistance : kHeight / ray.y());
    const Eigen::Vector2d true_u = kCamera.project(T_w_c.inverse() * p);
    const auto warp = patchWarp(kCamera, p, T_w_c.inverse(), surface);
    if (!warp || !cv::Rect(10, 10, 780, 228).contains(cv::Point(toCv(true_u)))) continue;
    ++errors.tried;
    const auto match =
        align(reference, {pixel.x, pixel.y}, *warp, current, true_u + Eigen::Vector2d(0.4, -0.3));
    if (!match) continue;
    ++errors.found;
    errors.rms_px += (match->u - true_u).squaredNorm();
  }
  errors.rms_px = std::sqrt(errors.rms_px / std::max(1, errors.found));
  return errors;
}

TEST(PatchAlignment, AlignsPatchesOfTheFloorAfterForwardMotion) {
  const auto T_w_c = test::pose({0.004, 0.02, 0}, {0.05, 0, 2.0});
  const Errors floor = alignAll(false, PatchSurface::kFloor, T_w_c);
  ASSERT_GT(floor.tried, 30);
  EXPECT_GT(floor.found, floor.tried * 8 / 10) << floor.tried;
  EXPECT_LT(floor.rms_px, 0.25);
  // With the model of a fronto-parallel surface the same patches fit worse.
  EXPECT_GT(alignAll(false, PatchSurface::kFrontoParallel, T_w_c).rms_px, 1.3 * floor.rms_px);
}

TEST(PatchAlignment, AlignsPatchesOfAWallUnderOtherIllumination) {
  const auto T_w_c = test::pose({0.01, -0.02, 0.005}, {0.2, 0.05, 4.0});
  for (const double offset : {0, 25}) {
    const Errors errors = alignAll(true, PatchSurface::kFrontoParallel, T_w_c, offset);
    ASSERT_GT(errors.tried, 50);
    EXPECT_GT(errors.found, errors.tried * 9 / 10) << offset;
    EXPECT_LT(errors.rms_px, 0.05) << offset;
  }
}

TEST(PatchAlignment, RejectsPatchesOfAnotherPlaceAndWithoutTextureInTwoDirections) {
  const auto identity = Eigen::Matrix2d::Identity();
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  const cv::Mat other = render(test::pose({0, 0, 0}, {1.3, 0.9, 0}), true);
  const cv::Mat blank(wall.size(), CV_8UC1, cv::Scalar(90));
  const Eigen::Vector2d u(400, 120);
  const auto isAligned = [&](const cv::Mat& reference, const cv::Mat& current) {
    return align(reference, u, identity, current, u).has_value();
  };
  EXPECT_TRUE(isAligned(wall, wall));
  EXPECT_FALSE(isAligned(blank, wall)) << "no texture";
  EXPECT_FALSE(isAligned(wall, blank)) << "no matching patch";
  EXPECT_FALSE(align(wall, u, Eigen::Matrix2d::Zero(), wall, u));
  int wrong = 0;
  for (int x = 100; x < 700; x += 10) {
    const Eigen::Vector2d at(x, 120);
    wrong += align(wall, at, identity, other, at).has_value();
  }
  EXPECT_LT(wrong, 6) << "of 60 patches of another place";
  for (const bool turned : {false, true}) {
    for (const double across : {20.0, 0.7}) {
      const cv::Mat image = test::waves(across, turned);
      EXPECT_EQ(isAligned(image, image), across > 1) << across << turned;
    }
  }
}

// The memory beyond the borders of these parts of an image shows the rest of it, where a patch
// would fit.
TEST(PatchAlignment, UsesNoPixelsOutsideTheImages) {
  const cv::Mat wall = render(Eigen::Isometry3d::Identity(), true);
  cv::Mat half;
  cv::resize(wall, half, {}, 0.5, 0.5, cv::INTER_AREA);
  const Eigen::Vector2d u(400, 120), u_half = (u - Eigen::Vector2d(0.5, 0.5)) / 2;
  const Eigen::Matrix2d identity = Eigen::Matrix2d::Identity();
  // Whether a patch is aligned in, or with a warp that halves its size from, a part of the image
  // that ends so many pixels from u.
  const auto isAligned = [&](bool in_part, int left, int top, int right, int bottom) {
    const cv::Rect area(400 - left, 120 - top, left + right, top + bottom);
    const cv::Mat part = wall(area);
    const Eigen::Vector2d at(left, top);
    return in_part ? align(wall, u, identity, part, at).has_value()
                   : align(part, at, 0.5 * identity, half, u_half).has_value();
  };
  for (const bool in_part : {true, false}) {
    // Four pixels on each side, and one more for the interpolation; twice as many of the reference.
    const int enough = in_part ? 6 : 14, too_few = in_part ? 2 : 9;
    EXPECT_TRUE(isAligned(in_part, enough, enough, enough, enough));
    EXPECT_FALSE(isAligned(in_part, too_few, enough, enough, enough));
    EXPECT_FALSE(isAligned(in_part, enough, too_few, enough, enough));
    EXPECT_FALSE(isAligned(in_part, enough, enough, too_few, enough));
    EXPECT_FALSE(isAligned(in_part, enough, enough, enough, too_few));
  }
}

TEST(PatchWarp, IsEmptyForSurfacesSeenEdgeOnOrFromBehindAndLargeChangesOfSize) {
  const auto hasWarp = [](const Eigen::Vector3d& p_r, double t_z, PatchSurface surface) {
    return patchWarp(kCamera, p_r, test::pose({0, 0, 0}, {0, 0, t_z}), surface).has_value();
  };
  EXPECT_TRUE(hasWarp({1, 1.65, 10}, 0, PatchSurface::kFloor));
  EXPECT_FALSE(hasWarp({1, 0.02, 10}, 0, PatchSurface::kFloor)) << "edge-on";
  EXPECT_FALSE(hasWarp({1, 1.65, -10}, 0, PatchSurface::kFrontoParallel)) << "behind";
  EXPECT_FALSE(hasWarp({1, 1.65, 10}, -11, PatchSurface::kFrontoParallel))
      << "behind the current camera";
  for (const double sign : {-1, 1}) {  // nearer and farther: nine and twelve times the area
    const double near = sign < 0 ? 12 : 4, far = sign < 0 ? 14 : 4;
    EXPECT_TRUE(hasWarp({0, 0, near}, sign * 8, PatchSurface::kFrontoParallel)) << sign;
    EXPECT_FALSE(hasWarp({0, 0, far}, sign * 10, PatchSurface::kFrontoParallel)) << sign;
  }
}

using test::pose;

constexpr double kTrackedSigma = 1e-3;
const Eigen::Vector2d kError(0.8, -0.6);  // of the tracked features [px]

/// A map of one keyframe v in front of a wall.
class ReferenceAlignmentTest : public testing::Test {
 protected:
  ReferenceAlignmentTest() {
    std::vector<Observation> corners;
    for (int v = 60; v < kCamera.height - 60; v += 16) {
      for (int u = 250; u < kCamera.width - 250; u += 16) {
        corners.push_back({corners.size(), kCamera.ray({u, v}).head<2>(), 0.001});
      }
    }
    map_.addKeyframe(T_w_v_, corners, test::wallFrom(kCamera, Eigen::Isometry3d::Identity()));
    test::putOnWall(&map_);
  }

  Eigen::Vector2d pixelAt(const Eigen::Isometry3d& T_v_c, std::uint64_t id) const {
    return kCamera.project((T_w_v_ * T_v_c).inverse() * map_.point(id)->p_w);
  }

  /// Share of the features that are aligned in the image from this pose, to a quarter of a pixel.
  /// The others have too little texture.
  double align(const Eigen::Isometry3d& T_v_c, double gain = 1) {
    ImagePyramid image = trackingPyramid(applyGain(test::wallFrom(kCamera, T_v_c), gain));
    image.exposure = gain;
    features_.clear();
    for (const Landmark& landmark : map_.landmarks()) {
      const std::uint64_t id = landmark.id();
      Feature feature;
      feature.id = id;
      feature.u = pixelAt(T_v_c, id) + kError;
      feature.sigma = kTrackedSigma;
      feature.surface = PatchSurface::kFloor;
      features_.push_back(feature);
    }
    alignment_.align(map_, image, T_w_v_ * T_v_c, &features_);
    double aligned = 0;
    for (const Feature& feature : features_) {
      const Eigen::Vector2d error = feature.u - pixelAt(T_v_c, feature.id);
      aligned += feature.sigma < kTrackedSigma && error.norm() < 0.25;
      if (feature.sigma == kTrackedSigma) {
        EXPECT_LT((error - kError).norm(), 1e-6);
      }
    }
    return aligned / static_cast<double>(features_.size());
  }

  const Eigen::Isometry3d T_w_v_ = pose({0.1, 0.2, -0.1}, {5, 6, 7});
  LocalMap map_;
  ReferenceAlignment alignment_{kCamera, OdometryOptions().min_correlation};
  std::vector<Feature> features_;
};

TEST_F(ReferenceAlignmentTest, AlignsFeaturesToTheirKeyframe) {
  EXPECT_GT(align(pose({0, 0.05, 0}, {0.5, 0.2, 4})), 0.7);
  double wall = 0;
  for (const Feature& feature : features_) {
    wall += feature.surface == PatchSurface::kFrontoParallel;
  }
  EXPECT_GT(wall / static_cast<double>(features_.size()), 0.7) << "its correlation is the best";
}

TEST_F(ReferenceAlignmentTest, AppliesTheGainSinceTheKeyframe) {
  for (const double gain_of_keyframe : {1.0, 0.4}) {
    Keyframe& keyframe = map_.keyframes().front();
    keyframe.exposure = gain_of_keyframe;
    keyframe.image = applyGain(keyframe.image, keyframe.exposure);
    for (const double gain : {1.0, 0.4, 0.7, 1.0}) {
      EXPECT_GT(align(pose({0, 0.02, 0}, {0.5, 0.2, 1}), gain), 0.55) << gain << gain_of_keyframe;
    }
  }
}

// A second keyframe sees the same features with an error of the tracking, and other features.
TEST_F(ReferenceAlignmentTest, AlignsToTheImageOfTheFirstKeyframeOfEachFeature) {
  const Eigen::Isometry3d T_v_2 = pose({0, 0, 0}, {0.2, 0, 2});
  std::vector<Observation> corners;
  for (const Landmark& landmark : map_.landmarks()) {
    const std::uint64_t id = landmark.id();
    corners.push_back({id, kCamera.ray(pixelAt(T_v_2, id) + kError).head<2>(), 0.001});
  }
  const std::size_t count = corners.size();
  for (std::size_t i = 0; i < count; ++i) {
    corners.push_back({1000 + i, map_.find(i)->observations.front().x, 0.001});
  }
  map_.addKeyframe(T_w_v_ * T_v_2, corners, test::wallFrom(kCamera, T_v_2));
  for (std::size_t i = 0; i < count; ++i) {
    map_.find(1000 + i)->depth = InverseDepth{1 / (test::kWallDistance - 2), 1e-4};
  }
  for (const double z : {3, 4}) EXPECT_GT(align(pose({0, 0.05, 0}, {0.5, 0.2, z})), 0.65) << z;
}

TEST_F(ReferenceAlignmentTest, UsesNoKeyframeFromMuchNearerOrFartherAway) {
  EXPECT_GT(align(pose({0, 0, 0}, {0, 0, 7})), 0.5);
  EXPECT_EQ(align(pose({0, 0, 0}, {0, 0, 8})), 0);  // a factor of 1.67
  EXPECT_GT(align(pose({0, 0, 0}, {0, 0, -11})), 0.5);
  EXPECT_EQ(align(pose({0, 0, 0}, {0, 0, -13})), 0);  // a factor of 1.65
}

}  // namespace
}  // namespace ground_scale_vo
