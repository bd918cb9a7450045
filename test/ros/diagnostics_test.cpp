// Level and message of the diagnostics in each state, and what the log prints.

#include "ros/diagnostics.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

namespace ground_scale_vo {
namespace {

using Level = DiagnosticStatus;

DiagnosticStatus statusOf(std::int8_t level, const std::string& message) {
  DiagnosticStatus status;
  status.level = level;
  status.message = message;
  return status;
}

TEST(Summary, OfTheInputOfAStage) {
  StageState good;
  good.input = "image";
  good.inputs = "images";
  good.stage = statusOf(Level::OK, "tracking");
  good.since_processed_s = 0.1;
  good.errors = {""};
  good.warnings = {"", ""};
  const struct {
    std::function<void(StageState*)> change;
    std::int8_t level;
    std::string message;
  } kCases[] = {
      {[](StageState*) {}, Level::OK, "tracking"},
      {[](StageState* s) { s->missing = "no image"; }, Level::ERROR, "no image"},
      {[](StageState* s) {
         s->errors = {"", "two cameras", "two parents"};
       },
       Level::ERROR, "two cameras"},
      {[](StageState* s) {
         s->warnings = {"all zeros", "D is not zero"};
       },
       Level::WARN, "tracking; all zeros; D is not zero"},
      {[](StageState* s) { s->stage = statusOf(Level::ERROR, "lost"), s->warnings = {"zeros"}; },
       Level::ERROR, "lost; zeros"},
      {[](StageState* s) { s->dropped = 3; }, Level::WARN,
       "tracking; 3 images dropped in the last second"},
      {[](StageState* s) { s->dropped = 3, s->since_processed_s.reset(); }, Level::ERROR,
       "no usable image; 3 images dropped in the last second"},
      {[](StageState* s) { s->dropped = 3, s->since_processed_s = 7; }, Level::ERROR,
       "no usable image for 7 s; 3 images dropped in the last second"},
      {[](StageState* s) { s->since_processed_s = 7; }, Level::OK, "tracking"},  // they wait
      {[](StageState* s) { s->dropped = 3, s->warnings = {"no clock"}; }, Level::WARN,
       "tracking; 3 images dropped in the last second; no clock"}};
  for (const auto& one : kCases) {
    StageState state = good;
    one.change(&state);
    EXPECT_EQ(summarize(state).level, one.level) << one.message;
    EXPECT_EQ(summarize(state).message, one.message);
  }
}

TEST(Summary, OfTheOdometry) {
  const auto is = [](const std::optional<VoStatus>& status, std::int8_t level,
                     const char* message) {
    return summarize(status).level == level && summarize(status).message == message;
  };
  EXPECT_TRUE(is(std::nullopt, Level::WARN, "initialising"));
  EXPECT_TRUE(is(VoStatus::kInitialising, Level::WARN, "initialising"));
  EXPECT_TRUE(is(VoStatus::kTracking, Level::OK, "tracking"));
  EXPECT_TRUE(is(VoStatus::kLost, Level::ERROR, "lost"));
}

TEST(Summary, OfTheScale) {
  const struct {
    ScaleStatus status;
    MeasurementStatus reason;
    double held_s;
    const char* missing_image;
    std::int8_t level;
    std::string message;
  } kCases[] = {
      {ScaleStatus::kOk, MeasurementStatus::kMeasured, 0, "", Level::OK, "scale measured"},
      {ScaleStatus::kOk, MeasurementStatus::kMeasured, 0, "no publisher on /image", Level::WARN,
       "scale measured from features only, no publisher on /image"},
      {ScaleStatus::kUnknown, MeasurementStatus::kMeasured, 0, "", Level::WARN,
       "scale not known yet"},
      {ScaleStatus::kUnknown, MeasurementStatus::kNoPlane, 0, "", Level::WARN,
       "scale not known yet: no_plane"},
      // Holding the scale briefly or at standstill is normal.
      {ScaleStatus::kHeld, MeasurementStatus::kNoPlane, 0.84, "", Level::OK,
       "scale held for 0.8 s: no_plane"},
      {ScaleStatus::kHeld, MeasurementStatus::kNoPlane, 3.1, "", Level::WARN,
       "scale held for 3.1 s: no_plane"},
      {ScaleStatus::kHeld, MeasurementStatus::kStandstill, 3.1, "", Level::OK,
       "scale held: standstill"},
      {ScaleStatus::kHeld, MeasurementStatus::kVoNotTracking, 0, "", Level::WARN,
       "scale held for 0.0 s: vo_not_tracking"}};
  for (const auto& one : kCases) {
    ScaleEstimate scale;
    scale.status = one.status;
    scale.measurement = one.reason;
    EXPECT_EQ(summarize(scale, one.held_s, one.missing_image).level, one.level) << one.message;
    EXPECT_EQ(summarize(scale, one.held_s, one.missing_image).message, one.message);
  }
}

TEST(WarningLog, CountsAllAndPrintsTheFirstOfEachPeriod) {
  WarningLog log("nodelet");
  EXPECT_TRUE(log.drop("image size", "too small"));
  EXPECT_TRUE(log.drop("image stamp", "late"));
  EXPECT_TRUE(log.drop("camera_info refused", "zeros"));
  EXPECT_FALSE(log.drop("image size", "too small"));
  EXPECT_EQ(log.dropped().at("image size"), 2u);
  EXPECT_EQ(log.dropped("image "), 3u);
  const Stopwatch watch;
  const std::chrono::milliseconds period(300);
  EXPECT_TRUE(log.warn("other", "of messages that are used", period));
  // A warning with every image does not postpone the next print.
  while (!log.warn("other", "of messages that are used", period)) ASSERT_LT(watch.seconds(), 30);
  EXPECT_GE(watch.seconds(), 0.3);
  EXPECT_EQ(log.dropped().count("other"), 0u);
}

}  // namespace
}  // namespace ground_scale_vo
