// Level and message of the diagnostics in each state.

#include "ground_scale_vo/ros/diagnostic_summary.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

constexpr auto kOk = DiagnosticSummary::Level::kOk;
constexpr auto kWarn = DiagnosticSummary::Level::kWarn;
constexpr auto kError = DiagnosticSummary::Level::kError;

void expectSummary(const DiagnosticSummary& summary, DiagnosticSummary::Level level,
                   const std::string& message) {
  EXPECT_EQ(summary.level, level) << summary.message;
  EXPECT_EQ(summary.message, message);
}

class MonoVoSummary : public testing::Test {
 protected:
  MonoVoSummary() {
    state.images = {"/image", 0.1, 0.1, 0};  // the last one 0.1 s ago, none dropped
    state.camera_info_topic = "/info";
    state.camera_known = true;
    state.status = VoStatus::kTracking;
  }
  MonoVoState state;
};

TEST_F(MonoVoSummary, ReportsTheStatus) {
  expectSummary(summarize(state), kOk, "tracking");
  state.status = VoStatus::kInitialising;
  expectSummary(summarize(state), kWarn, "initialising");
  state.status = VoStatus::kLost;
  expectSummary(summarize(state), kError, "lost");
  state.status.reset();  // the first image is being processed
  expectSummary(summarize(state), kWarn, "initialising");
}

TEST_F(MonoVoSummary, NamesTheMissingInput) {
  state.images.silent_s = 7.4;
  expectSummary(summarize(state), kError, "no image for 7 s on /image");
  state.images.silent_s = 4.9;
  expectSummary(summarize(state), kOk, "tracking");
  state.images.silent_s.reset();
  expectSummary(summarize(state), kError, "no image received yet on /image");
  state.images.silent_s = 0.1;
  state.camera_known = false;
  expectSummary(summarize(state), kError, "no camera_info received yet on /info");
  state.camera_info_error = "camera_info on topic /info is all zeros";
  expectSummary(summarize(state), kError, "camera_info on topic /info is all zeros");
}

TEST_F(MonoVoSummary, ACameraInfoThatIsRefusedIsNotMissing) {
  state.camera_known = false;
  EXPECT_TRUE(missingInput(state));
  state.camera_info_error = "camera_info on topic /info is all zeros";
  EXPECT_FALSE(missingInput(state));
}

// The log reports it only while the clock runs (MissingInputLog).
TEST_F(MonoVoSummary, TellsAnInputThatEndsFromOneThatWasNeverReceived) {
  state.images.silent_s = 7;
  ASSERT_TRUE(missingInput(state));
  EXPECT_TRUE(missingInput(state)->was_received);
  state.images.silent_s.reset();
  ASSERT_TRUE(missingInput(state));
  EXPECT_FALSE(missingInput(state)->was_received);
}

TEST_F(MonoVoSummary, WarnsOfDroppedImages) {
  state.images.dropped = 3;
  expectSummary(summarize(state), kWarn, "tracking; 3 images dropped in the last second");
  state.status = VoStatus::kLost;
  expectSummary(summarize(state), kError, "lost; 3 images dropped in the last second");
  state.status.reset();
  expectSummary(summarize(state), kError, "no usable image; 3 images dropped in the last second");
}

TEST_F(MonoVoSummary, ReportsThatAllImagesAreRefused) {
  state.images.dropped = 10;
  state.images.unused_s = 4;
  expectSummary(summarize(state), kWarn, "tracking; 10 images dropped in the last second");
  state.images.unused_s = 7;
  expectSummary(summarize(state), kError,
                "no usable image for 7 s; 10 images dropped in the last second");
  state.images.dropped = 0;  // they arrive seldom, or wait
  expectSummary(summarize(state), kOk, "tracking");
}

TEST_F(MonoVoSummary, WarnsOfAnInvalidCameraInfoAfterAValidOne) {
  state.camera_info_error = "camera_info on topic /info is all zeros";
  expectSummary(summarize(state), kWarn, "tracking; camera_info on topic /info is all zeros");
  EXPECT_FALSE(missingInput(state));
  state.images.silent_s = 7;
  EXPECT_TRUE(missingInput(state));
}

