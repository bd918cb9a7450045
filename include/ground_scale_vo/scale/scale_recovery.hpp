#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/direct_plane_estimator.hpp"
#include "ground_scale_vo/scale/ground_point_aggregation.hpp"
#include "ground_scale_vo/scale/ground_point_extraction.hpp"
#include "ground_scale_vo/scale/metric_trajectory.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"
#include "ground_scale_vo/scale/mounting.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_filter.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// The paper's GPE-GPA thread, and beyond it the road's pixels: VoFrame and its image in, scale and
/// metric pose out.
///
/// Points and pixels measure the height each by itself; one filter takes both. Points work in the
/// first frames and where the road has no texture, pixels where it has no corners.
class ScaleRecovery {
 public:
  struct Options {
    double camera_height = 0;       ///< h* [m] above the road; required, there is no default
    std::uint64_t random_seed = 1;  ///< of everything random (goes before gpe.random_seed)
    /// The paper's choices as printed, where they can run at all: overrides the stages' options
    /// with those of withPaperLiteral(). For comparison only.
    bool paper_literal = false;
    /// The images are used; without them, or with false, points work alone.
    bool refine = true;
    /// A step below this is standstill: no measurement, and the window stays [camera heights].
    double min_step_h = 0.02;

    MotionHistory::Options motion;
    Mounting::Options mounting;
    GroundPointExtraction::Options gpe;
    GroundPointAggregation::Options gpa;
    DirectPlaneEstimator::Options refinement;
    ScaleFilter::Options filter;
    MetricTrajectory::Options trajectory;

    /// Without camera_height, which has no default.
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("random_seed", self.random_seed, 0, 2147483647, "[] seed of all random draws");
      visit("min_step_h", self.min_step_h, 0, 1, "[camera heights] a shorter step is standstill");
      visit("refine", self.refine, "[] align the road's pixels; false: points alone");
      visit("paper_literal", self.paper_literal,
            "[] the paper's choices as printed, for comparison; overrides the stages' options");
    }
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      visit("", self);
      visit("motion/", self.motion);
      visit("mounting/", self.mounting);
      visit("gpe/", self.gpe);
      visit("gpa/", self.gpa);
      visit("fit/", self.gpa.fit);
      visit("refinement/", self.refinement);
      visit("filter/", self.filter);
      visit("trajectory/", self.trajectory);
    }
    /// A copy in which the stages' options are the paper's: t of one frame, theta_1 on the frame's
    /// rotation, 5 degrees, most inliers within 0.01 m (over the height), a window of four frames
    /// with all copies, unweighted homogeneous least squares, a moving average of the scale,
    /// standstill not noticed, images not used. Precondition: camera_height > 0.
    Options withPaperLiteral() const;
    /// Throws OptionError.
    void validate() const;
  };

  struct Times {
    double delaunay = 0, gpe = 0, gpa = 0, refine = 0, filter = 0, total = 0;  ///< [ms] wall time
  };

  /// What one source says of the height in one frame [VO units].
  struct Measurement {
    double height = 0;  ///< 0: nothing
    double sigma = 0;
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
    Measurement points, pixels;
    double correlation = 0;     ///< of the pixels' alignment, 0 when there was none
    GroundPlane plane;          ///< of this frame alone; height 0 when there is none
    double mounting_pitch = 0;  ///< [rad], positive looks down
    double mounting_roll = 0;   ///< [rad], positive: the camera's x axis dips
  };

  explicit ScaleRecovery(const Options& options);
  ~ScaleRecovery();

  /// image: the picture of this frame, rectified, 8-bit grey, of the size of frame.camera (throws
  /// OptionError otherwise), or empty. A frame whose pose is not finite counts as not tracking, a
  /// point that is not as none; a scale that is not finite or beyond reason is unknown.
  Output process(const VoFrame& frame, const cv::Mat& image = {});

  /// As newly constructed.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
