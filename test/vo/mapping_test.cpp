#include "vo/mapping.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "ground_scale_vo/common/median.hpp"
#include "support/scene.hpp"
#include "vo/map_initialisation.hpp"

namespace ground_scale_vo {
namespace {

using test::keyframePose;
using test::pose;

using test::kCamera;

/// All points in an image, also those outside of its borders; the id is the point's index.
std::vector<Feature> featuresOf(const std::vector<Eigen::Vector3d>& points,
                                const Eigen::Isometry3d& T_w_c) {
  std::vector<Feature> features;
  for (const LocalMap::Corner& corner : test::observe(points, T_w_c)) {
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

/// The map of keyframes 0 to n - 1 of the test trajectory, adjusted.
void addKeyframes(const std::vector<Eigen::Vector3d>& points, int n, Mapping* mapping) {
  VisualOdometry::Times times;
  mapping->map().addKeyframe(keyframePose(0), test::observe(points, keyframePose(0)));
  for (int k = 1; k < n; ++k) {
    mapping->addKeyframe(keyframePose(k), featuresOf(points, keyframePose(k)), blankImage(),
                         &times);
    mapping->takeAdjustedMap(&times);
  }
}

TEST(Mapping, AKeyframeIsNeededForParallaxOrFewTrackedFeatures) {
  const VisualOdometry::Options options;
  std::vector<Eigen::Vector3d> points = test::randomPoints(200, 1);
  for (Eigen::Vector3d& p : points) p *= 10 / p.norm();  // all at the same distance
  Mapping mapping(kCamera, options);
  mapping.map().addKeyframe(Eigen::Isometry3d::Identity(),
                            test::observe(points, Eigen::Isometry3d::Identity()));
  const auto isNeeded = [&](const Eigen::Isometry3d& T_w_c, std::size_t tracked) {
    std::vector<Feature> features = featuresOf(points, T_w_c);
    features.resize(tracked);
    return mapping.needsKeyframe(T_w_c, features);
  };
  EXPECT_FALSE(isNeeded(pose({0.02, 0.1, 0.05}, {0, 0, 0}), 200)) << "a rotation is no parallax";
  // Sideways: slightly less parallax than displacement over distance, as the points are not all in
  // the direction of view.
  const double displacement = 10 * options.keyframe_parallax;
  EXPECT_FALSE(isNeeded(pose({0, 0.1, 0}, {0.9 * displacement, 0, 0}), 200));
  EXPECT_TRUE(isNeeded(pose({0, 0.1, 0}, {1.3 * displacement, 0, 0}), 200));
  EXPECT_TRUE(isNeeded(Eigen::Isometry3d::Identity(), 0));
  EXPECT_TRUE(isNeeded(Eigen::Isometry3d::Identity(), 110));
  EXPECT_FALSE(isNeeded(Eigen::Isometry3d::Identity(), 130));
}

TEST(Mapping, ParallaxIsThatOfFeaturesInTheLastKeyframe) {
  const auto points = test::farPoints(200);
  Mapping mapping(kCamera, {});
  mapping.map().addKeyframe(keyframePose(0), test::observe(points, keyframePose(0)));
  auto corners = test::observe(points, keyframePose(10));
  corners.resize(40);
  mapping.map().addKeyframe(keyframePose(10), corners);
  // The other features have moved since keyframe 0.
  EXPECT_FALSE(mapping.needsKeyframe(keyframePose(10), featuresOf(points, keyframePose(10))));
}

TEST(Mapping, TheCorrectionMovesThePoseOfTheNewestKeyframe) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  VisualOdometry::Times times;
  EXPECT_FALSE(mapping.takeAdjustedMap(&times));
  addKeyframes(points, 5, &mapping);
  const Eigen::Isometry3d disturbed = keyframePose(5) * pose({0.004, -0.003, 0}, {0.05, 0.02, 0});
  mapping.addKeyframe(disturbed, featuresOf(points, keyframePose(5)), blankImage(), &times);
  const auto correction = mapping.takeAdjustedMap(&times);
  ASSERT_TRUE(correction);
  EXPECT_GT(times.triangulate, 0);
  EXPECT_EQ(times.detect, 0);
  EXPECT_GT(times.bundle_adjustment, 0);
  EXPECT_GT(times.adjustment_wait, 0);
  const Eigen::Isometry3d adjusted = mapping.map().keyframes().back().T_w_c;
  EXPECT_GT(test::angleBetween(adjusted, disturbed), 0.003);
  EXPECT_TRUE((*correction * disturbed).isApprox(adjusted, 1e-9));
  EXPECT_LT((adjusted.translation() - keyframePose(5).translation()).norm(), 0.01);
  EXPECT_FALSE(mapping.takeAdjustedMap(&times)) << "applied once";
}

TEST(Mapping, AfterAnAdjustmentOutliersAreRemovedAndSigmasUpdated) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  VisualOdometry::Times times;
  addKeyframes(points, 5, &mapping);
  ASSERT_TRUE(mapping.map().find(7)->depth);
  const double sigma = mapping.map().find(8)->depth->sigma;
  mapping.map().find(8)->depth->sigma = 1;
  std::vector<Feature> features = featuresOf(points, keyframePose(5));
  features[7].u.y() += 20;
  mapping.addKeyframe(keyframePose(5), features, blankImage(), &times);
  ASSERT_EQ(mapping.map().find(7)->observations.size(), 6u);
  mapping.takeAdjustedMap(&times);
  EXPECT_EQ(mapping.map().find(7)->observations.size(), 5u);
  EXPECT_EQ(mapping.map().find(8)->observations.size(), 6u);
  EXPECT_LT(mapping.map().find(8)->depth->sigma, sigma);
  const double without_outlier = mapping.map().find(7)->depth->sigma;
  mapping.map().updateSigmas();
  EXPECT_DOUBLE_EQ(mapping.map().find(7)->depth->sigma, without_outlier);
}

TEST(Mapping, TheNewLandmarksOfAKeyframeTakePartInItsAdjustment) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  mapping.map().addKeyframe(keyframePose(0), test::observe(points, keyframePose(0)));
  const Eigen::Isometry3d disturbed = keyframePose(1) * pose({0.002, 0, 0}, {0, 0, 0});
  VisualOdometry::Times times;
  mapping.addKeyframe(disturbed, featuresOf(points, keyframePose(1)), blankImage(), &times);
  mapping.takeAdjustedMap(&times);
  EXPECT_LT(test::angleBetween(mapping.map().keyframes().back().T_w_c, keyframePose(1)), 0.0005);
}

TEST(Mapping, AnObservationWithALargeErrorIsRemovedAfterAnAdjustment) {
  const auto points = test::farPoints(150);
  for (const double limit : {0.02, 0.06}) {
    VisualOdometry::Options options;
    options.max_reprojection_error = limit;
    Mapping mapping(kCamera, options);
    VisualOdometry::Times times;
    addKeyframes(points, 5, &mapping);
    std::vector<Feature> features = featuresOf(points, keyframePose(5));
    features[7].u.y() += 0.04 * kCamera.fy;
    mapping.addKeyframe(keyframePose(5), features, blankImage(), &times);
    mapping.takeAdjustedMap(&times);
    EXPECT_EQ(mapping.map().find(7)->observations.size(), limit > 0.04 ? 6u : 5u);
  }
}

TEST(Mapping, HasTheOptionsOfTheMapAndOfTheAdjustment) {
  const auto points = test::farPoints(150);
  for (const int window : {1, 3}) {
    VisualOdometry::Options options;
    options.map.keyframes = 5;
    options.bundle_adjustment.window = window;
    Mapping mapping(kCamera, options);
    addKeyframes(points, 8, &mapping);
    ASSERT_EQ(mapping.map().keyframes().size(), 5u);
    for (Keyframe& keyframe : mapping.map().keyframes()) {
      keyframe.T_w_c = keyframe.T_w_c * pose({0, 0, 0}, {0.01, 0, 0});
    }
    std::vector<Eigen::Isometry3d> before;
    for (const Keyframe& keyframe : mapping.map().keyframes()) before.push_back(keyframe.T_w_c);
    mapping.adjustNow();
    for (int age = 0; age < 5; ++age) {
      const auto k = static_cast<std::size_t>(4 - age);
      const bool moved = !mapping.map().keyframes()[k].T_w_c.isApprox(before[k], 1e-12);
      EXPECT_EQ(moved, age < window) << "keyframe " << k << ", window " << window;
    }
  }
}

TEST(Mapping, KeyframesAtOnePlaceReplaceEachOther) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  VisualOdometry::Times times;
  addKeyframes(points, 4, &mapping);
  for (int i = 0; i < 3; ++i) {
    mapping.addKeyframe(keyframePose(3), featuresOf(points, keyframePose(3)), blankImage(0.5),
                        &times);
    mapping.takeAdjustedMap(&times);
    EXPECT_EQ(mapping.map().keyframes().size(), 5u);
    EXPECT_FALSE(mapping.map().keyframes().back().has_parallax);
    EXPECT_EQ(mapping.map().keyframes().back().exposure, 0.5);
  }
  mapping.addKeyframe(keyframePose(4), featuresOf(points, keyframePose(4)), blankImage(), &times);
  EXPECT_EQ(mapping.map().keyframes().size(), 5u);
  EXPECT_TRUE(mapping.map().keyframes().back().has_parallax);
}

