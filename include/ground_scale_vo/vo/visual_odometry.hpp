#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/local_bundle_adjustment.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/patch_alignment.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "ground_scale_vo/vo/two_view.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

enum class RejectReason : std::uint8_t {
  kNotFound,  ///< not seen in this image, or tracked back to another place than it came from
  kOutlier    ///< seen where the pose allows neither its point nor its epipolar line to be
};

/// A feature that a frame gives up.
struct RejectedFeature {
  std::uint64_t id = 0;
  Eigen::Vector2f u = Eigen::Vector2f::Zero();  ///< [px] where it was seen last; of an outlier: now
  RejectReason reason = RejectReason::kNotFound;
};

/// Monocular visual odometry up to scale (the paper's MVO thread): images in, VoFrame out.
/// Deterministic: the same images give the same bytes. Not thread safe.
class VisualOdometry {
 public:
  struct Options {
    FeatureTracker::Options tracker;
    TwoView::Options two_view;
    PatchAlignment::Options alignment;
    PoseEstimation::Options pose;
    LocalMap::Options map;
    LocalBundleAdjustment::Options bundle_adjustment;

    double noise = 0.001;
    double noise_flow = 0.028;
    double noise_aligned = 0.00025;
    double keyframe_parallax = 0.035;
    double keyframe_min_tracked = 0.5;
    double standstill_flow = 0.0003;
    double epipolar_error = 0.0028;
    double outlier_error = 0.003;
    int max_outlier_frames = 2;
    double start_min_share = 0.4;
    int lost_frames_before_new_map = 3;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("noise", self.noise, 1e-6, 0.1,
            "[focal lengths] standard deviation of a corner that hardly moves");
      visit("noise_flow", self.noise_flow, 1e-4, 100,
            "[focal lengths] motion between frames, without rotation, that doubles its variance");
      visit("noise_aligned", self.noise_aligned, 1e-6, 0.1,
            "[focal lengths] standard deviation of a corner aligned to its first patch");
      visit("keyframe_parallax", self.keyframe_parallax, 1e-4, 1,
            "[rad] median since the last keyframe that makes the next one");
      visit("keyframe_min_tracked", self.keyframe_min_tracked, 0, 1,
            "[] share of the last keyframe's features; with fewer a new one is made");
      visit("standstill_flow", self.standstill_flow, 0, 0.1,
            "[image width] a median flow below this is none");
      visit("epipolar_error", self.epipolar_error, 1e-5, 1,
            "[focal lengths] of a feature without depth");
      visit("outlier_error", self.outlier_error, 1e-5, 1,
            "[focal lengths] of an observation after adjustment");
      visit("max_outlier_frames", self.max_outlier_frames, 0, 1000,
            "[frames] in a row that a feature may disagree");
      visit("start_min_share", self.start_min_share, 0.01, 1,
            "[] of the first frame's features; with fewer the start begins anew");
      visit("lost_frames_before_new_map", self.lost_frames_before_new_map, 1, 1000,
            "[frames] with texture in a row without a pose");
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

  /// The pose of an earlier frame of the current map, known only since the map was started.
  struct StartPose {
    std::uint32_t sequence = 0;
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  };

  /// [ms] wall time.
  struct Times {
    double pyramid = 0, track = 0, align = 0, detect = 0, pose = 0, triangulate = 0;
    /// On the second thread, in the frame that takes the adjusted map over; not part of total.
    double bundle_adjustment = 0;
    double adjustment_wait = 0;  ///< until that map was there and taken over
    double total = 0;
  };

  struct Output {
    VoFrame frame;
    /// Not empty exactly in the frame that starts a map: the frames from the map's first frame
    /// until now, in order.
    std::vector<StartPose> start;
    /// To be looked at; none is among the frame's features. While the camera stands or is lost, the
    /// image that is tracked from stays, and what was given up may come back.
    std::vector<RejectedFeature> rejected;
    Times times;
  };

  VisualOdometry(const PinholeCamera& camera, const Options& options);
  ~VisualOdometry();

  /// image: 8-bit, one channel, the camera's size, rectified (throws OptionError otherwise).
  /// Precondition: stamps grow.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
