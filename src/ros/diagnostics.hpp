#pragma once

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/console.h>

#include <Eigen/Core>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

// What the log and the diagnostics of a nodelet say, and the checks of the mounting that they
// report. All times are wall times: the clock of a bag may stop or jump.
namespace gsv {

struct TfFrames;  // odometry_output.hpp

/// Logs problems by kind, one message of a kind in each period, and counts dropped messages.
class WarningLog {
 public:
  static constexpr std::chrono::seconds kPeriod{5};

  /// nodelet: begins each line.
  explicit WarningLog(std::string nodelet) : nodelet_(std::move(nodelet)) {}

  /// A message that is not used. kind: a short name such as "image refused", which begins with what
  /// is dropped. is_error: the set-up is wrong. Like the others, returns whether it was printed.
  bool drop(const std::string& kind, const std::string& sentence, bool is_error = false);
  /// Something is wrong, but the messages are used.
  bool warn(const std::string& kind, const std::string& sentence,
            std::chrono::milliseconds period = kPeriod) {
    return print(ros::console::levels::Warn, kind, sentence, period);
  }
  /// A state that lasts: at most every hour, also when the numbers in the sentence change. Nothing
  /// for an empty sentence.
  void warnOfState(const std::string& sentence);
  bool error(const std::string& kind, const std::string& sentence) {
    return print(ros::console::levels::Error, kind, sentence, kPeriod);
  }

  /// Dropped messages by kind, since construction.
  const std::map<std::string, std::uint64_t>& dropped() const { return dropped_; }
  /// Sum over the kinds whose name begins with this text: "image " covers "image refused" and
  /// "image stamp".
  std::uint64_t dropped(const std::string& prefix) const;

 private:
  bool print(ros::console::Level level, const std::string& kind, const std::string& sentence,
             std::chrono::milliseconds period);

  const std::string nodelet_;
  std::map<std::string, std::uint64_t> dropped_;
  std::map<std::string, std::chrono::steady_clock::time_point> printed_;  ///< by kind
};

using diagnostic_msgs::DiagnosticStatus;

DiagnosticStatus statusOf(std::int8_t level, const std::string& message);
/// Level and message (docs/how-to/troubleshooting.md). held_s: since the first HELD frame after a
/// measurement or standstill; missing_image: why no image was used in the last second, empty: one
/// was, or images are not used.
DiagnosticStatus summarize(const ScaleEstimate& scale, double held_s,
                           const std::string& missing_image);

/// The axis about which a vehicle turns, in camera axes: the road's normal, also of a camera that
/// is mounted so that no road can be measured. Unlike a measured plane it does not tell up from
/// down.
class TurnAxis {
 public:
  void add(const VoFrame& frame);
  /// Unit, with the sign that has the smaller angle to the camera's up; empty: it has not turned
  /// enough.
  std::optional<Eigen::Vector3d> upward() const;

 private:
  std::optional<Eigen::Matrix3d> start_;  ///< R_w_c, in the map of the last frame
  Eigen::Matrix3d scatter_ = Eigen::Matrix3d::Zero();
  int turns_ = 0;
};

/// One sentence if the mounting of the camera is beyond the supported pitch and roll or contradicts
/// the road; empty: neither, or not known well enough yet. measured: of the latest frame.
/// turn_axis_c: TurnAxis::upward(). on_tf: null: the base is the camera, or the camera moves on it.
std::string mountingWarning(const ScaleRecovery::Output& measured,
                            const std::optional<Eigen::Vector3d>& turn_axis_c,
                            const TfFrames* on_tf, const std::string& camera_frame);

/// The camera height as a file that `calibrate_height` would write, with the measured mounting.
/// Throws DataError, one sentence, if it is not known from speeds with an error (95 %) of at most
/// 5 %. given_sigma: of a given height [m], 0 without one.
std::string learnedHeightYaml(const ScaleRecovery::Output& measured, double given_sigma);

}  // namespace gsv
