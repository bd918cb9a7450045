#include "ground_scale_vo/metric_odometry.hpp"

namespace ground_scale_vo {
namespace {

/// Validates before anything is built from them.
const MetricOdometry::Options& validated(const MetricOdometry::Options& options) {
  options.validate();
  return options;
}

}  // namespace

void MetricOdometry::Options::validate() const {
  vo.validate();
  scale.validate();
}

MetricOdometry::MetricOdometry(const PinholeCamera& camera, const Options& options)
    : vo_(camera, validated(options).vo), scale_(options.scale) {}

MetricOdometry::Output MetricOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  Output output;
  output.vo = vo_.process(image, stamp_ns);
  output.scale = scale_.process(output.vo.frame, image);
  return output;
}

}  // namespace ground_scale_vo
