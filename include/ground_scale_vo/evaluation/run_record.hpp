#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace ground_scale_vo {

/// What is known of one input frame when the run is over.
struct RunFrame {
  std::int64_t stamp_ns = 0;
  VoStatus vo_status = VoStatus::kInitialising;  ///< as it was said at this frame
  std::uint32_t map_id = 0;
  bool has_vo_pose = false;  ///< tracked, or posed later when its map was started
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units, with has_vo_pose
  Eigen::Isometry3d T_o_c = Eigen::Isometry3d::Identity();  ///< [m]
  bool has_metric_pose = false;  ///< T_o_c was given at this frame; else it is held or filled
  bool backfilled = false;       ///< T_o_c was filled in when the first scale was known
  ScaleEstimate scale;           ///< as it was said at this frame
  double decode_ms = 0;          ///< wall time of reading and decoding the image
  VisualOdometry::Times vo_times;
  ScaleRecovery::Times scale_times;
};

/// Gives every input frame a pose, from what the two stages say of each frame in order.
///
/// Metric: the poses that the scale stage gives. Where it gives none, the last pose is held. The
/// one exception from causality is the start: with the first metric pose, the earlier frames of its
/// map get their way from the map's first frame times that frame's scale, which leads to the first
/// metric pose without a step; frames in between without an odometry pose hold the one before them,
/// and frames before the map stand at the origin.
class RunRecord {
 public:
  /// Precondition: vo.frame.sequence counts the calls from 0. Throws std::logic_error otherwise.
  void append(const VisualOdometry::Output& vo, const ScaleRecovery::Output& scale,
              double decode_ms = 0);

  const std::vector<RunFrame>& frames() const { return frames_; }

  std::size_t trackedFrames() const;  ///< those with has_vo_pose
  std::size_t lostEvents() const;     ///< times that a frame is not tracked and the one before was
  std::vector<Eigen::Isometry3d> metricPoses() const;
  /// VO units of each map, which are not the same: a later map goes on, without a step, from the
  /// last pose of the map before it. The last pose is held where there is none.
  std::vector<Eigen::Isometry3d> unscaledPoses() const;

 private:
  void fillBackwards(double scale);

  std::vector<RunFrame> frames_;
  bool has_metric_pose_ = false;
};

}  // namespace ground_scale_vo
