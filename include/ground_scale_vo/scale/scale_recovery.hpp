#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "ground_scale_vo/scale/metric_trajectory.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// The paper's GPE-GPA thread: VoFrame in, scale and metric pose out.
class ScaleRecovery {
 public:
  struct Options {
    double camera_height = 0;     ///< h* [m] above the road; required, there is no default
    std::uint64_t random_seed = 1;
    /// Throws OptionError.
    void validate() const;
  };

  struct Times {
    double delaunay = 0, gpe = 0, gpa = 0, filter = 0, total = 0;  ///< [ms] wall time
  };

  struct Output {
    ScaleEstimate scale;
    /// Metric pose; empty before the first scale is known and while the odometry has no pose.
    std::optional<MetricPose> pose;
    /// Ground points of the window in the camera frame of this frame, VO units.
    std::vector<Eigen::Vector3f> ground_points_c;
    /// Ids of this frame's features that were extracted as ground points.
    std::vector<std::uint64_t> ground_feature_ids;
    Times times;
  };

  explicit ScaleRecovery(const Options& options);
  ~ScaleRecovery();

  Output process(const VoFrame& frame);

  /// As newly constructed.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
