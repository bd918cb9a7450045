#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "vo/feature.hpp"

namespace gsv {

/// Older keyframes than this number are dropped. Some are older than those that are adjusted.
constexpr std::size_t kMaxKeyframes = 14;
/// [normalised image coordinates] largest error of an observation after bundle adjustment: 2 px at
/// a focal length of 718.
constexpr double kMaxAdjustedError = 0.003;
/// Minimum depth in the observer relative to the depth in the anchor; a point with a smaller ratio
/// is treated as behind the camera.
constexpr double kMinObserverDepthRatio = 1e-6;

/// A feature's place in the image of a frame or a keyframe.
struct Observation {
  std::uint64_t id = 0;                                ///< of the feature and its landmark
  Eigen::Vector2d x = Eigen::Vector2d::Zero();         ///< normalised image coordinates, z = 1
  double sigma = 0;                                    ///< standard deviation of x, > 0
  Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();  ///< [px] see Feature::to_stamp
  std::uint32_t keyframe = 0;                          ///< its id; set by LocalMap
};
/// The features at their places in this camera's image.
std::vector<Observation> observationsOf(const PinholeCamera& camera,
                                        const std::vector<Feature>& features);

/// A point on the ray of its anchor camera: p_anchor = ray / inverse_depth, ray.z() = 1.
struct InverseDepth {
  double value = 0;  ///< 1 / z in the anchor camera
  double sigma = 0;  ///< standard deviation of value
};

/// A feature observed in keyframes, with or without a depth yet. The keyframe of its first
/// observation is its anchor: it is parametrised by its inverse depth on that ray, so the anchor's
/// own observation has no residual.
struct Landmark {
  std::vector<Observation> observations;  ///< by keyframe; never empty
  std::optional<InverseDepth> depth;      ///< in the anchor keyframe
  int outlier_count = 0;                  ///< consecutive frames in which it was an outlier

  std::uint64_t id() const { return observations.front().id; }
  Eigen::Vector3d ray() const { return observations.front().x.homogeneous(); }
};

/// A landmark in world coordinates, VO units.
struct WorldPoint {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  /// One standard deviation of p_w, along the anchor's ray.
  Eigen::Vector3d sigma_w = Eigen::Vector3d::Zero();
};

/// A frame whose pose is kept and optimised.
struct Keyframe {
  std::uint32_t id = 0;                                     ///< consecutive within a map, from 0
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units
  cv::Mat image;             ///< 8-bit grey, reference for patch alignment; may be empty
  double exposure = 1;       ///< of the image, relative to the map's first
  std::size_t corners = 0;   ///< number observed when it was added
  bool has_parallax = true;  ///< to the keyframe before it
  Vector6d readout_motion = Vector6d::Zero();  ///< see VoFrame
};

/// A point on the ray of its anchor in the axes of a camera c, times its inverse depth: p = R ray +
/// inverse_depth t.
inline Eigen::Vector3d projectOnRay(const Eigen::Vector3d& ray, double inverse_depth,
                                    const Eigen::Isometry3d& T_c_anchor) {
  return T_c_anchor.linear() * ray + inverse_depth * T_c_anchor.translation();
}
/// p_z times the derivative of p_xy / p_z with respect to the inverse depth. p: from
/// projectOnRay().
inline Eigen::Vector2d depthDerivative(const Eigen::Vector3d& p,
                                       const Eigen::Isometry3d& T_c_anchor) {
  const Eigen::Vector3d& t = T_c_anchor.translation();
  return t.head<2>() - p.head<2>() / p.z() * t.z();
}
/// Distance between the projection of a point and its observation x, in normalised image
/// coordinates; infinite behind the camera.
double reprojectionError(const Eigen::Vector3d& p, const Eigen::Vector2d& x);

/// Inverse depth with the least squared reprojection error in all observations (without the
/// anchor's own), by Gauss-Newton. ray: in the anchor, z = 1; T_c_anchor: of each observation.
/// Empty when there is no observation or no baseline, the point is behind an observing camera, or
/// the iteration does not converge. The value may be zero or negative: a point at infinity, or
/// behind the anchor.
std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<Eigen::Isometry3d>& T_c_anchor,
                                        const std::vector<Observation>& observations);

/// The last keyframes and the landmarks that they observe. When the oldest keyframe is dropped,
/// landmarks that the newest keyframe does not observe and that have fewer than two observations
/// left are removed. The others that were anchored in it are anchored in the keyframe of their next
/// observation.
class LocalMap {
 public:
  /// Adds the observations of a new keyframe, ordered by id; unknown ids become landmarks. The
  /// image is shared, not copied. Drops the oldest keyframe when there are too many.
  void addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Observation>& observations,
                   const cv::Mat& image = {});

  /// Removes the newest keyframe, its observations, and the landmarks that no other keyframe
  /// observes. Precondition: there is another keyframe.
  void removeNewestKeyframe();

  /// Triangulates the landmarks without depth. A landmark receives a depth if it is accurate enough
  /// and consistent with all observations.
  void triangulateNew();

  /// Recomputes the sigma of the depths from their observations. It is kept where only the anchor's
  /// observation is left, and does not increase where only one other is left.
  void updateSigmas();

  /// Removes observations of landmarks with a depth that have an error above kMaxAdjustedError.
  /// Removes a landmark that thereby keeps only the observation in the anchor, and one whose
  /// inverse depth is not positive.
  void removeOutliers();

  void clear();

  /// The landmark of a feature; null when there is none.
  const Landmark* find(std::uint64_t id) const;
  Landmark* find(std::uint64_t id);
  /// Empty when there is no such landmark, or it has no positive depth.
  std::optional<WorldPoint> point(std::uint64_t id) const;
  std::optional<WorldPoint> point(const Landmark& landmark) const;

  std::deque<Keyframe>& keyframes() { return keyframes_; }
  const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  /// Precondition: the keyframe is kept.
  const Keyframe& keyframe(std::uint32_t id) const { return keyframes_[indexOf(id)]; }
  std::size_t indexOf(std::uint32_t keyframe_id) const {
    return keyframe_id - keyframes_.front().id;
  }
  std::vector<Landmark>& landmarks() { return landmarks_; }  ///< ordered by id
  const std::vector<Landmark>& landmarks() const { return landmarks_; }

 private:
  void dropOldestKeyframe();
  std::optional<InverseDepth> depthInAnchor(const Landmark& landmark,
                                            const WorldPoint& world) const;
  std::vector<Eigen::Isometry3d> relativePoses() const;
  const Eigen::Isometry3d& poseOfAnchor(const std::vector<Eigen::Isometry3d>& relative_poses,
                                        const Observation& o, const Landmark& landmark) const;
  template <typename Remove>
  void removeLandmarks(const Remove& remove);
  void numberLandmarks();

  std::deque<Keyframe> keyframes_;
  std::vector<Landmark> landmarks_;
  std::vector<std::int32_t> index_of_;  ///< in landmarks_, of id - first_id_; -1: none
  std::uint64_t first_id_ = 0;
};

}  // namespace gsv
