#include "vo/mapping.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/math.hpp"
#include "support/scene.hpp"
#include "vo/initialisation.hpp"

namespace ground_scale_vo {
namespace {

using test::kCamera;
using test::keyframePose;
using test::pose;

/// All points in an image, also those outside of its borders; the id is the point's index.
std::vector<Feature> featuresOf(const std::vector<Eigen::Vector3d>& points,
                                const Eigen::Isometry3d& T_w_c) {
  std::vector<Feature> features;
  for (const Observation& corner : test::observe(points, T_w_c)) {
    Feature feature;
    feature.id = corner.id;
    feature.u = kCamera.project(corner.x.homogeneous());
    feature.sigma = corner.sigma;
    features.push_back(feature);
  }
  return features;
}

ImagePyramid blankImage(double exposure = 1) {
  ImagePyramid image;
  image.image = cv::Mat(kCamera.height, kCamera.width, CV_8UC1, cv::Scalar(100 * exposure));
  image.exposure = exposure;
  return image;
}

/// A map of distant points.
class MappingTest : public testing::Test {
 protected:
  /// The map of keyframes 0 to n - 1 of the test trajectory, adjusted.
  void makeMap(int n) {
    mapping_ = std::make_unique<Mapping>(kCamera, OdometryOptions());
    map().addKeyframe(keyframePose(0), test::observe(points_, keyframePose(0)));
    for (int k = 1; k < n; ++k) addKeyframe(keyframePose(k), featuresAt(keyframePose(k)));
  }
  /// Returns the correction by the adjustment.
  std::optional<Eigen::Isometry3d> addKeyframe(const Eigen::Isometry3d& T_w_c,
                                               const std::vector<Feature>& features,
                                               double exposure = 1) {
    mapping_->addKeyframe(T_w_c, features, blankImage(exposure));
    return mapping_->applyAdjustment(&duration_ms_);
  }
  LocalMap& map() { return mapping_->map(); }
  std::vector<Feature> featuresAt(const Eigen::Isometry3d& T_w_c) const {
    return featuresOf(points_, T_w_c);
  }

  const std::vector<Eigen::Vector3d> points_ = test::farPoints(150);
  std::unique_ptr<Mapping> mapping_;
  double duration_ms_ = 0;
};

TEST_F(MappingTest, AKeyframeIsNeededForParallaxToTheLastOrFewTrackedFeatures) {
  std::vector<Eigen::Vector3d> points = test::randomPoints(200, 1);
  for (Eigen::Vector3d& p : points) p *= 10 / p.norm();  // all at the same distance
  Mapping mapping(kCamera, {});
  mapping.map().addKeyframe(Eigen::Isometry3d::Identity(),
                            test::observe(points, Eigen::Isometry3d::Identity()));
  const auto isNeeded = [&](const Eigen::Isometry3d& T_w_c, double tracked) {
    std::vector<Feature> features = featuresOf(points, T_w_c);
    features.resize(static_cast<std::size_t>(tracked));
    return mapping.needsKeyframe(T_w_c, features);
  };
  EXPECT_FALSE(isNeeded(pose({0.02, 0.1, 0.05}, {0, 0, 0}), 200)) << "a rotation is no parallax";
  // Sideways: slightly less parallax than displacement over distance, as the points are not all in
  // the direction of view.
  const double displacement = 10 * kKeyframeParallax;
  EXPECT_FALSE(isNeeded(pose({0, 0.1, 0}, {0.9 * displacement, 0, 0}), 200));
  EXPECT_TRUE(isNeeded(pose({0, 0.1, 0}, {1.3 * displacement, 0, 0}), 200));
  const double least = 200 * kKeyframeMinTracked;
  EXPECT_TRUE(isNeeded(Eigen::Isometry3d::Identity(), 0));
  EXPECT_TRUE(isNeeded(Eigen::Isometry3d::Identity(), 0.9 * least));
  EXPECT_FALSE(isNeeded(Eigen::Isometry3d::Identity(), 1.1 * least));
  // Features that are not in the last keyframe may have moved.
  auto corners = test::observe(points, pose({0, 0, 0}, {3, 0, 0}));
  corners.resize(40);
  mapping.map().addKeyframe(pose({0, 0, 0}, {3, 0, 0}), corners);
  EXPECT_FALSE(isNeeded(pose({0, 0, 0}, {3, 0, 0}), 200));
}

TEST_F(MappingTest, TheAdjustmentCorrectsTheNewestKeyframe) {
  for (const int keyframes : {1, 5}) {  // also with the landmarks that only now get a depth
    makeMap(keyframes);
    EXPECT_FALSE(mapping_->applyAdjustment(&duration_ms_));
    const Eigen::Isometry3d truth = keyframePose(keyframes);
    const Eigen::Isometry3d disturbed = truth * pose({0.002, -0.001, 0}, {0, 0, 0});
    const auto correction = addKeyframe(disturbed, featuresAt(truth));
    ASSERT_TRUE(correction);
    const Eigen::Isometry3d adjusted = map().keyframes().back().T_w_c;
    EXPECT_TRUE((*correction * disturbed).isApprox(adjusted, 1e-9));
    EXPECT_LT(test::angleBetween(adjusted, truth), 5e-4);
    EXPECT_LT((adjusted.translation() - truth.translation()).norm(), 0.01);
    EXPECT_FALSE(mapping_->applyAdjustment(&duration_ms_)) << "applied once";
  }
}

// But small steps add up: otherwise a camera that creeps would never get another keyframe.
TEST_F(MappingTest, KeyframesAtOnePlaceReplaceEachOther) {
  makeMap(4);
  for (int i = 0; i < 3; ++i) {
    addKeyframe(keyframePose(3), featuresAt(keyframePose(3)), 0.5);
    EXPECT_EQ(map().keyframes().size(), 5u);
    EXPECT_EQ(map().keyframes().back().exposure, 0.5);
    EXPECT_EQ(map().find(7)->observations.size(), 5u);
  }
  for (const double step : {1, 2, 3}) {
    // About 0.7 of the least parallax between two places for each step.
    const Eigen::Isometry3d T_w_c = keyframePose(3) * pose({0, 0, 0}, {0.035 * step, 0, 0});
    addKeyframe(T_w_c, featuresAt(T_w_c));
    EXPECT_EQ(map().keyframes().size(), step < 3 ? 5u : 6u) << step;
  }
  // Without known features, after a gap of the images, it is not at the place of the last one.
  std::vector<Feature> others = featuresAt(keyframePose(8));
  for (Feature& feature : others) feature.id += 1000;
  addKeyframe(keyframePose(8), others);
  EXPECT_TRUE(map().keyframes().back().has_parallax);
}

/// Three images of random points: the second from the place of the first, the third after a motion.
struct Initialisation {
  const Eigen::Isometry3d T_w_3 = pose({0, 0.02, 0}, {0.3, 0, 1.5});
  std::vector<Eigen::Vector3d> points;
  std::vector<Feature> first, second, third;
  MapInitialisation initialisation;
  Mapping mapping;