TEST_F(MonoVoSummary, ReportsWhatIsWrongWithTheImages) {
  state.rectification_warning = "image_is_rectified is true, but D is not zero";
  expectSummary(summarize(state), kWarn, "tracking; image_is_rectified is true, but D is not zero");
  state.status = VoStatus::kLost;
  expectSummary(summarize(state), kError, "lost; image_is_rectified is true, but D is not zero");
  state.source_error = "two cameras publish on /image";
  expectSummary(summarize(state), kError, "two cameras publish on /image");
}

class ScaleRecoverySummary : public testing::Test {
 protected:
  ScaleRecoverySummary() {
    state.frames = {"/vo/frame", 0.1, 0.1, 0};  // the last one 0.1 s ago, none dropped
    state.status = ScaleStatus::kOk;
  }
  ScaleRecoveryState state;
};

TEST_F(ScaleRecoverySummary, HoldingBrieflyOrAtStandstillIsOk) {
  expectSummary(summarize(state), kOk, "scale measured");
  state.status = ScaleStatus::kHeld;
  state.reason = ScaleReason::kNoPlane;
  state.held_s = 0.84;
  expectSummary(summarize(state), kOk, "scale held for 0.8 s: no_plane");
  state.held_s = 3.1;
  expectSummary(summarize(state), kWarn, "scale held for 3.1 s: no_plane");
  state.reason = ScaleReason::kStandstill;
  expectSummary(summarize(state), kOk, "scale held: standstill");
  state.reason = ScaleReason::kVoNotTracking;
  state.held_s = 0;
  expectSummary(summarize(state), kWarn, "scale held for 0.0 s: vo_not_tracking");
}

TEST_F(ScaleRecoverySummary, WarnsUntilTheScaleIsKnown) {
  state.status = ScaleStatus::kUnknown;
  expectSummary(summarize(state), kWarn, "scale not known yet");
  state.reason = ScaleReason::kTooFewTriangles;
  expectSummary(summarize(state), kWarn, "scale not known yet: too_few_triangles");
}

TEST_F(ScaleRecoverySummary, WarnsOfAMountingThatTheRoadContradicts) {
  state.mounting_warning = "tf mounts the camera";
  expectSummary(summarize(state), kWarn, "scale measured; tf mounts the camera");
}

TEST_F(ScaleRecoverySummary, ReportsErrorsOfTfAndOfTheSequence) {
  state.sequence_error = "sequence is 0 in two vo/frame in a row";
  expectSummary(summarize(state), kWarn, "scale measured; sequence is 0 in two vo/frame in a row");
  state.tf_error = "frame \"camera\" has the parent \"base\" on tf";
  expectSummary(summarize(state), kError, state.tf_error);
}

TEST_F(ScaleRecoverySummary, ReportsThatAllFramesAreRefused) {
  state.frames.dropped = 10;
  state.frames.unused_s = 7;
  expectSummary(summarize(state), kError,
                "no usable vo/frame for 7 s; 10 frames dropped in the last second");
}

TEST_F(ScaleRecoverySummary, NamesTheMissingInput) {
  state.missing_image_note = "no publisher on /image";
  expectSummary(summarize(state), kWarn,
                "scale measured from features only, no publisher on /image");
  state.frames.dropped = 2;
  state.missing_image_note.clear();
  expectSummary(summarize(state), kWarn, "scale measured; 2 frames dropped in the last second");
  state.mounting_error = "no tf transform";
  expectSummary(summarize(state), kError, "no tf transform");
  state.frames.silent_s = 5.0;
  expectSummary(summarize(state), kError, "no vo/frame for 5 s on /vo/frame");
  state.frames.silent_s.reset();
  expectSummary(summarize(state), kError, "no vo/frame received yet on /vo/frame");
}

}  // namespace
}  // namespace ground_scale_vo
