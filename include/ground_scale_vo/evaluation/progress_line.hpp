#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {

/// The progress of a command on stderr: on a terminal one line that is rewritten a few times a
/// second, elsewhere (in a log) a new line every ten seconds. Thread-safe.
class ProgressLine {
 public:
  ProgressLine(std::string name, std::size_t total);
  ~ProgressLine() { end(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// Counts one more of the total as done; the last one ends the line, which shows " UNIT, RATE/s"
  /// and what details() returns.
  void step(const char* unit, const std::function<std::string()>& details = {});

 private:
  using Clock = std::chrono::steady_clock;

  /// Leaves the progress line, if the cursor is on it.
  void end();

  const std::string name_;
  const std::size_t total_;
  const bool is_terminal_;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;  ///< guards what follows
  Clock::time_point shown_ = start_;
  std::size_t done_ = 0;
  bool is_open_ = false;  ///< the cursor is on the terminal's progress line
};

/// The ProgressLine of an offline run: frames, rate, distance travelled, scale and its status.
class RunProgress {
 public:
  RunProgress(const std::string& name, std::size_t frames) : line_(name, frames) {}
  void show(const RunFrame& frame);  ///< the next frame

 private:
  ProgressLine line_;
  double distance_ = 0;  ///< [m]
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

}  // namespace gsv
