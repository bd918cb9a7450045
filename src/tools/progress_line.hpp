#pragma once

#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>

namespace ground_scale_vo {

/// How far a command is, on stderr: on a terminal one line, written again some times a second;
/// elsewhere, in a log, a line of its own every ten seconds. Not thread-safe.
class ProgressLine {
 public:
  ProgressLine(std::string name, std::size_t total) : name_(std::move(name)), total_(total) {}
  ~ProgressLine() { end(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// So many of the total are done; the line ends with the last one. details(rate), the rest of the
  /// line, is called when it is written; rate: how many were done a second.
  using Details = std::function<std::string(double rate)>;
  void show(std::size_t done, const Details& details) {
    const auto now = Clock::now();
    if (is_terminal_) {
      if (is_open_ && now - shown_ < std::chrono::milliseconds(200) && done != total_) return;
    } else if (now - shown_ < std::chrono::seconds(10)) {
      return;
    }
    shown_ = now;
    is_open_ = true;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    const double rate = seconds > 0 ? static_cast<double>(done) / seconds : 0;
    std::fprintf(stderr, is_terminal_ ? "\r%s: %zu/%zu%s\033[K" : "%s: %zu/%zu%s\n", name_.c_str(),
                 done, total_, details(rate).c_str());
    if (done == total_) end();
  }
  /// The same with ", RATE UNIT/s".
  void show(std::size_t done, const char* unit) {
    show(done, [unit](double rate) {
      char text[64];
      std::snprintf(text, sizeof text, " %s, %.1f/s", unit, rate);
      return std::string(text);
    });
  }

 private:
  using Clock = std::chrono::steady_clock;

  void end() {
    if (is_terminal_ && is_open_) std::fputc('\n', stderr);
    is_open_ = false;
  }

  const std::string name_;
  const std::size_t total_;
  const bool is_terminal_ = isatty(STDERR_FILENO) != 0;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_ = start_;
  bool is_open_ = false;  ///< on a terminal: the next line must begin below
};

}  // namespace ground_scale_vo
