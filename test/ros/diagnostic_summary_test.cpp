// Level and message of the diagnostics in each state.

#include "ground_scale_vo/ros/diagnostic_summary.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "ground_scale_vo/ros/missing_input_log.hpp"

namespace ground_scale_vo {
namespace {

constexpr auto kOk = DiagnosticSummary::Level::kOk;
constexpr auto kWarn = DiagnosticSummary::Level::kWarn;
constexpr auto kError = DiagnosticSummary::Level::kError;

template <typename State>
struct SummaryCase {
  std::function<void(State*)> change;  ///< of the state in which all is well
  DiagnosticSummary::Level level;
  std::string message;
};

template <typename State>
void expectSummaries(const State& good, const std::vector<SummaryCase<State>>& cases) {
  for (const auto& one : cases) {
    State state = good;
    one.change(&state);
    const DiagnosticSummary summary = summarize(state);
    EXPECT_EQ(summary.level, one.level) << summary.message;
    EXPECT_EQ(summary.message, one.message);
  }
}

MonoVoState tracking() {
  MonoVoState state;
  state.images = {"/image", 0.1, 0.1, 0, ""};  // the last one 0.1 s ago, none dropped
  state.camera_info_topic = "/info";
  state.camera_known = true;
  state.status = VoStatus::kTracking;
  return state;
}

TEST(DiagnosticSummary, OfMonoVo) {
  using State = MonoVoState;
  expectSummaries<State>(
      tracking(),
      {{[](State*) {}, kOk, "tracking"},
       {[](State* s) { s->status = VoStatus::kInitialising; }, kWarn, "initialising"},
       {[](State* s) { s->status = VoStatus::kLost; }, kError, "lost"},
       {[](State* s) { s->status.reset(); }, kWarn, "initialising"},  // the first image
       // Missing input.
       {[](State* s) { s->images.silent_s = 7.4; }, kError, "no image for 7 s on /image"},
       {[](State* s) { s->images.silent_s = 4.9; }, kOk, "tracking"},
       {[](State* s) { s->images.silent_s.reset(); }, kError, "no image received yet on /image"},
       {[](State* s) { s->camera_known = false; }, kError, "no camera_info received yet on /info"},
       {[](State* s) { s->camera_known = false, s->camera_info_error = "all zeros"; }, kError,
        "all zeros"},
       {[](State* s) { s->camera_info_error = "all zeros"; }, kWarn, "tracking; all zeros"},
       // Dropped images.
       {[](State* s) { s->images.dropped = 3; }, kWarn,
        "tracking; 3 images dropped in the last second"},
       {[](State* s) { s->images.dropped = 3, s->status.reset(); }, kError,
        "no usable image; 3 images dropped in the last second"},
       {[](State* s) { s->images.dropped = 3, s->images.unused_s = 7; }, kError,
        "no usable image for 7 s; 3 images dropped in the last second"},
       {[](State* s) { s->images.unused_s = 7; }, kOk, "tracking"},  // they arrive seldom, or wait
       // Without a clock.
       {[](State* s) { s->images.clock_error = "no clock"; }, kWarn, "tracking; no clock"},
       {[](State* s) { s->images.silent_s = 7.4, s->images.clock_error = "no clock"; }, kError,
        "no image for 7 s on /image; no clock"},
       {[](State* s) {
          s->images.dropped = 3, s->images.clock_error = "no clock";
          s->status.reset();
        },
        kError, "no usable image; 3 images dropped in the last second; no clock"},
       // Wrong images.
       {[](State* s) { s->rectification_warning = "D is not zero"; }, kWarn,
        "tracking; D is not zero"},
       {[](State* s) { s->source_error = "two cameras"; }, kError, "two cameras"}});
}

TEST(DiagnosticSummary, OfScaleRecovery) {
  using State = ScaleRecoveryState;
  State good;
  good.frames = {"/vo/frame", 0.1, 0.1, 0, ""};
  good.status = ScaleStatus::kOk;
  const auto held = [](State* s, MeasurementStatus reason, double seconds) {
    s->status = ScaleStatus::kHeld;
    s->reason = reason;
    s->held_s = seconds;
  };
  expectSummaries<State>(
      good,
      {{[](State*) {}, kOk, "scale measured"},
       {[](State* s) { s->status = ScaleStatus::kUnknown; }, kWarn, "scale not known yet"},
       {[](State* s) {
          s->status = ScaleStatus::kUnknown, s->reason = MeasurementStatus::kNoPlane;
        },
        kWarn, "scale not known yet: no_plane"},
       // Holding the scale briefly or at standstill is normal.
       {[&](State* s) { held(s, MeasurementStatus::kNoPlane, 0.84); }, kOk,
        "scale held for 0.8 s: no_plane"},
       {[&](State* s) { held(s, MeasurementStatus::kNoPlane, 3.1); }, kWarn,
        "scale held for 3.1 s: no_plane"},
       {[&](State* s) { held(s, MeasurementStatus::kStandstill, 3.1); }, kOk,
        "scale held: standstill"},
       {[&](State* s) { held(s, MeasurementStatus::kVoNotTracking, 0); }, kWarn,
        "scale held for 0.0 s: vo_not_tracking"},
       // Input.
       {[](State* s) { s->missing_image_note = "no publisher on /image"; }, kWarn,
        "scale measured from features only, no publisher on /image"},
       {[](State* s) { s->frames.dropped = 2; }, kWarn,
        "scale measured; 2 frames dropped in the last second"},
       {[](State* s) { s->frames.dropped = 10, s->frames.unused_s = 7; }, kError,
        "no usable vo/frame for 7 s; 10 frames dropped in the last second"},
       {[](State* s) { s->frames.silent_s = 5; }, kError, "no vo/frame for 5 s on /vo/frame"},
       {[](State* s) { s->frames.silent_s.reset(); }, kError,
        "no vo/frame received yet on /vo/frame"},
       {[](State* s) { s->mounting_error = "no tf transform"; }, kError, "no tf transform"},
       {[](State* s) { s->tf_error = "two parents"; }, kError, "two parents"},
       {[](State* s) { s->source_error = "two cameras"; }, kError, "two cameras"},
       {[](State* s) { s->mounting_warning = "tf mounts"; }, kWarn, "scale measured; tf mounts"},
       {[](State* s) { s->sequence_error = "is 0"; }, kWarn, "scale measured; is 0"}});
}

// MissingInputLog reports an input that ends only while the clock runs.
TEST(MissingInput, IsNeverReceivedOrSilentButNotRefused) {
  MonoVoState state = tracking();
  EXPECT_FALSE(missingInput(state));
  state.images.silent_s = 7;
  EXPECT_TRUE(missingInput(state).value().was_received);
  state.images.silent_s.reset();
  EXPECT_FALSE(missingInput(state).value().was_received);
  state.camera_known = false;
  state.camera_info_error = "camera_info on topic /info is all zeros";
  EXPECT_FALSE(missingInput(state));
}

class MissingInputLogging : public testing::Test {
 protected:
  std::string due(double at_s, const std::optional<MissingInput>& missing, bool clock_runs = true) {
    return log_.due(missing, clock_runs,
                    MissingInputLog::Clock::time_point(std::chrono::seconds(1000)) +
                        std::chrono::milliseconds(static_cast<int>(1000 * at_s)));
  }

