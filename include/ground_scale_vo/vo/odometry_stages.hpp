#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/local_bundle_adjustment.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/patch_alignment.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "ground_scale_vo/vo/two_view.hpp"

// What the stages of VisualOdometry share: their parameters, and what they report.

namespace ground_scale_vo {

struct OdometryOptions {
  FeatureTracker::Options tracker;
  TwoView::Options two_view;
  PatchAlignment::Options alignment;
  PoseEstimation::Options pose;
  LocalMap::Options map;
  LocalBundleAdjustment::Options bundle_adjustment;

  double feature_sigma = 0.001;
  double feature_sigma_flow = 0.028;
  double keyframe_parallax = 0.035;
  double keyframe_min_tracked = 0.6;
  double standstill_flow = 0.0003;
  double max_reprojection_error = 0.003;
  int max_outlier_frames = 2;
  int lost_frames_before_new_map = 3;
  double readout_time = 0;
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("feature_sigma", self.feature_sigma, 1e-6, 0.1,
          "[focal lengths] standard deviation of a tracked corner without flow");
    visit(
        "feature_sigma_flow", self.feature_sigma_flow, 1e-4, 100,
        "[focal lengths] rotation-compensated flow that doubles the variance feature_sigma^2 of a "
        "tracked corner");
    visit("keyframe_parallax", self.keyframe_parallax, 1e-4, 1,
          "[rad] median parallax to the last keyframe above which a new one is made");
    visit("keyframe_min_tracked", self.keyframe_min_tracked, 0, 1,
          "[] share of the last keyframe's features below which a new one is made");
    visit("standstill_flow", self.standstill_flow, 0, 0.1,
          "[image width] median flow below which the camera stands still");
    visit("max_reprojection_error", self.max_reprojection_error, 1e-5, 1,
          "[focal lengths] of an observation after bundle adjustment; larger ones are removed");
    visit("max_outlier_frames", self.max_outlier_frames, 0, 1000,
          "[frames] consecutive outlier frames that a feature may have");
    visit("lost_frames_before_new_map", self.lost_frames_before_new_map, 1, 1000,
          "[frames] consecutive textured frames without a pose after which a new map starts");
    visit("readout_time", self.readout_time, 0, 0.2,
          "[s] of a rolling shutter, from the exposure of the first row to that of the last one; "
          "stamps are those of the middle row; 0: global shutter");
  }
  template <typename Self, typename Visit>
  static void visitStages(Self& self, Visit&& visit) {
    visit("tracker/", self.tracker);
    visit("two_view/", self.two_view);
    visit("alignment/", self.alignment);
    visit("pose/", self.pose);
    visit("map/", self.map);
    visit("bundle_adjustment/", self.bundle_adjustment);
    visit("odometry/", self);
  }
  /// Throws OptionError.
  void validate() const;
};

enum class RejectReason : std::uint8_t {
  kNotFound,  ///< not found in this image, at the mask, or failed the forward-backward check
  kOutlier    ///< off the projection of its map point; without a map point: off its epipolar line
};

/// A feature that was not found in this frame, or was removed from it as an outlier.
struct RejectedFeature {
  std::uint64_t id = 0;
  Eigen::Vector2f u = Eigen::Vector2f::Zero();  ///< [px] last position; an outlier's in this frame
  RejectReason reason = RejectReason::kNotFound;
};

/// The pose of one of the frames from which a map was started.
struct StartPose {
  std::uint32_t sequence = 0;
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
};

/// [ms] wall time.
struct StageTimes {
  double pyramid = 0, track = 0, align = 0, detect = 0, pose = 0, triangulate = 0;
  /// On the second thread, reported in the frame that uses the adjusted map; not part of total.
  double bundle_adjustment = 0;
  double adjustment_wait = 0;  ///< for the second thread, and to copy its result into the map
  double total = 0;
};

}  // namespace ground_scale_vo
