// What rqt_runtime_monitor shows of each state: its level and one line that says why.

#include "ground_scale_vo/ros/health.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

constexpr auto kOk = Health::Level::kOk;
constexpr auto kWarn = Health::Level::kWarn;
constexpr auto kError = Health::Level::kError;

void expect(const Health& health, Health::Level level, const std::string& message) {
  EXPECT_EQ(health.level, level) << health.message;
  EXPECT_EQ(health.message, message);
}

class MonoVoHealth : public testing::Test {
 protected:
  MonoVoHealth() {
    facts.images = {"/image", 0.1, 0};
    facts.info_topic = "/info";
    facts.camera_known = true;
    facts.status = VoStatus::kTracking;
  }
  MonoVoFacts facts;
};

TEST_F(MonoVoHealth, TellsTheStatus) {
  expect(healthOf(facts), kOk, "tracking");
  facts.status = VoStatus::kInitialising;
  expect(healthOf(facts), kWarn, "initialising");
  facts.status = VoStatus::kLost;
  expect(healthOf(facts), kError, "lost");
  facts.status.reset();  // the first image is being processed
  expect(healthOf(facts), kWarn, "initialising");
}

TEST_F(MonoVoHealth, NamesTheInputThatIsMissing) {
  facts.images.silent_s = 7.4;
  expect(healthOf(facts), kError, "no image for 7 s on /image");
  facts.images.silent_s.reset();
  expect(healthOf(facts), kError, "no image yet on /image");
  facts.images.silent_s = 0.1;
  facts.camera_known = false;
  expect(healthOf(facts), kError, "no camera_info yet on /info");
  facts.info_refused = "camera_info on topic /info is all zeros";
  expect(healthOf(facts), kError, "camera_info on topic /info is all zeros");
}

TEST_F(MonoVoHealth, WarnsOfWhatIsLeftOut) {
  facts.images.left_out = 3;
  expect(healthOf(facts), kWarn, "tracking; 3 images left out in the last second");
  facts.status = VoStatus::kLost;
  expect(healthOf(facts), kError, "lost; 3 images left out in the last second");
  facts.status.reset();
  expect(healthOf(facts), kError, "no image can be used; 3 images left out in the last second");
}

TEST_F(MonoVoHealth, WarnsOfABadCameraInfoAfterAGoodOne) {
  facts.info_refused = "camera_info on topic /info is all zeros";
  expect(healthOf(facts), kWarn, "tracking; camera_info on topic /info is all zeros");
}

class ScaleHealth : public testing::Test {
 protected:
  ScaleHealth() {
    facts.frames = {"/vo/frame", 0.1, 0};
    facts.status = ScaleStatus::kOk;
  }
  ScaleFacts facts;
};

TEST_F(ScaleHealth, HoldingForAMomentOrAtAStopIsNoFault) {
  expect(healthOf(facts), kOk, "the scale is measured");
  facts.status = ScaleStatus::kHeld;
  facts.reason = ScaleReason::kNoPlane;
  facts.held_s = 0.84;
  expect(healthOf(facts), kOk, "the scale is held for 0.8 s: no_plane");
  facts.held_s = 3.1;
  expect(healthOf(facts), kWarn, "the scale is held for 3.1 s: no_plane");
  facts.reason = ScaleReason::kStandstill;
  expect(healthOf(facts), kOk, "the scale is held: standstill");
  facts.reason = ScaleReason::kVoNotTracking;
  facts.held_s = 0;
  expect(healthOf(facts), kWarn, "the scale is held for 0.0 s: vo_not_tracking");
}

TEST_F(ScaleHealth, WarnsUntilTheScaleIsKnown) {
  facts.status = ScaleStatus::kUnknown;
  expect(healthOf(facts), kWarn, "the scale is not known yet");
  facts.reason = ScaleReason::kTooFewTriangles;
  expect(healthOf(facts), kWarn, "the scale is not known yet: too_few_triangles");
}

TEST_F(ScaleHealth, NamesTheInputThatIsMissing) {
  facts.without_images = "no image: nobody publishes /image";
  expect(healthOf(facts), kWarn,
         "the scale is measured by points alone, no image: nobody publishes /image");
  facts.frames.left_out = 2;
  facts.without_images.clear();
  expect(healthOf(facts), kWarn, "the scale is measured; 2 frames left out in the last second");
  facts.no_frames = "tf knows no way";
  expect(healthOf(facts), kError, "tf knows no way");
  facts.frames.silent_s = 5.0;
  expect(healthOf(facts), kError, "no frame for 5 s on /vo/frame");
  facts.frames.silent_s.reset();
  expect(healthOf(facts), kError, "no frame yet on /vo/frame");
}

}  // namespace
}  // namespace ground_scale_vo
