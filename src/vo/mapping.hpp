#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <future>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/vo/vo_options.hpp"
#include "vo/bundle_adjustment.hpp"
#include "vo/feature.hpp"
#include "vo/map.hpp"

namespace gsv {

/// [rad] A new keyframe is made above this median parallax to the last one, or when less than this
/// share of its features is still tracked.
constexpr double kKeyframeParallax = 0.035, kKeyframeMinTracked = 0.6;

/// The local map: keyframe selection, triangulation, and bundle adjustment on a second thread.
class Mapping {
 public:
  Mapping(const PinholeCamera& camera, const OdometryOptions& options)
      : readout_time_(options.readout_time),
        camera_(camera),
        bundle_adjustment_(options.adjusted_keyframes) {}

  LocalMap& map() { return map_; }
  const LocalMap& map() const { return map_; }

  /// True if the parallax to the last keyframe is large, or few of its features are still tracked.
  bool needsKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Feature>& found) const;

  /// Adds a keyframe, triangulates, and starts the bundle adjustment on the second thread, which
  /// works on a copy. It replaces the newest keyframe if that one was taken at the same place as
  /// the one before it: at a standstill, images with few features in common would otherwise
  /// displace all keyframes with a baseline, and the map would lose its scale. readout_motion: see
  /// VoFrame.
  void addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Feature>& features,
                   const ImagePyramid& image, const Vector6d& readout_motion = Vector6d::Zero());

  /// Waits for the bundle adjustment that addKeyframe started, if any, and applies its result.
  /// Called at the same step of each frame, so the result does not depend on the machine's speed.
  /// Returns the correction C = T_new T_old^-1 of the newest keyframe's pose: a pose T_w_c in the
  /// old map becomes C * T_w_c. Empty if no adjustment was started. duration_ms: of the adjustment.
  std::optional<Eigen::Isometry3d> applyAdjustment(double* duration_ms);

  /// Runs bundle adjustment on the calling thread. Returns false if its result is not usable.
  bool adjustNow();

 private:
  std::pair<std::size_t, double> parallaxToLast(const Eigen::Isometry3d& T_w_c,
                                                const std::vector<Feature>& found) const;
  void storeAdjusted();

  const double readout_time_;
  const PinholeCamera camera_;

  LocalMap map_;
  BundleAdjustment bundle_adjustment_;
  std::future<double> adjusting_;  ///< its duration [ms]. Last: the destructor waits
};

}  // namespace gsv
