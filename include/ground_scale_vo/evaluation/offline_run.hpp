#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/metric_odometry.hpp"

namespace ground_scale_vo {

/// Runs MetricOdometry on a sequence and stores the result of every frame.
class OfflineRun {
 public:
  using Options = MetricOdometry::Options;

  /// The arguments of MetricOdometry. Throws OptionError.
  OfflineRun(const PinholeCamera& camera, const Options& options, const cv::Mat& mask = {})
      : OfflineRun(Lens{camera}, options, mask) {}
  OfflineRun(const Lens& lens, const Options& options, const cv::Mat& mask = {})
      : odometry_(lens, options, mask) {}

  /// image and stamp as for MetricOdometry::process(); decode_ms: image decoding time, stored
  /// in the record. Throws OptionError. Returns the record of this frame; valid until the next
  /// call.
  const RunFrame& process(const cv::Mat& image, std::int64_t stamp_ns, double decode_ms = 0) {
    last_ = odometry_.process(image, stamp_ns);
    record_.append(last_.vo, last_.scale, decode_ms);
    return record_.frames().back();
  }

  const LensEstimate& lens() const { return odometry_.lens(); }
  const RunRecord& record() const { return record_; }
  /// The output of the last frame.
  const MetricOdometry::Output& last() const { return last_; }

 private:
  MetricOdometry odometry_;
  RunRecord record_;
  MetricOdometry::Output last_;
};

}  // namespace ground_scale_vo
