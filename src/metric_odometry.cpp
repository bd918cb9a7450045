#include "ground_scale_vo/metric_odometry.hpp"

namespace gsv {

void MetricOdometry::Options::validate() const {
  requireInRanges(odometry);
  scale.validate();
}

VoStatus MetricOdometry::Output::status() const {
  if (scale.pose) return VoStatus::kTracking;
  return vo.frame.status == VoStatus::kLost ? VoStatus::kLost : VoStatus::kInitialising;
}

MetricOdometry::MetricOdometry(const CameraCalibration& camera, const Options& options,
                               const cv::Mat& mask)
    : vo_(camera, options.odometry, mask), scale_(options.scale) {}

MetricOdometry::Output MetricOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  Output output;
  output.vo = vo_.process(image, stamp_ns);
  output.scale = scale_.process(output.vo.frame, output.vo.image.grey, output.vo.image.mask);
  return output;
}

}  // namespace gsv