// Otherwise a camera that creeps would never get another keyframe.
TEST(Mapping, SmallStepsAddUpToAnotherPlace) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  VisualOdometry::Times times;
  addKeyframes(points, 4, &mapping);
  for (const double step : {1, 2, 3}) {
    // About 0.7 of the least parallax between two places for each step.
    const Eigen::Isometry3d T_w_c = keyframePose(3) * pose({0, 0, 0}, {0.035 * step, 0, 0});
    mapping.addKeyframe(T_w_c, featuresOf(points, T_w_c), blankImage(), &times);
    mapping.takeAdjustedMap(&times);
    EXPECT_EQ(mapping.map().keyframes().size(), step < 3 ? 5u : 6u) << step;
    EXPECT_EQ(mapping.map().keyframes().back().has_parallax, step == 2) << step;
  }
}

// After a gap of the images, for example. The next keyframe must not replace it.
TEST(Mapping, AKeyframeWithoutKnownFeaturesIsNotAtThePlaceOfTheLast) {
  const auto points = test::farPoints(150);
  Mapping mapping(kCamera, {});
  VisualOdometry::Times times;
  addKeyframes(points, 4, &mapping);
  std::vector<Feature> others = featuresOf(points, keyframePose(8));
  for (Feature& feature : others) feature.id += 1000;
  mapping.addKeyframe(keyframePose(8), others, blankImage(), &times);
  mapping.takeAdjustedMap(&times);
  EXPECT_TRUE(mapping.map().keyframes().back().has_parallax);
}

