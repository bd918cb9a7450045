#include "ground_scale_vo/metric_odometry.hpp"

#include <limits>

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
    : options_(options.odometry),
      mask_(mask),
      vo_(std::make_unique<SelfCalibratingOdometry>(camera, options_, mask_)),
      scale_(options.scale) {}

void MetricOdometry::changeCamera(const CameraCalibration& camera) {
  vo_ = std::make_unique<SelfCalibratingOdometry>(camera, options_, mask_);
  first_sequence_ = next_sequence_;
  first_map_ = last_map_ + 1;
}

MetricOdometry::Output MetricOdometry::process(const cv::Mat& image, std::int64_t stamp_ns) {
  Output output;
  output.vo = vo_->process(image, stamp_ns);
  VoFrame& frame = output.vo.frame;
  if (first_sequence_ > 0) {
    if (frame.sequence == 0) frame.continuity = Continuity::kNewMap;
    if (frame.map_id == 0) {
      frame.map_start.rotation_sigma = std::numeric_limits<double>::infinity();
    }
    frame.sequence += first_sequence_;
    frame.map_id += first_map_;
  }
  next_sequence_ = frame.sequence + 1;
  last_map_ = frame.map_id;
  output.scale = scale_.process(output.vo.frame, output.vo.image.grey, output.vo.image.mask);
  return output;
}

}  // namespace gsv
