#include "ground_scale_vo/ros/health.hpp"

#include <cstdio>
#include <utility>

namespace ground_scale_vo {
namespace {

constexpr double kSilenceS = 5.0;  // as rqt_runtime_monitor's before it calls a node stale
constexpr double kHeldS = 3.0;     // shorter than that is an ordinary drive

std::string seconds(double value, int decimals) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f s", decimals, value);
  return text;
}

/// The input is missing. what: in words.
std::optional<Health> missing(const InputFacts& input, const std::string& what) {
  if (!input.silent_s)
    return Health{Health::Level::kError, "no " + what + " yet on " + input.topic};
  if (*input.silent_s < kSilenceS) return std::nullopt;
  return Health{Health::Level::kError,
                "no " + what + " for " + seconds(*input.silent_s, 0) + " on " + input.topic};
}

/// The same health, at best a warning, with one more thing to say.
Health warned(Health health, const std::string& text) {
  if (health.level == Health::Level::kOk) health.level = Health::Level::kWarn;
  health.message += "; " + text;
  return health;
}

Health leftOut(Health health, const InputFacts& input, const std::string& what) {
  if (input.left_out == 0) return health;
  return warned(std::move(health),
                std::to_string(input.left_out) + " " + what + " left out in the last second");
}

Health healthOf(VoStatus status) {
  switch (status) {
    case VoStatus::kTracking:
      return {Health::Level::kOk, toString(status)};
    case VoStatus::kInitialising:
      return {Health::Level::kWarn, toString(status)};
    case VoStatus::kLost:
      break;
  }
  return {Health::Level::kError, toString(status)};
}

Health ofScale(const ScaleFacts& facts) {
  const std::string reason = toString(facts.reason);
  switch (facts.status) {
    case ScaleStatus::kUnknown:
      return {Health::Level::kWarn, "the scale is not known yet" +
                                        (facts.reason == ScaleReason::kNone ? "" : ": " + reason)};
    case ScaleStatus::kOk:
      if (!facts.without_images.empty()) {
        return {Health::Level::kWarn,
                "the scale is measured by points alone, " + facts.without_images};
      }
      return {Health::Level::kOk, "the scale is measured"};
    case ScaleStatus::kHeld:
      break;
  }
  if (facts.reason == ScaleReason::kStandstill) {
    return {Health::Level::kOk, "the scale is held: " + reason};
  }
  const bool normal = facts.reason != ScaleReason::kVoNotTracking && facts.held_s < kHeldS;
  return {normal ? Health::Level::kOk : Health::Level::kWarn,
          "the scale is held for " + seconds(facts.held_s, 1) + ": " + reason};
}

}  // namespace

Health healthOf(const MonoVoFacts& facts) {
  if (!facts.camera_known && !facts.info_refused.empty()) {
    return {Health::Level::kError, facts.info_refused};
  }
  if (const std::optional<Health> none = missing(facts.images, "image")) return *none;
  if (!facts.camera_known) {
    return {Health::Level::kError, "no camera_info yet on " + facts.info_topic};
  }
  Health health = healthOf(facts.status.value_or(VoStatus::kInitialising));
  if (!facts.status && facts.images.left_out > 0) {
    health = {Health::Level::kError, "no image can be used"};
  }
  health = leftOut(health, facts.images, "images");
  return facts.info_refused.empty() ? health : warned(std::move(health), facts.info_refused);
}

Health healthOf(const ScaleFacts& facts) {
  if (const std::optional<Health> none = missing(facts.frames, "frame")) return *none;
  if (!facts.no_frames.empty()) return {Health::Level::kError, facts.no_frames};
  return leftOut(ofScale(facts), facts.frames, "frames");
}

}  // namespace ground_scale_vo
