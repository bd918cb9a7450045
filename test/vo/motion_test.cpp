#include "vo/motion.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "ground_scale_vo/common/se3.hpp"

namespace gsv {
namespace {

const PinholeCamera kRollingCamera{640, 480, 400, 400, 320, 240};

/// Pixel of a point (in the camera axes at the stamp) in the image of a rolling shutter.
Eigen::Vector2d rollingPixel(const Eigen::Vector3d& p_c, const Vector6d& readout_motion) {
  Eigen::Vector2d u = kRollingCamera.project(p_c);
  for (int i = 0; i < 10; ++i) {
    const double share = kRollingCamera.readoutShare(u.y());
    u = kRollingCamera.project(motionFrom(share * readout_motion).inverse() * p_c);
  }
  return u;
}

TEST(RollingShutter, MapPointsAreShiftedToTheStamp) {
  Vector6d readout_motion;
  readout_motion << 0.002, 0.015, -0.001, 0.01, -0.01, 0.6;
  LocalMap map;
  std::vector<Observation> corners;
  std::vector<Feature> features;
  std::vector<Eigen::Vector2d> expected;
  for (const Eigen::Vector3d& p_c :
       {Eigen::Vector3d(1, 1.6, 4), Eigen::Vector3d(-2, 1.6, 8), Eigen::Vector3d(3, -4, 9)}) {
    Feature feature;
    feature.id = corners.size();
    feature.u = rollingPixel(p_c, readout_motion);
    corners.push_back(
        {feature.id, kRollingCamera.ray(kRollingCamera.project(p_c)).head<2>(), 1e-3});
    features.push_back(feature);
    expected.push_back(kRollingCamera.project(p_c));
  }
  map.addKeyframe(Eigen::Isometry3d::Identity(), corners);
  const std::vector<double> depths{4, 8, 9};
  for (std::size_t i = 0; i < depths.size(); ++i) {
    map.find(i)->depth = InverseDepth{1 / depths[i], 1e-3};
  }
  shiftFeatures(kRollingCamera, map, Eigen::Isometry3d::Identity(), readout_motion, 0.002,
                &features);
  for (std::size_t i = 0; i < features.size(); ++i) {
    const double before = (features[i].u - expected[i]).norm();
    EXPECT_GT(before, 1) << i;
    EXPECT_LT((features[i].atStamp() - expected[i]).norm(), 0.01 * before) << i;
    const double share = std::abs(kRollingCamera.readoutShare(features[i].u.y()));
    EXPECT_DOUBLE_EQ(features[i].to_stamp_sigma, 0.002 * share) << i;
  }
}

// In the image plane a feature at constant flow v is seen at u(t) = u + v t.
TEST(RollingShutter, FlowIsCorrectedForTheRows) {
  const Eigen::Vector2d at_first_stamp(300, 400), flow(20, 200);  // [px], [px/s]
  constexpr double kReadout = 0.03, kInterval = 0.1;
  const auto pixelAfter = [&](double t) {
    Eigen::Vector2d u = at_first_stamp + t * flow;
    for (int i = 0; i < 10; ++i) {
      u = at_first_stamp + (t + kReadout * kRollingCamera.readoutShare(u.y())) * flow;
    }
    return u;
  };
  Feature feature;
  feature.u = pixelAfter(kInterval);
  feature.flow = (feature.u - pixelAfter(0)) / kInterval;
  std::vector<Feature> features{feature};
  shiftFeaturesByFlow(kRollingCamera, kReadout, kInterval, &features);
  EXPECT_LT((features[0].flow - flow).norm(), 1e-9);
  EXPECT_LT((features[0].atStamp() - at_first_stamp - kInterval * flow).norm(), 1e-9);
}

}  // namespace
}  // namespace gsv
