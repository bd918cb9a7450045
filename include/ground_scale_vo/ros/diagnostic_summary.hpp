#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Level and message of a nodelet's diagnostics: ERROR if the input is missing or unusable, the
/// odometry is lost (of MonoVo; ScaleRecovery then holds the scale), the mounting of the camera is
/// not known, or the set-up is wrong (two cameras, a camera_info that keeps changing, two parents
/// on tf); WARN while starting, without a clock, and if the output is degraded, OK otherwise.
struct DiagnosticSummary {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2 };  // as in DiagnosticStatus
  Level level = Level::kOk;
  std::string message;
};

/// The input of either nodelet.
struct InputState {
  std::string topic;
  std::optional<double> silent_s;  ///< wall time since the last message; empty before the first
  std::optional<double> unused_s;  ///< the same since the last one that was processed
  std::uint64_t dropped = 0;       ///< in the last second: queue full, refused, invalid stamp
  std::string clock_error;         ///< missingClock()
};

struct MonoVoState {
  InputState images;
  std::string camera_info_topic;
  bool camera_known = false;
  std::string camera_info_error;      ///< why the last camera_info was refused; empty: accepted
  std::string source_error;           ///< ImageReceiver::sourceError()
  std::string rectification_warning;  ///< ImageReceiver::rectificationWarning()
  std::optional<VoStatus> status;
};

struct ScaleRecoveryState {
  InputState frames;
  ScaleStatus status = ScaleStatus::kUnknown;
  MeasurementStatus reason = MeasurementStatus::kMeasured;
  double held_s = 0;           ///< since the first HELD frame after a measurement or standstill [s]
  std::string mounting_error;  ///< why no metric pose can be published; empty: it can
  std::string mounting_warning;  ///< unsupportedMounting() or wrongMountingOnTf()
  std::string tf_error;          ///< another parent of the frame on tf; empty: none
  std::string source_error;      ///< ImageReceiver::sourceError()
  std::string sequence_error;    ///< what is wrong with `sequence` of vo/frame; empty: nothing
  /// Why no image was used in the last second; empty: one was, no frame was processed, or images
  /// are not used (refine: false).
  std::string missing_image_note;
};

/// An input without messages.
struct MissingInput {
  std::string input;          ///< "image", "camera_info" or "vo/frame"
  std::string sentence;       ///< for the log and the diagnostics
  bool was_received = false;  ///< before
};

/// Empty: all messages arrive, or those that arrive are refused.
std::optional<MissingInput> missingInput(const MonoVoState& state);
std::optional<MissingInput> missingInput(const ScaleRecoveryState& state);

DiagnosticSummary summarize(const MonoVoState& state);
DiagnosticSummary summarize(const ScaleRecoveryState& state);

}  // namespace ground_scale_vo
