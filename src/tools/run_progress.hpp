#pragma once

#include <unistd.h>

#include <Eigen/Core>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <string>

#include "ground_scale_vo/dataset/offline_run.hpp"

namespace ground_scale_vo {

/// One line about an offline run on a terminal, written again some times a second.
class RunProgress {
 public:
  RunProgress(const std::string& name, std::size_t frames) : name_(name), frames_(frames) {}
  ~RunProgress() {
    if (is_terminal_) std::fputc('\n', stderr);
  }
  RunProgress(const RunProgress&) = delete;
  RunProgress& operator=(const RunProgress&) = delete;

  /// The next frame.
  void show(const RunFrame& frame) {
    metres_ += (frame.T_o_c.translation() - position_).norm();
    position_ = frame.T_o_c.translation();
    ++done_;
    if (!is_terminal_) return;
    const auto now = Clock::now();
    if (now - shown_ < std::chrono::milliseconds(200) && done_ != frames_) return;
    shown_ = now;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::fprintf(stderr, "\r%s: frame %zu/%zu, %.1f frames/s, %.1f m, scale %s \033[K",
                 name_.c_str(), done_, frames_, static_cast<double>(done_) / seconds, metres_,
                 toString(frame.scale.status));
  }

 private:
  using Clock = std::chrono::steady_clock;
  const std::string name_;
  const std::size_t frames_;
  const bool is_terminal_ = isatty(STDERR_FILENO) != 0;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_{};
  std::size_t done_ = 0;
  double metres_ = 0;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

}  // namespace ground_scale_vo
