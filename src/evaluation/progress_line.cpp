#include "ground_scale_vo/evaluation/progress_line.hpp"

#include <unistd.h>

#include <cstdio>
#include <utility>

namespace ground_scale_vo {
namespace {

// Shortest time between two updates, on a terminal and in a log.
constexpr std::chrono::milliseconds kTerminalPeriod(200);
constexpr std::chrono::seconds kLogPeriod(10);

}  // namespace

ProgressLine::ProgressLine(std::string name, std::size_t total)
    : name_(std::move(name)), total_(total), is_terminal_(isatty(STDERR_FILENO) != 0) {}

void ProgressLine::step(const Details& details) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto now = Clock::now();
  ++done_;
  if (is_terminal_) {
    if (is_open_ && now - shown_ < kTerminalPeriod && done_ != total_) return;
  } else if (now - shown_ < kLogPeriod) {
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

void ProgressLine::step(const char* unit) {
  step([unit](double rate) {
    char text[64];
    std::snprintf(text, sizeof text, " %s, %.1f/s", unit, rate);
    return std::string(text);
  });
}

void ProgressLine::pause(const std::function<void()>& print) {
  const std::lock_guard<std::mutex> lock(mutex_);
  end("\r\033[K");
  print();
  std::fflush(stdout);
}

void ProgressLine::end(const char* terminator) {
  if (is_terminal_ && is_open_) std::fputs(terminator, stderr);
  is_open_ = false;
}

}  // namespace ground_scale_vo
