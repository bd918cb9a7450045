#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/time.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

// What the log and the diagnostics of a nodelet say. All times are wall times: the clock of a bag
// may stop or jump.
namespace ground_scale_vo {

/// Logs problems by kind, one message of a kind at a time, and counts dropped messages.
class WarningLog {
 public:
  static constexpr std::chrono::seconds kPeriod{5};

  /// nodelet: begins each line.
  explicit WarningLog(std::string nodelet) : nodelet_(std::move(nodelet)) {}

  /// A message that is not used. kind: a short name such as "image refused", which begins with what
  /// is dropped. Like the others, returns whether it was printed: the first one of each period is.
  bool drop(const std::string& kind, const std::string& sentence);
  /// Something is wrong, but the messages are used.
  bool warn(const std::string& kind, const std::string& sentence,
            std::chrono::milliseconds period = kPeriod);
  bool error(const std::string& kind, const std::string& sentence);

  /// Dropped messages by kind, since construction.
  const std::map<std::string, std::uint64_t>& dropped() const { return dropped_; }
  /// Sum over the kinds whose name begins with this text: "image " covers "image refused" and
  /// "image stamp".
  std::uint64_t dropped(const std::string& prefix) const;

 private:
  bool isDue(const std::string& kind, std::chrono::milliseconds period);

  const std::string nodelet_;
  std::map<std::string, std::uint64_t> dropped_;
  std::map<std::string, std::chrono::steady_clock::time_point> printed_;  ///< by kind
};

/// One clause while ROS time does not run, else empty. Drivers then stamp their images with
/// zero, or wait for the time.
std::string missingClock();
/// The sentence, followed by missingClock().
std::string withMissingClock(const std::string& sentence);

/// An input without messages.
struct MissingInput {
  std::string input;  ///< "image", "camera_info" or "vo/frame"
  std::string sentence;
  bool was_received = false;  ///< before
};

/// The messages of an input, also those that are refused.
class InputWatch {
 public:
  /// name: "image", "vo/frame".
  explicit InputWatch(std::string name) : name_(std::move(name)) {}

  void count() {
    ++received_;
    since_last_ = Stopwatch();
  }
  std::uint64_t received() const { return received_; }
  /// Empty: they arrive.
  std::optional<MissingInput> missing(const std::string& topic) const;

 private:
  std::string name_;
  std::uint64_t received_ = 0;
  Stopwatch since_last_;
};

/// Level and message of a nodelet's diagnostics: ERROR if the input is missing or unusable, the
/// odometry is lost (MonoVo; ScaleRecovery then holds the scale), the mounting of the camera is
/// not known, or the set-up is wrong (two cameras, a camera_info that keeps changing, two parents
/// on tf); WARN while starting, without a clock, and if the output is degraded, OK otherwise.
struct DiagnosticSummary {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2 };  // as in DiagnosticStatus
  Level level = Level::kOk;
  std::string message;
};

/// What the summary of a nodelet depends on. Empty texts: nothing is wrong.
struct StageState {
  std::string input, inputs;                ///< name of the input, and the plural
  std::optional<MissingInput> missing;      ///< takes precedence over `errors`
  std::vector<std::string> errors;          ///< the first one is the summary
  DiagnosticSummary stage;                  ///< of the last frame
  std::optional<double> since_processed_s;  ///< since the last frame; empty: none yet
  std::uint64_t dropped = 0;                ///< in the last second: queue full, refused, stamp
  std::string clock_error;                  ///< missingClock()
  std::vector<std::string> warnings;        ///< appended
};
DiagnosticSummary summarize(const StageState& state);

/// Empty: no image has been processed.
DiagnosticSummary summarize(const std::optional<VoStatus>& status);
/// held_s: since the first HELD frame after a measurement or standstill. missing_image: why no
/// image was used in the last second; empty: one was, or images are not used.
DiagnosticSummary summarize(const ScaleEstimate& scale, double held_s,
                            const std::string& missing_image);

}  // namespace ground_scale_vo
