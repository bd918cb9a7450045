#include "ground_scale_vo/ros/diagnostics.hpp"

#include <ros/console.h>
#include <ros/time.h>

#include <algorithm>

#include "common/text.hpp"

namespace ground_scale_vo {
namespace {

using Level = DiagnosticSummary::Level;

constexpr double kSilenceS = 5.0;  // as rqt_runtime_monitor before it marks a node stale
constexpr double kHeldS = 3.0;     // shorter gaps between measurements occur in every drive

}  // namespace

bool WarningLog::isDue(const std::string& kind, std::chrono::milliseconds period) {
  const auto now = std::chrono::steady_clock::now();
  const auto printed = printed_.find(kind);
  if (printed != printed_.end() && now - printed->second < period) return false;
  printed_[kind] = now;
  return true;
}

bool WarningLog::drop(const std::string& kind, const std::string& sentence) {
  const std::uint64_t count = ++dropped_[kind];
  return warn(kind, sentence + " (" + kind + ": " + std::to_string(count) + " so far)");
}

bool WarningLog::warn(const std::string& kind, const std::string& sentence,
                      std::chrono::milliseconds period) {
  if (!isDue(kind, period)) return false;
  ROS_WARN_STREAM_NAMED(nodelet_, nodelet_ << ": " << sentence);
  return true;
}

bool WarningLog::error(const std::string& kind, const std::string& sentence) {
  if (!isDue(kind, kPeriod)) return false;
  ROS_ERROR_STREAM_NAMED(nodelet_, nodelet_ << ": " << sentence);
  return true;
}

std::uint64_t WarningLog::dropped(const std::string& prefix) const {
  std::uint64_t sum = 0;
  for (const auto& [kind, count] : dropped_) {
    if (kind.compare(0, prefix.size(), prefix) == 0) sum += count;
  }
  return sum;
}

std::string missingClock() {
  if (!ros::Time::isSimTime() || !ros::Time::now().isZero()) return {};
  return "/use_sim_time is true, but no time was received on /clock: publish it, or for a live "
         "camera set /use_sim_time to false and restart all nodes";
}

std::string withMissingClock(const std::string& sentence) {
  const std::string missing = missingClock();
  return missing.empty() ? sentence : sentence + "; " + missing;
}

std::optional<MissingInput> InputWatch::missing(const std::string& topic) const {
  if (received_ == 0)
    return MissingInput{name_, "no " + name_ + " received yet on " + topic, false};
  if (since_last_.seconds() < kSilenceS) return std::nullopt;
  return MissingInput{
      name_, "no " + name_ + format(" for %.0f s on ", since_last_.seconds()) + topic, true};
}

DiagnosticSummary summarize(const StageState& state) {
  if (state.missing) return {Level::kError, state.missing->sentence};
  for (const std::string& error : state.errors) {
    if (!error.empty()) return {Level::kError, error};
  }
  DiagnosticSummary summary = state.stage;
  std::vector<std::string> warnings = state.warnings;
  warnings.insert(warnings.begin(), state.clock_error);
  if (state.dropped > 0) {
    if (state.since_processed_s.value_or(kSilenceS) >= kSilenceS) {
      summary = {Level::kError, "no usable " + state.input};
      if (state.since_processed_s)
        summary.message += format(" for %.0f s", *state.since_processed_s);
    }
    warnings.insert(warnings.begin(), std::to_string(state.dropped) + " " + state.inputs +
                                          " dropped in the last second");
  }
  for (const std::string& warning : warnings) {
    if (warning.empty()) continue;
    summary.level = std::max(summary.level, Level::kWarn);
    summary.message += "; " + warning;
  }
  return summary;
}

DiagnosticSummary summarize(const std::optional<VoStatus>& status) {
  const VoStatus known = status.value_or(VoStatus::kInitialising);
  return {known == VoStatus::kTracking ? Level::kOk
          : known == VoStatus::kLost   ? Level::kError
                                       : Level::kWarn,
          toString(known)};
}

DiagnosticSummary summarize(const ScaleEstimate& scale, double held_s,
                            const std::string& missing_image) {
  const std::string reason = toString(scale.measurement);
  switch (scale.status) {
    case ScaleStatus::kUnknown:
      return {Level::kWarn,
              "scale not known yet" +
                  (scale.measurement == MeasurementStatus::kMeasured ? "" : ": " + reason)};
    case ScaleStatus::kOk:
      if (missing_image.empty()) return {Level::kOk, "scale measured"};
      return {Level::kWarn, "scale measured from features only, " + missing_image};
    case ScaleStatus::kHeld:
      break;
  }
  if (scale.measurement == MeasurementStatus::kStandstill)
    return {Level::kOk, "scale held: " + reason};
  const bool is_normal = scale.measurement != MeasurementStatus::kVoNotTracking && held_s < kHeldS;
  return {is_normal ? Level::kOk : Level::kWarn,
          format("scale held for %.1f s: ", held_s) + reason};
}

}  // namespace ground_scale_vo
