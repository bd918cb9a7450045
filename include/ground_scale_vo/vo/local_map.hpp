#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/vo/landmarks.hpp"

namespace ground_scale_vo {

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

/// A landmark in world coordinates, VO units.
struct WorldPoint {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  /// One standard deviation of p_w, along the anchor's ray.
  Eigen::Vector3d sigma_w = Eigen::Vector3d::Zero();
};

/// The last keyframes and the landmarks that they observe. When the oldest keyframe is dropped,
/// landmarks that the newest keyframe does not observe and that have fewer than two observations
/// left are removed. The others that were anchored in it are anchored in the keyframe of their next
/// observation.
class LocalMap {
 public:
  struct Options {
    int keyframes = 14;
    double max_relative_sigma = 0.35;
    double max_reprojection_error = 0.004;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("keyframes", self.keyframes, 3, 1000, "[keyframes] largest number");
      visit("max_relative_sigma", self.max_relative_sigma, 0.01, 10,
            "[] largest sigma of a new inverse depth, relative to the inverse depth");
      visit("max_reprojection_error", self.max_reprojection_error, 1e-6, 0.1,
            "[focal lengths] largest error of any observation of a new landmark depth");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit LocalMap(const Options& options);

  struct Corner {
    std::uint64_t id = 0;
    Eigen::Vector2d x = Eigen::Vector2d::Zero();         ///< normalised image coordinates, z = 1
    double sigma = 0;                                    ///< standard deviation of x, > 0
    Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();  ///< [px] see Feature::to_stamp
  };
  /// Adds the corners as observations of the new keyframe; unknown ids become landmarks. The image
  /// is shared, not copied. Drops the oldest keyframe when there are too many. Returns the new id.
  std::uint32_t addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Corner>& corners,
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

  /// Removes observations of landmarks with a depth that have a larger error, in normalised image
  /// coordinates. Removes a landmark that thereby keeps only the observation in the anchor, and one
  /// whose inverse depth is not positive.
  void removeOutliers(double max_reprojection_error);

  void clear();

  /// Null when there is none.
  Landmark* find(std::uint64_t id);
  /// Empty when there is no such landmark, or it has no positive depth.
  std::optional<WorldPoint> point(std::uint64_t id) const;
  std::optional<WorldPoint> point(const Landmark& landmark) const;
  /// The same; also empty when the landmark is null.
  std::optional<WorldPoint> pointOf(const Landmark* landmark) const {
    return landmark ? point(*landmark) : std::nullopt;
  }

  std::deque<Keyframe>& keyframes() { return keyframes_; }
  const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  /// Precondition: the keyframe is kept.
  const Keyframe& keyframe(std::uint32_t id) const {
    return keyframes_[id - keyframes_.front().id];
  }
  Landmarks& landmarks() { return landmarks_; }
  const Landmarks& landmarks() const { return landmarks_; }

 private:
  void dropOldestKeyframe();
  std::optional<InverseDepth> depthInAnchor(const Landmark& landmark,
                                            const WorldPoint& world) const;

  Options options_;
  std::deque<Keyframe> keyframes_;
  Landmarks landmarks_;
};

}  // namespace ground_scale_vo
