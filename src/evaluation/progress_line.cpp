#include "ground_scale_vo/evaluation/progress_line.hpp"

#include <unistd.h>

#include <cstdio>
#include <utility>

#include "common/text.hpp"

namespace gsv {
namespace {

// Shortest time between two updates, on a terminal and in a log.
constexpr std::chrono::milliseconds kTerminalPeriod(200);
constexpr std::chrono::seconds kLogPeriod(10);

}  // namespace

ProgressLine::ProgressLine(std::string name, std::size_t total)
    : name_(std::move(name)), total_(total), is_terminal_(isatty(STDERR_FILENO) != 0) {}

void ProgressLine::step(const char* unit, const std::function<std::string()>& details) {
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
  std::fprintf(stderr,
               is_terminal_ ? "\r%s: %zu/%zu %s, %.1f/s%s\033[K" : "%s: %zu/%zu %s, %.1f/s%s\n",
               name_.c_str(), done_, total_, unit, rate, details ? details().c_str() : "");
  if (done_ == total_) end();
}

void ProgressLine::end() {
  if (is_terminal_ && is_open_) std::fputs("\n", stderr);
  is_open_ = false;
}

void RunProgress::show(const RunFrame& frame) {
  distance_ += (frame.T_o_c.translation() - position_).norm();
  position_ = frame.T_o_c.translation();
  line_.step("frames", [&] {
    const ScaleEstimate& scale = frame.scale;
    return format(", %.1f m, scale ", distance_) +
           (scale.status == ScaleStatus::kUnknown
                ? "not yet known"
                : format("%.4g m/unit (%s)", scale.scale, toString(scale.status)));
  });
}

}  // namespace gsv
