#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

namespace ground_scale_vo {

/// The progress of a command on stderr: on a terminal one line that is rewritten a few times a
/// second, elsewhere (in a log) a new line every ten seconds. Thread-safe.
class ProgressLine {
 public:
  ProgressLine(std::string name, std::size_t total);
  ~ProgressLine() { end("\n"); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// Counts one more of the total as done; the last one ends the line. details(rate) returns the
  /// rest of the line and is called when the line is written; rate: steps per second.
  using Details = std::function<std::string(double rate)>;
  void step(const Details& details);
  /// The same, with " UNIT, RATE/s" as details.
  void step(const char* unit);

  /// Clears the line while print() writes whole lines of the result to stdout.
  void pause(const std::function<void()>& print);

 private:
  using Clock = std::chrono::steady_clock;

  /// Leaves the progress line, if the cursor is on it, by writing the terminator.
  void end(const char* terminator);

  const std::string name_;
  const std::size_t total_;
  const bool is_terminal_;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;  ///< guards what follows
  Clock::time_point shown_ = start_;
  std::size_t done_ = 0;
  bool is_open_ = false;  ///< the cursor is on the terminal's progress line
};

}  // namespace ground_scale_vo
