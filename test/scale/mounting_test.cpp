#include "ground_scale_vo/scale/mounting.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/error.hpp"
#include "support/road_scene.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kStepHeights = 0.6;  // RoadScene::step in camera heights

TEST(Mounting, NormalIsThatOfThePitchedAndRolledCamera) {
  RoadScene scene;
  scene.pitch = 0.05;
  scene.roll = -0.03;
  Mounting mounting({});
  EXPECT_EQ(mounting.normal(), Eigen::Vector3d(0, -1, 0));
  MotionHistory history;
  const GroundPlane plane{scene.normal(), scene.height};
  for (int i = 0; i < 400; ++i) {
    history.add(scene.frame(static_cast<std::uint32_t>(i)).T_w_c);
    mounting.update(history.chord(3), &plane, kStepHeights);
  }
  EXPECT_NEAR(mounting.pitch(), 0.05, 1e-3);
  EXPECT_NEAR(mounting.roll(), -0.03, 1e-3);
  EXPECT_NEAR((mounting.normal() - scene.normal()).norm(), 0, 2e-3);
}

TEST(Mounting, ReverseGivesTheSamePitch) {
  RoadScene scene;
  scene.pitch = 0.04;
  Mounting mounting({});
  MotionHistory history;
  for (int i = 0; i < 200; ++i) {
    history.add(scene.frameAt(0, -0.4 * i).T_w_c);
    mounting.update(history.chord(3), nullptr, kStepHeights);
  }
  EXPECT_NEAR(mounting.pitch(), 0.04, 1e-3);
}

TEST(Mounting, PriorIsAUnitVectorOrthogonalToALongChord) {
  RoadScene scene;
  scene.pitch = 0.06;  // without update(), the mounting's is 0
  Mounting mounting({});
  MotionHistory history;
  const NormalPrior without_motion = mounting.prior(history, 0.7);
  EXPECT_EQ(without_motion.n_c, Eigen::Vector3d(0, -1, 0));
  for (std::uint32_t i = 0; i < 15; ++i) history.add(scene.frame(i).T_w_c);
  const NormalPrior prior = mounting.prior(history, 0.7);
  EXPECT_NEAR(prior.n_c.norm(), 1, 1e-12);
  EXPECT_NEAR(prior.forward_c.dot(prior.n_c), 0, 1e-12);
  EXPECT_NEAR((prior.n_c - scene.normal()).norm(), 0, 1e-3);
  EXPECT_LT(prior.pitch_sigma, 0.1 * without_motion.pitch_sigma);
  EXPECT_EQ(prior.roll_sigma, without_motion.roll_sigma);
}

TEST(Mounting, StaysWithinItsLimitAndResets) {
  Mounting::Options options;
  options.max_tilt_rad = 0.1;
  Mounting mounting(options);
  RoadScene scene;
  scene.pitch = 0.3;
  MotionHistory history;
  for (int i = 0; i < 400; ++i) {
    history.add(scene.frame(static_cast<std::uint32_t>(i)).T_w_c);
    mounting.update(history.chord(3), nullptr, kStepHeights);
  }
  EXPECT_EQ(mounting.pitch(), 0.1);
  mounting.reset();
  EXPECT_EQ(mounting.pitch(), 0);
}

TEST(Mounting, SidewaysAndNoMotionDoNotUpdate) {
  Mounting mounting({});
  mounting.update(std::nullopt, nullptr, 1);
  mounting.update(MotionHistory::Chord{Eigen::Vector3d(1, 0, 0), 1}, nullptr, 1);
  EXPECT_EQ(mounting.pitch(), 0);
}

TEST(Mounting, BadOptionsAreRefused) {
  Mounting::Options options;
  options.chord_length_heights = 0;
  EXPECT_THROW(Mounting{options}, OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
