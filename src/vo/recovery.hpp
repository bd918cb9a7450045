#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "vo/descriptors.hpp"
#include "vo/feature.hpp"
#include "vo/map.hpp"
#include "vo/motion.hpp"
#include "vo/two_view.hpp"

namespace gsv {

/// The pose of an image that does not continue the motion before it.
struct RelocalisedPose {
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  double rotation_sigma = 0;      ///< standard deviation of the least certain axis [rad]
  std::vector<Feature> features;  ///< those that agree with the pose, in the image
};

/// Finds the pose of an image in the map where tracking has failed: by descriptor matches of the
/// features, around the predicted pose, then in the whole image. features: of the last tracked
/// image; previous: their descriptors, in the same order; next: of the corners of the image. Empty
/// when too few matches agree, or when the motion deviates too much from the prediction: objects
/// that move along with the camera, together with the distant scene, also fit a pose.
std::optional<RelocalisedPose> locateByDescriptors(const PinholeCamera& camera, const LocalMap& map,
                                                   const MotionModel& motion,
                                                   const std::vector<Feature>& features,
                                                   const Descriptors& previous,
                                                   const Descriptors& next, std::int64_t stamp_ns);

/// The same where the camera has moved and turned too far for descriptors: rates the poses of a
/// grid by the correlations of all patches at their projections, and refines the best one. Takes
/// some tenths of a second. features: of the last tracked image `previous`. mask: as for
/// VisualOdometry. Empty when no pose stands out, when too few patches agree with it, or when the
/// distance deviates too much from that at the last velocity.
std::optional<RelocalisedPose> locateBySearch(const PinholeCamera& camera, const cv::Mat& mask,
                                              const LocalMap& map, const MotionModel& motion,
                                              const std::vector<Feature>& features,
                                              const cv::Mat& previous, const cv::Mat& image,
                                              std::int64_t stamp_ns);

/// Of both: the pose from features at the pixels of the image where they were found. Empty when
/// fewer than these numbers agree.
std::optional<RelocalisedPose> poseOfMatches(const PinholeCamera& camera, const LocalMap& map,
                                             const Eigen::Isometry3d& initial_T_w_c,
                                             const std::vector<Feature>& matches, int min_inliers,
                                             double min_inlier_share);

/// [VO units] largest plausible deviation of a motion from the predicted one, of the given
/// distance: a share of it, and for a camera that starts to move a share of the median depth of the
/// features in the previous camera.
double maxDeviation(double predicted_distance, const LocalMap& map,
                    const std::vector<Feature>& features, const Eigen::Isometry3d& T_w_previous);

/// Images with texture but without a pose, since the last frame with a pose.
class Interruption {
 public:
  explicit Interruption(const PinholeCamera& camera) : camera_(camera) {}

  /// rotation: from the last frame with a pose to this image. corners: of this image.
  void addImage(const RelativeRotation& rotation, Descriptors corners);
  void end();

  int images() const { return images_; }
  /// To the last of them, from the last frame with a pose.
  const RelativeRotation& rotation() const { return rotation_; }

  /// Rotation between two images by their descriptors; unknown when too few of them match.
  RelativeRotation rotationBetween(const Descriptors& a, const Descriptors& b) const;

 private:
  const PinholeCamera camera_;
  int images_ = 0;
  std::optional<Descriptors> last_;
  RelativeRotation rotation_;
};

}  // namespace gsv
