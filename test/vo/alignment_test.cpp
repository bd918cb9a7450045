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

namespace gsv {
namespace {

using test::kCamera;
using test::pose;
using test::wallFrom;
std::optional<PatchMatch> align(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                                const Eigen::Matrix2d& warp, const cv::Mat& current,
                                const Eigen::Vector2d& start) {
  return alignPatch(reference, u_ref, warp, current, start, OdometryOptions().min_correlation);
}

TEST(PatchAlignment, RejectsPatchesOfAnotherPlaceAndWithoutTextureInTwoDirections) {
  const auto identity = Eigen::Matrix2d::Identity();
  const cv::Mat wall = wallFrom(kCamera, Eigen::Isometry3d::Identity());
  const cv::Mat other = wallFrom(kCamera, pose({0, 0, 0}, {1.3, 0.9, 0}));
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
  const cv::Mat wall = wallFrom(kCamera, Eigen::Isometry3d::Identity());
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
    map_.addKeyframe(T_w_v_, corners, wallFrom(kCamera, Eigen::Isometry3d::Identity()));
    test::putOnWall(&map_);
  }

  Eigen::Vector2d pixelAt(const Eigen::Isometry3d& T_v_c, std::uint64_t id) const {
    return kCamera.project((T_w_v_ * T_v_c).inverse() * map_.point(id)->p_w);
  }

  /// Share of the features that are aligned in the image from this pose, to a quarter of a pixel.
  /// The others have too little texture.
  double align(const Eigen::Isometry3d& T_v_c, double gain = 1) {
    ImagePyramid image = trackingPyramid(applyGain(wallFrom(kCamera, T_v_c), gain));
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
  map_.addKeyframe(T_w_v_ * T_v_2, corners, wallFrom(kCamera, T_v_2));
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
}  // namespace gsv
