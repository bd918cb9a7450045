#include <gtest/gtest.h>

#include "ground_scale_vo/vo/vo_options.hpp"
#include "support/scene.hpp"
#include "support/wall.hpp"
#include "vo/alignment.hpp"
#include "vo/tracking.hpp"

namespace ground_scale_vo {
namespace {

using test::kCamera;
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
    ImagePyramid image =
        FeatureTracker({}, {}).pyramid(applyGain(test::wallFrom(kCamera, T_v_c), gain));
    image.exposure = gain;
    features_.clear();
    for (const auto& [id, landmark] : map_.landmarks()) {
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
  for (const auto& [id, landmark] : map_.landmarks()) {
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
