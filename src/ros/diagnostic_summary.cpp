#include "ground_scale_vo/ros/diagnostic_summary.hpp"

#include <cstdio>
#include <utility>

namespace ground_scale_vo {
namespace {

using Level = DiagnosticSummary::Level;

constexpr double kSilenceS = 5.0;  // as rqt_runtime_monitor before it marks a node stale
constexpr double kHeldS = 3.0;     // shorter gaps between measurements occur in every drive

std::string seconds(double value, int decimals) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f s", decimals, value);
  return text;
}

/// what: name of the input.
MissingInput neverReceived(const std::string& what, const std::string& topic) {
  return {what, "no " + what + " received yet on " + topic, false};
}

std::optional<MissingInput> missingInput(const InputState& input, const std::string& what) {
  std::optional<MissingInput> missing;
  if (!input.silent_s) {
    missing = neverReceived(what, input.topic);
  } else if (*input.silent_s >= kSilenceS) {
    missing = {what, "no " + what + " for " + seconds(*input.silent_s, 0) + " on " + input.topic,
               true};
  } else {
    return std::nullopt;
  }
  if (!input.clock_error.empty()) missing->sentence += "; " + input.clock_error;
  return missing;
}

/// All messages are refused, after others were processed.
bool isUnusable(const InputState& input) {
  return input.dropped > 0 && input.unused_s.value_or(0) >= kSilenceS;
}

DiagnosticSummary unusable(const InputState& input, const std::string& what) {
  return {Level::kError, "no usable " + what + " for " + seconds(*input.unused_s, 0)};
}

/// The summary with a further warning.
DiagnosticSummary withWarning(DiagnosticSummary summary, const std::string& text) {
  if (summary.level == Level::kOk) summary.level = Level::kWarn;
  summary.message += "; " + text;
  return summary;
}

DiagnosticSummary withInput(DiagnosticSummary summary, const InputState& input,
                            const std::string& what) {
  if (input.dropped > 0) {
    summary = withWarning(std::move(summary), std::to_string(input.dropped) + " " + what +
                                                  " dropped in the last second");
  }
  if (!input.clock_error.empty()) summary = withWarning(std::move(summary), input.clock_error);
  return summary;
}

DiagnosticSummary summarize(VoStatus status) {
  switch (status) {
    case VoStatus::kTracking:
      return {Level::kOk, toString(status)};
    case VoStatus::kInitialising:
      return {Level::kWarn, toString(status)};
    case VoStatus::kLost:
      break;
  }
  return {Level::kError, toString(status)};
}

DiagnosticSummary summarizeScale(const ScaleRecoveryState& state) {
  const std::string reason = toString(state.reason);
  switch (state.status) {
    case ScaleStatus::kUnknown:
      return {Level::kWarn,
              "scale not known yet" +
                  (state.reason == MeasurementStatus::kMeasured ? "" : ": " + reason)};
    case ScaleStatus::kOk:
      if (!state.missing_image_note.empty()) {
        return {Level::kWarn, "scale measured from features only, " + state.missing_image_note};
      }
      return {Level::kOk, "scale measured"};
    case ScaleStatus::kHeld:
      break;
  }
  if (state.reason == MeasurementStatus::kStandstill) return {Level::kOk, "scale held: " + reason};
  const bool normal = state.reason != MeasurementStatus::kVoNotTracking && state.held_s < kHeldS;
  return {normal ? Level::kOk : Level::kWarn,
          "scale held for " + seconds(state.held_s, 1) + ": " + reason};
}

}  // namespace

std::optional<MissingInput> missingInput(const MonoVoState& state) {
  if (!state.camera_known && !state.camera_info_error.empty()) return std::nullopt;
  if (auto missing = missingInput(state.images, "image")) return missing;
  if (!state.camera_known) return neverReceived("camera_info", state.camera_info_topic);
  return std::nullopt;
}

std::optional<MissingInput> missingInput(const ScaleRecoveryState& state) {
  return missingInput(state.frames, "vo/frame");
}

DiagnosticSummary summarize(const MonoVoState& state) {
  if (!state.camera_known && !state.camera_info_error.empty()) {
    return {Level::kError, state.camera_info_error};
  }
  if (const auto missing = missingInput(state)) return {Level::kError, missing->sentence};
  if (!state.source_error.empty()) return {Level::kError, state.source_error};
  DiagnosticSummary summary = summarize(state.status.value_or(VoStatus::kInitialising));
  if (!state.status && state.images.dropped > 0) summary = {Level::kError, "no usable image"};
  if (isUnusable(state.images)) summary = unusable(state.images, "image");
  summary = withInput(std::move(summary), state.images, "images");
  for (const std::string& warning : {state.camera_info_error, state.rectification_warning}) {
    if (!warning.empty()) summary = withWarning(std::move(summary), warning);
  }
  return summary;
}

DiagnosticSummary summarize(const ScaleRecoveryState& state) {
  if (const auto missing = missingInput(state)) return {Level::kError, missing->sentence};
  for (const std::string& error : {state.mounting_error, state.tf_error, state.source_error}) {
    if (!error.empty()) return {Level::kError, error};
  }
  DiagnosticSummary summary = summarizeScale(state);
  if (isUnusable(state.frames)) summary = unusable(state.frames, "vo/frame");
  summary = withInput(std::move(summary), state.frames, "frames");
  for (const std::string& warning : {state.mounting_warning, state.sequence_error}) {
    if (!warning.empty()) summary = withWarning(std::move(summary), warning);
  }
  return summary;
}

}  // namespace ground_scale_vo
