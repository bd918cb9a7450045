#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdio>
#include <string>

#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// The ProgressLine of an offline run: frames, rate, distance travelled, scale and its status.
class RunProgress {
 public:
  RunProgress(const std::string& name, std::size_t frames) : line_(name, frames) {}

  /// Counts the next frame.
  void show(const RunFrame& frame) {
    distance_ += (frame.T_o_c.translation() - position_).norm();
    position_ = frame.T_o_c.translation();
    line_.step([&](double rate) {
      char text[128];
      const int length =
          std::snprintf(text, sizeof text, " frames, %.1f/s, %.1f m, scale ", rate, distance_);
      return std::string(text, static_cast<std::size_t>(length)) + scaleText(frame.scale);
    });
  }

 private:
  static std::string scaleText(const ScaleEstimate& scale) {
    if (scale.status == ScaleStatus::kUnknown) return "not yet known";
    char text[64];
    std::snprintf(text, sizeof text, "%.4g m/unit (%s)", scale.scale, toString(scale.status));
    return text;
  }

  ProgressLine line_;
  double distance_ = 0;  ///< [m]
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

}  // namespace ground_scale_vo