TEST(Mapping, AnAdjustmentOfTooFewLandmarksIsNotUsable) {
  Mapping mapping(kCamera, {});
  addKeyframes(test::farPoints(150), 3, &mapping);
  EXPECT_TRUE(mapping.adjustNow());
  mapping.map().clear();
  EXPECT_FALSE(mapping.adjustNow());
}

TEST(MapInitialisation, ContinuesWithEnoughOfTheFirstFeaturesForABoundedTime) {
  const VisualOdometry::Options options;
  MapInitialisation initialisation(kCamera, options);
  EXPECT_FALSE(initialisation.canContinueWith(400)) << "there is no first image";
  const auto features = featuresOf(test::randomPoints(400, 3), Eigen::Isometry3d::Identity());
  initialisation.restart(0, 0, features, blankImage().image);
  const double least = 400 * options.initialisation_min_tracked;
  EXPECT_TRUE(initialisation.canContinueWith(static_cast<std::size_t>(least)));
  EXPECT_FALSE(initialisation.canContinueWith(static_cast<std::size_t>(least) - 1));
  initialisation.addFrame(1, 1, {features.begin(), features.begin() + 250});
  EXPECT_TRUE(initialisation.canContinueWith(static_cast<std::size_t>(least)));
  EXPECT_FALSE(initialisation.canContinueWith(static_cast<std::size_t>(least) - 1));
  const std::vector<Feature> few(features.begin(), features.begin() + 120);
  initialisation.restart(0, 0, few, blankImage().image);
  EXPECT_TRUE(initialisation.canContinueWith(100));
  EXPECT_FALSE(initialisation.canContinueWith(99));
  for (std::uint32_t i = 1; i < 3000; ++i) initialisation.addFrame(i, i, {});
  EXPECT_TRUE(initialisation.canContinueWith(120));
  initialisation.addFrame(3000, 3000, {});
  EXPECT_FALSE(initialisation.canContinueWith(120));
  initialisation.restart(0, 0, few, blankImage().image);
  EXPECT_TRUE(initialisation.canContinueWith(120));
}

