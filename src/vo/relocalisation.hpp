#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "vo/descriptor_matching.hpp"
#include "vo/feature.hpp"
#include "vo/motion_model.hpp"

namespace ground_scale_vo {

/// Finds the pose of an image in the map where tracking has failed: descriptor matches of the
/// features, the pose from those with a map point, and a second search around it.
class Relocalisation {
 public:
  struct Result {
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
    std::vector<Feature> features;  ///< those whose matches agree with the pose, in the image
  };

  Relocalisation(const PinholeCamera& camera, const PoseEstimation::Options& options);

  /// features: of the last tracked image; previous: their descriptors, in the same order. next:
  /// descriptors of the corners of the image. Matches are searched around the pose that the motion
  /// model predicts, then in the whole image. Empty when too few of them agree, or when the motion
  /// deviates too much from the prediction: objects that move along with the camera, together with
  /// the distant scene, also fit a pose.
  std::optional<Result> locate(const LocalMap& map, const MotionModel& motion,
                               const std::vector<Feature>& features, const Descriptors& previous,
                               const Descriptors& next, std::int64_t stamp_ns) const;

 private:
  const PinholeCamera camera_;
  const PoseEstimation coarse_pose_estimation_;
  const PoseEstimation fine_pose_estimation_;
};

}  // namespace ground_scale_vo
