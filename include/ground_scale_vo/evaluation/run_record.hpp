#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/metric_odometry.hpp"

namespace gsv {

/// The results of one input frame at the end of a run.
struct RunFrame {
  std::int64_t stamp_ns = 0;
  VoStatus vo_status = VoStatus::kInitialising;  ///< as reported at this frame
  std::uint32_t map_id = 0;
  bool has_vo_pose = false;  ///< tracked, or posed later when its map was initialised
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units, with has_vo_pose
  Eigen::Isometry3d T_o_c = Eigen::Isometry3d::Identity();  ///< [m]
  Matrix6d covariance = Matrix6d::Zero();  ///< of T_o_c, MetricPose; with has_metric_pose
  double distance_sigma = 0;               ///< MetricPose; with has_metric_pose
  bool has_metric_pose = false;  ///< T_o_c was computed at this frame; else held or backfilled
  bool backfilled = false;       ///< T_o_c was computed later, with the first scale
  ScaleEstimate scale;           ///< as reported at this frame
  std::string speed_error, speed_warning;  ///< ScaleRecovery::Output
  double decode_ms = 0;                    ///< wall time of reading and decoding the image
  VisualOdometry::Times vo_times;
  ScaleRecovery::Times scale_times;
};

/// Assigns every input frame a pose, from the outputs of the two stages in order.
///
/// Metric poses are those of the scale stage. Where it returns none, the last pose is held. The
/// only exception from causality is the start: with the first metric pose, the earlier frames of
/// its map get their odometry poses times the first scale, which leads to the first metric pose
/// without a jump; frames in between without an odometry pose hold the previous one, and frames
/// before the map stay at the origin.
class RunRecord {
 public:
  /// Precondition: vo.frame.sequence counts the calls from 0. Throws std::logic_error otherwise.
  void append(const VisualOdometry::Output& vo, const ScaleRecovery::Output& scale,
              double decode_ms = 0);
  /// An image that the odometry does not get: its frame holds the last pose.
  void appendUnused(std::int64_t stamp_ns);

  /// Replaces scales and metric poses by those of MetricOdometry::smoothed().
  void smooth(const std::vector<ScaleRecovery::Smoothed>& smoothed);

  const std::vector<RunFrame>& frames() const { return frames_; }

  std::size_t trackedFrames() const;                ///< those with has_vo_pose
  bool isSmoothed() const { return is_smoothed_; }  ///< smooth() was called
  bool usedSpeeds() const;                          ///< for any frame's scale
  std::size_t lostEvents() const;  ///< changes of vo_status from kTracking to another
  std::vector<Eigen::Isometry3d> metricPoses() const;
  /// Standard deviation of the length of metricPoses() [m], of the last metric pose. NaN without a
  /// metric pose.
  double lengthSigma() const;
  /// In the VO units of each map, which differ: a later map continues from the last pose of the
  /// previous one without a jump. The last pose is held where there is none.
  std::vector<Eigen::Isometry3d> unscaledPoses() const;

 private:
  void setMetric(std::size_t index, const ScaleEstimate& scale,
                 const std::optional<MetricPose>& pose);
  void holdMetric(std::size_t index);
  void fillBackwards(std::size_t index);

  std::vector<RunFrame> frames_;
  std::vector<std::size_t> frame_of_;  ///< of each frame number of the odometry
  bool has_metric_pose_ = false;
  bool is_smoothed_ = false;
};

/// MetricOdometry and the record of its run.
class OfflineRun {
 public:
  using Options = MetricOdometry::Options;

  /// The arguments of MetricOdometry. Throws OptionError.
  template <typename Camera>
  OfflineRun(const Camera& camera, const Options& options, const cv::Mat& mask = {})
      : odometry_(camera, options, mask) {}

  /// image and stamp as for MetricOdometry::process(); decode_ms: for the record. Throws
  /// OptionError. Returns the record of this image; valid until the next call.
  const RunFrame& process(const cv::Mat& image, std::int64_t stamp_ns, double decode_ms = 0) {
    for (; !speeds_.empty() && speeds_.front().stamp_ns <= stamp_ns; speeds_.pop_front()) {
      odometry_.addSpeed(speeds_.front());
    }
    last_ = odometry_.process(image, stamp_ns);
    record_.append(last_.vo, last_.scale, decode_ms);
    return record_.frames().back();
  }
  /// Speeds in the order of their stamps; the odometry knows each from its stamp on.
  void setSpeeds(const std::vector<SpeedSample>& speeds) {
    speeds_.assign(speeds.begin(), speeds.end());
  }
  /// MetricOdometry::changeCamera().
  void changeCamera(const CameraCalibration& camera) { odometry_.changeCamera(camera); }
  void appendUnused(std::int64_t stamp_ns) { record_.appendUnused(stamp_ns); }
  /// The record gets the smoothed poses; needs Options::scale.record.
  void smooth() { record_.smooth(odometry_.smoothed()); }

  const LensEstimate& lens() const { return odometry_.lens(); }
  std::string finalLensContradiction() { return odometry_.finalLensContradiction(); }
  const RunRecord& record() const { return record_; }
  const MetricOdometry::Output& last() const { return last_; }

 private:
  MetricOdometry odometry_;
  std::deque<SpeedSample> speeds_;  ///< that the odometry does not know yet
  RunRecord record_;
  MetricOdometry::Output last_;
};

}  // namespace gsv
