#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "scale/camera_path.hpp"
#include "scale/direct_plane_estimator.hpp"
#include "scale/drive_smoother.hpp"
#include "scale/ground_points.hpp"
#include "scale/metric_trajectory.hpp"
#include "scale/path_speed.hpp"
#include "scale/plane_fit.hpp"
#include "scale/road.hpp"
#include "scale/scale_filter.hpp"

namespace gsv {

/// The stages of ScaleRecovery, and what it remembers between frames.
struct ScaleRecovery::Impl {
  explicit Impl(const Options& options);

  /// What has the unit of length of one map.
  struct Map {
    CameraPath path;
    /// Latest estimate of the height [VO units], also before the filter has started; 0: none yet.
    double rough_height = 0;
    /// By which the motion is judged: the last one of the filter, also of a map before with the
    /// same unit of length [m per VO unit]; 0: none yet.
    double known_scale = 0;
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< of the latest plane; zero: none yet
  };

  /// One frame from its pose to the metric one.
  Output process(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask);

  void follow(Continuity continuity);
  std::optional<Continuity> continuityOfPose(const VoFrame& frame);
  bool impliesJump(const StampedPose& from, const StampedPose& to) const;

  MeasurementStatus measure(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                            Output* output);
  MeasurementStatus measureFeatureBased(const VoFrame& frame, CameraPath::Pose* current,
                                        Output* output);
  void measureDirect(const VoFrame& frame, const cv::Mat& image, const cv::Mat& mask,
                     Output* output);
  bool updateFilter(Output* output);
  void measureSpeed(Output* output);
  void fillEstimate(ScaleEstimate* scale) const;

  const Options options;
  Mounting mounting;
  DirectPlaneEstimator direct;
  ScaleFilter filter;
  MetricTrajectory trajectory;
  PathSpeed path_speed;
  DriveSmoother smoother;  ///< with options.record

  Map map;
  bool has_started = false;  ///< a frame was processed
  StampedPose last_pose, last_accepted;
  int refused_poses = 0;          ///< since the last accepted one
  bool refused_continue = false;  ///< one of them has a plausible speed from the one before
};

}  // namespace gsv
