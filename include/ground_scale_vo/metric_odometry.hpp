#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace ground_scale_vo {

/// The whole pipeline without ROS: rectified images in, metric poses out. The same two stages as
/// the nodelets run, one after the other for every image. Causal and deterministic: the same
/// images give the same bytes. Not thread safe.
class MetricOdometry {
 public:
  struct Options {
    VisualOdometry::Options vo;
    ScaleRecovery::Options scale;  ///< scale.camera_height [m] is required
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      VisualOdometry::Options::visitStages(self.vo, visit);
      ScaleRecovery::Options::visitStages(self.scale, visit);
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Output {
    VisualOdometry::Output vo;  ///< features and the pose up to scale
    ScaleRecovery::Output
        scale;  ///< scale, ground plane and, once the scale is known, the pose [m]
  };

  /// camera: of the rectified images. Throws OptionError.
  MetricOdometry(const PinholeCamera& camera, const Options& options);

  /// image: 8-bit, one channel, the camera's size, rectified (throws OptionError otherwise).
  /// Precondition: stamps grow.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

 private:
  VisualOdometry vo_;
  ScaleRecovery scale_;
};

}  // namespace ground_scale_vo