  explicit Initialisation(int n = 300)
      : points(test::randomPoints(n, 3)),
        first(featuresOf(points, Eigen::Isometry3d::Identity())),
        second(first),
        third(featuresOf(points, T_w_3)),
        initialisation(kCamera, {}),
        mapping(kCamera, {}) {}

  std::optional<std::vector<StampedPose>> start() {
    initialisation.restart(1000, first, blankImage().image);
    initialisation.addFrame(2000, second);
    EXPECT_FALSE(initialisation.tryStartMap(second, blankImage(), &mapping)) << "no motion";
    initialisation.addFrame(3000, third);
    auto poses = initialisation.tryStartMap(third, blankImage(0.7), &mapping);
    EXPECT_EQ(mapping.map().keyframes().empty(), !poses);
    EXPECT_EQ(initialisation.canContinueWith(third.size()), !poses);
    return poses;
  }
};

TEST(MapInitialisation, TheUnitOfTheMapIsItsMedianDepth) {
  Initialisation scene;
  const auto poses = scene.start();
  ASSERT_TRUE(poses);
  ASSERT_EQ(poses->size(), 3u);
  EXPECT_EQ(poses->front().stamp_ns, 1000);
  EXPECT_EQ(poses->back().stamp_ns, 3000);
  EXPECT_EQ(poses->front().T_w_c.matrix(), Eigen::Matrix4d::Identity());
  const LocalMap& map = scene.mapping.map();
  const Keyframe &one = map.keyframes().front(), &two = map.keyframes().back();
  EXPECT_EQ(poses->back().T_w_c.matrix(), two.T_w_c.matrix());
  std::vector<double> depths, true_depths;
  for (const Landmark& landmark : map.landmarks()) {
    if (!landmark.depth) continue;
    EXPECT_GT(landmark.depth->sigma, 0);
    depths.push_back(1 / landmark.depth->value);
    true_depths.push_back(scene.points[landmark.id()].z());
  }
  ASSERT_GT(depths.size(), 250u);
  EXPECT_NEAR(median(depths), 1, 0.01);
  const Eigen::Vector3d expected = scene.T_w_3.translation() / median(true_depths);
  EXPECT_LT((poses->back().T_w_c.translation() - expected).norm(), 0.01 * expected.norm());
  EXPECT_LT(test::angleBetween(poses->back().T_w_c, scene.T_w_3), 1e-3);
  EXPECT_LT((*poses)[1].T_w_c.translation().norm(), 1e-3);
  EXPECT_EQ(two.exposure, 0.7);
  EXPECT_EQ(one.image.at<unsigned char>(0, 0), 100);
  EXPECT_EQ(two.image.at<unsigned char>(0, 0), 70);
}

TEST(MapInitialisation, StartsNoMapWithoutEnoughPointsOrPoses) {
  Initialisation wrong_frame;
  wrong_frame.second =
      featuresOf(test::randomPoints(300, 4), Eigen::Isometry3d::Identity());  // has no pose
  EXPECT_FALSE(wrong_frame.start());
  for (const std::size_t good : {104, 40}) {
    Initialisation scene(104);
    for (std::size_t i = good; i < 104; ++i) {
      scene.third[i].u.y() +=
          i % 2 == 0 ? 10 + static_cast<double>(i) : -8 - static_cast<double>(i);
    }
    EXPECT_EQ(scene.start().has_value(), good > 50) << good;
  }
}

}  // namespace
}  // namespace ground_scale_vo
