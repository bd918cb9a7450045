#pragma once

#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

namespace ground_scale_vo {

/// How far a command is, on stderr: on a terminal one line, written again some times a second;
/// elsewhere, in a log, a line of its own every ten seconds. Thread-safe.
class ProgressLine {
 public:
  ProgressLine(std::string name, std::size_t total) : name_(std::move(name)), total_(total) {}
  ~ProgressLine() { end("\n"); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// One more of the total is done; the line ends with the last one. details(rate), the rest of the
  /// line, is called when it is written; rate: how many were done a second.
  using Details = std::function<std::string(double rate)>;
  void step(const Details& details) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto now = Clock::now();
    ++done_;
    if (is_terminal_) {
      if (is_open_ && now - shown_ < std::chrono::milliseconds(200) && done_ != total_) return;
    } else if (now - shown_ < std::chrono::seconds(10)) {
      return;
    }
    shown_ = now;
    is_open_ = true;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    const double rate = seconds > 0 ? static_cast<double>(done_) / seconds : 0;
    std::fprintf(stderr, is_terminal_ ? "\r%s: %zu/%zu%s\033[K" : "%s: %zu/%zu%s\n", name_.c_str(),
                 done_, total_, details(rate).c_str());
    if (done_ == total_) end("\n");
  }
  /// The same with ", RATE UNIT/s".
  void step(const char* unit) {
    step([unit](double rate) {
      char text[64];
      std::snprintf(text, sizeof text, " %s, %.1f/s", unit, rate);
      return std::string(text);
    });
  }
  /// print() writes a part of the result, whole lines, to stdout: in place of the line, which comes
  /// again below it.
  void pause(const std::function<void()>& print) {
    const std::lock_guard<std::mutex> lock(mutex_);
    end("\r\033[K");
    print();
    std::fflush(stdout);
  }

 private:
  using Clock = std::chrono::steady_clock;

  void end(const char* how) {
    if (is_terminal_ && is_open_) std::fputs(how, stderr);
    is_open_ = false;
  }

  const std::string name_;
  const std::size_t total_;
  const bool is_terminal_ = isatty(STDERR_FILENO) != 0;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;  ///< guards what follows
  Clock::time_point shown_ = start_;
  std::size_t done_ = 0;
  bool is_open_ = false;  ///< on a terminal: the next line must begin below
};

}  // namespace ground_scale_vo