  const MissingInput no_image_{"image", "no image", false}, no_info_{"info", "no info", false};
  const MissingInput silent_{"image", "no image", true};
  MissingInputLog log_;
};

TEST_F(MissingInputLogging, AnInputThatWasNeverReceivedIsDueAfter5SecondsAndEvery30) {
  EXPECT_EQ(due(0, no_image_), "");
  EXPECT_EQ(due(4.9, no_image_), "");
  EXPECT_EQ(due(5, no_image_, false), "no image");  // also without a clock
  EXPECT_EQ(due(34.9, no_image_), "");
  EXPECT_EQ(due(35, no_image_), "no image");
  EXPECT_EQ(due(36, no_info_), "") << "the next input has 5 seconds of its own";
  EXPECT_EQ(due(40.9, no_info_), "");
  EXPECT_EQ(due(41, no_info_), "no info");
  EXPECT_EQ(due(42, std::nullopt), "");
}

TEST_F(MissingInputLogging, AnInputThatEndsIsDueAtOnceWhileTheClockRuns) {
  EXPECT_EQ(due(0, silent_), "no image");
  EXPECT_EQ(due(1, std::nullopt), "");
  EXPECT_EQ(due(29, silent_), "");
  EXPECT_EQ(due(100, silent_, false), "") << "a bag that is paused or has ended";
  EXPECT_EQ(due(101, silent_), "no image");
}

TEST_F(MissingInputLogging, AClockRunsIfItHasAdvancedSinceTheLastCall) {
  EXPECT_EQ(log_.due(std::nullopt, ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent_, ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent_, ros::Time(6)), "no image");
}

}  // namespace
}  // namespace ground_scale_vo
