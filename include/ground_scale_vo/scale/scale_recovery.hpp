#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/scale/metric_pose.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/scale/speed.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace gsv {

/// The paper's GPE-GPA thread, extended by direct measurements: takes the VO's frames and images,
/// returns the scale s = h*/h and the metric pose.
///
/// Two measurements of the camera height h enter one filter: feature-based (GPE and
/// GPA: a plane through tracked points) and direct (a plane that aligns the image intensities of
/// the road). Feature-based measurements start with the first frames and need only some corners,
/// such as the corners of road markings; direct ones need texture but no corners.
///
/// Deterministic: the same frames give the same bytes. Not thread safe.
class ScaleRecovery {
 public:
  using Options = ScaleRecoveryOptions;

  /// [ms] wall time of the stages.
  struct Times {
    double delaunay = 0, gpe = 0, gpa = 0, direct = 0, filter = 0, total = 0;
  };

  struct Output {
    ScaleEstimate scale;
    /// Metric pose; empty while the scale of the map is not known, while the odometry has no pose,
    /// and when its pose is not used (kImplausibleMotion).
    std::optional<MetricPose> pose;
    /// Ground points of the GPA window in this frame's camera [VO units].
    std::vector<Eigen::Vector3f> ground_points_c;
    /// Ids of this frame's features that GPE classified as ground.
    std::vector<std::uint64_t> ground_feature_ids;
    /// Why the speeds cannot be used, such as another unit, one sentence; empty: they can. Without
    /// a given camera height the scale is then unknown.
    std::string speed_error;
    std::string speed_warning;  ///< what is wrong with the speeds, one sentence; empty: nothing
    Times times;
    PlaneMeasurement feature_based, direct;  ///< height 0: no measurement
    /// Measured at this frame, unfiltered; height 0 when there is none. Of two measurements, the
    /// direct one, unless the filter accepts only the feature-based one.
    GroundPlane plane;
    double mounting_pitch = 0;  ///< [rad], positive: the camera looks down
    double mounting_roll = 0;   ///< [rad], positive: the camera's x axis points down
    double mounting_sigma = 0;  ///< Mounting::sigma() [rad]
  };

  /// Throws OptionError.
  explicit ScaleRecovery(const Options& options);
  ~ScaleRecovery();

  /// frame: in temporal order. image: the frame's rectified image, 8-bit grey, of the size of
  /// frame.camera (throws OptionError otherwise), or empty: no direct measurement. A frame whose
  /// pose is not finite counts as not tracking; a pose that implies an implausible speed is not
  /// used, but the fourth in a row starts a new map; points that are not finite are ignored. On
  /// failure output.scale.status and measurement say what is missing; values are never NaN or
  /// infinite.
  ///
  /// mask: 8-bit, one channel, the image's size (throws OptionError otherwise); 0 where the
  /// camera's images never show the scene. The direct measurement does not use these regions; the
  /// features of `frame` are used wherever they are. Empty: no such region. Pass the same cv::Mat
  /// for all frames: with another one the direct measurement starts anew, as with another camera.
  Output process(const VoFrame& frame, const cv::Mat& image = {}, const cv::Mat& mask = {});

  /// A speed of the vehicle, in the order of the stamps, before or after the frames of its time.
  /// One that is not finite or not in order is ignored.
  void addSpeed(const SpeedSample& speed);

  /// What a frame gets when all measurements are known.
  struct Smoothed {
    ScaleEstimate scale;
    std::optional<MetricPose> pose;
  };
  /// Of all frames since the last new trajectory, in their order: with each scale from all
  /// measurements of its map, also later ones (a Rauch-Tung-Striebel smoother), so that also the
  /// first metres of a map have one. Empty without Options::record. Throws OptionError:
  /// Options::requireSmoothable().
  std::vector<Smoothed> smoothed() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gsv
