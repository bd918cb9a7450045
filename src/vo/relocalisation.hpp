#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "vo/descriptors.hpp"
#include "vo/feature.hpp"
#include "vo/motion_model.hpp"

namespace ground_scale_vo {

/// Finds the pose of an image in the map where tracking has failed. A pose is refused when its
/// motion deviates too much from the one predicted with the last velocity: objects that move along
/// with the camera, together with the distant scene, also fit a pose.
class Relocalisation {
 public:
  struct Result {
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
    double rotation_sigma = 0;      ///< standard deviation of the least certain axis [rad]
    std::vector<Feature> features;  ///< those that agree with the pose, in the image
  };

  /// options: own limits replace min_inliers and min_inlier_share. mask: as for VisualOdometry.
  Relocalisation(const PinholeCamera& camera, const PoseEstimation::Options& options,
                 const cv::Mat& mask);

  // features: of the last tracked image, whose pose the motion model has.

  /// By descriptors: previous: of the features, in the same order; next: of the corners of the
  /// image. Matches are searched around the predicted pose, then in the whole image, and again
  /// around the pose from those with a map point. Empty when too few of them agree.
  std::optional<Result> matchDescriptors(const LocalMap& map, const MotionModel& motion,
                                         const std::vector<Feature>& features,
                                         const Descriptors& previous, const Descriptors& next,
                                         std::int64_t stamp_ns) const;

  /// After an interruption in which the camera has moved and turned too far for descriptors. Poses
  /// on a grid are rated: rotations about the vertical and the horizontal axis since the last pose,
  /// and distances around the one predicted with the last velocity. The score is the sum of the
  /// normalised cross-correlations of up to 200 patches at the projections of their map points, in
  /// standard deviations of that sum at unrelated places. The best pose is refined with the
  /// positions at which the single patches correlate best, coarse to fine. Both images: 8-bit grey;
  /// the exposures may differ. Takes some tenths of a second. Empty when no pose stands out, or too
  /// few patches agree with it.
  std::optional<Result> searchPose(const LocalMap& map, const MotionModel& motion,
                                   const std::vector<Feature>& features, const cv::Mat& previous,
                                   const cv::Mat& image, std::int64_t stamp_ns) const;

 private:
  /// The pose from the matched features. Empty when it fails.
  std::optional<Result> estimate(const PoseEstimation& estimation, const LocalMap& map,
                                 const Eigen::Isometry3d& initial_T_w_c,
                                 const std::vector<Feature>& matches) const;

  const PinholeCamera camera_;
  const cv::Mat mask_;
  const PoseEstimation coarse_estimation_, fine_estimation_, patch_estimation_;
};

}  // namespace ground_scale_vo
