#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/vo_frame.hpp"
#include "ground_scale_vo/vo/vo_options.hpp"

namespace gsv {

/// A feature that was not found in this frame, or was removed from it as an outlier.
struct RejectedFeature {
  std::uint64_t id = 0;
  Eigen::Vector2f u = Eigen::Vector2f::Zero();  ///< [px] last position; an outlier's in this frame
  /// Off the projection of its map point; without a map point: off its epipolar line. Otherwise not
  /// found in this image, at the mask, or tracked back to another place.
  bool is_outlier = false;
};

/// [ms] wall time.
struct StageTimes {
  double pyramid = 0, track = 0, align = 0, detect = 0, pose = 0;
  double triangulate = 0;  ///< with all that a new keyframe needs
  /// On the second thread, reported in the frame that uses the adjusted map; not part of total.
  double bundle_adjustment = 0;
  double adjustment_wait = 0;  ///< for the second thread, and to copy its result into the map
  double total = 0;
};

/// Monocular visual odometry up to scale (the paper's MVO thread): images in, VoFrame out.
/// Deterministic: the same images give the same bytes. Not thread safe.
class VisualOdometry {
 public:
  using Options = OdometryOptions;
  using Times = StageTimes;

  struct Output {
    VoFrame frame;
    /// Poses of the frames from the map's first to this one, in order, without those that had too
    /// little texture (see sequence); empty unless this frame starts a map.
    std::vector<StampedPose> start;
    /// For visualisation; not among the frame's features. While the camera stands still or is lost,
    /// the previous image is kept, and a rejected feature may be found again later.
    std::vector<RejectedFeature> rejected;
    Times times;
  };

  /// mask: 8-bit, one channel, the camera's size; 0 where the images never show the scene (own
  /// vehicle, watermark): no feature is detected or tracked there. Its pixels still influence the
  /// coarser levels of tracking and the detection of exposure steps. Empty: no such region. Throws
  /// OptionError.
  VisualOdometry(const PinholeCamera& camera, const Options& options, const cv::Mat& mask = {});
  ~VisualOdometry();

  /// image: 8-bit, one channel, the camera's size, rectified (throws OptionError otherwise).
  /// Precondition: stamps increase.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gsv