TEST(MapInitialisation, TheUnitOfTheMapIsItsMedianDepth) {
  const auto points = test::randomPoints(300, 3);
  const Eigen::Isometry3d T_w_2 = pose({0, 0.02, 0}, {0.3, 0, 1.5});
  MapInitialisation initialisation(kCamera, {});
  Mapping mapping(kCamera, {});
  const auto first = featuresOf(points, Eigen::Isometry3d::Identity());
  initialisation.restart(3, 1000, first, blankImage().image);
  // As the first image: no motion, so no map.
  initialisation.addFrame(4, 2000, first);
  EXPECT_FALSE(initialisation.tryStartMap(first, blankImage(), &mapping));
  EXPECT_TRUE(mapping.map().keyframes().empty());

  const auto second = featuresOf(points, T_w_2);
  initialisation.addFrame(5, 3000, second);
  const auto poses = initialisation.tryStartMap(second, blankImage(0.7), &mapping);
  ASSERT_TRUE(poses);
  ASSERT_EQ(poses->size(), 3u);
  EXPECT_EQ(poses->front().sequence, 3u);
  EXPECT_EQ(poses->back().stamp_ns, 3000);
  EXPECT_EQ(poses->front().T_w_c.matrix(), Eigen::Matrix4d::Identity());
  EXPECT_EQ(poses->back().T_w_c.matrix(), mapping.map().keyframes().back().T_w_c.matrix());
  EXPECT_FALSE(initialisation.canContinueWith(second.size())) << "the frames are those of the map";
  std::vector<double> depths, true_depths;
  for (const auto& [id, landmark] : mapping.map().landmarks()) {
    if (!landmark.depth) continue;
    EXPECT_GT(landmark.depth->sigma, 0);
    depths.push_back(1 / landmark.depth->value);
    true_depths.push_back(points[id].z());
  }
  ASSERT_GT(depths.size(), 250u);
  EXPECT_NEAR(median(depths), 1, 0.01);
  const Eigen::Vector3d expected = T_w_2.translation() / median(true_depths);
  EXPECT_LT((poses->back().T_w_c.translation() - expected).norm(), 0.01 * expected.norm());
  EXPECT_LT(test::angleBetween(poses->back().T_w_c, T_w_2), 1e-3);
  EXPECT_LT((*poses)[1].T_w_c.translation().norm(), 1e-3);
  const Keyframe &one = mapping.map().keyframes().front(), &two = mapping.map().keyframes().back();
  EXPECT_EQ(one.exposure, 1);
  EXPECT_EQ(two.exposure, 0.7);
  EXPECT_EQ(one.image.at<unsigned char>(0, 0), 100);
  EXPECT_EQ(two.image.at<unsigned char>(0, 0), 70);
}

// The features of a frame between the first and the newest are wrong, so it has no pose.
TEST(MapInitialisation, StartsNoMapInWhichAFrameHasNoPose) {
  const auto points = test::randomPoints(300, 3);
  MapInitialisation initialisation(kCamera, {});
  Mapping mapping(kCamera, {});
  initialisation.restart(0, 1000, featuresOf(points, Eigen::Isometry3d::Identity()),
                         blankImage().image);
  initialisation.addFrame(1, 2000,
                          featuresOf(test::randomPoints(300, 4), Eigen::Isometry3d::Identity()));
  const auto newest = featuresOf(points, pose({0, 0.02, 0}, {0.3, 0, 1.5}));
  initialisation.addFrame(2, 3000, newest);
  EXPECT_FALSE(initialisation.tryStartMap(newest, blankImage(), &mapping));
  EXPECT_TRUE(mapping.map().keyframes().empty());
  EXPECT_TRUE(initialisation.canContinueWith(newest.size()));
}

TEST(MapInitialisation, NeedsParallaxAsItsOptionsSay) {
  const auto points = test::randomPoints(300, 3);
  VisualOdometry::Options options;
  options.two_view.min_parallax = 1;
  MapInitialisation initialisation(kCamera, options);
  Mapping mapping(kCamera, options);
  initialisation.restart(0, 1000, featuresOf(points, Eigen::Isometry3d::Identity()),
                         blankImage().image);
  const auto second = featuresOf(points, pose({0, 0.02, 0}, {0.3, 0, 1.5}));
  initialisation.addFrame(1, 2000, second);
  EXPECT_FALSE(initialisation.tryStartMap(second, blankImage(), &mapping));
}

/// `good` of 104 features are at the places of their points in the second image.
bool startsMapWith(std::size_t good, const VisualOdometry::Options& options = {}) {
  const auto points = test::randomPoints(104, 3);
  MapInitialisation initialisation(kCamera, options);
  Mapping mapping(kCamera, options);
  initialisation.restart(0, 1000, featuresOf(points, Eigen::Isometry3d::Identity()),
                         blankImage().image);
  auto second = featuresOf(points, pose({0, 0.02, 0}, {0.3, 0, 1.5}));
  for (std::size_t i = good; i < second.size(); ++i) {
    second[i].u.y() += i % 2 == 0 ? 10 + static_cast<double>(i) : -8 - static_cast<double>(i);
  }
  initialisation.addFrame(1, 2000, second);
  return initialisation.tryStartMap(second, blankImage(), &mapping).has_value();
}

TEST(MapInitialisation, NeedsEnoughPoints) {
  EXPECT_TRUE(startsMapWith(104));
  EXPECT_TRUE(startsMapWith(60));
  EXPECT_FALSE(startsMapWith(48));
}

TEST(MapInitialisation, NeedsPosesAsItsOptionsSay) {
  VisualOdometry::Options options;
  options.pose.min_inliers = 105;
  EXPECT_FALSE(startsMapWith(104, options));
}

}  // namespace
}  // namespace ground_scale_vo
