#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// What the diagnostics say of a nodelet in one line: ERROR when it gives nothing, WARN when it
/// gives less than it should, OK else.
struct Health {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2 };  // as in DiagnosticStatus
  Level level = Level::kOk;
  std::string message;
};

/// What both nodelets have: an input that comes or not, and is left out now and then.
struct InputFacts {
  std::string topic;
  std::optional<double> silent_s;  ///< wall time since the last message; empty: none has come yet
  std::uint64_t left_out = 0;      ///< in the last second: overtaken, refused, of a bad stamp
};

struct MonoVoFacts {
  InputFacts images;
  std::string info_topic;
  bool camera_known = false;
  std::string info_refused;  ///< why the last camera_info was; empty: it was accepted
  std::optional<VoStatus> status;
};

struct ScaleFacts {
  InputFacts frames;
  ScaleStatus status = ScaleStatus::kUnknown;
  ScaleReason reason = ScaleReason::kNone;
  double held_s = 0;           ///< time of the stamps since it is held, standstill not counted
  std::string no_frames;       ///< why nothing metric can be published; empty: it can
  std::string without_images;  ///< why no image was used in the last second; empty: one was
};

Health healthOf(const MonoVoFacts& facts);
Health healthOf(const ScaleFacts& facts);

}  // namespace ground_scale_vo
