#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/triangulation.hpp"

namespace ground_scale_vo {

/// A frame whose pose is kept and optimised.
struct Keyframe {
  std::uint32_t id = 0;                                     ///< consecutive within a map, from 0
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units
  cv::Mat image;        ///< 8-bit grey, the reference of the corners first seen in it; may be empty
  double exposure = 1;  ///< of the image, over that of the map's first
};

struct Observation {
  std::uint32_t keyframe = 0;
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};

/// A corner seen in keyframes, with or without a depth yet. It lies on the ray of its first
/// observation, which is its anchor.
struct Landmark {
  std::vector<Observation> observations;  ///< by keyframe; never empty
  std::optional<InverseDepth> depth;      ///< in the anchor keyframe
  int outlier_count = 0;                  ///< frames in a row that disagreed with it

  Eigen::Vector3d ray() const { return observations.front().x.homogeneous(); }
};

/// A landmark's place in the world, with its uncertainty along the anchor's ray.
struct WorldPoint {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_w =
      Eigen::Vector3d::Zero();  ///< one standard deviation away from the anchor
};

/// The last keyframes of the odometry and the landmarks that they see. Bounded: what only dropped
/// keyframes saw is forgotten, and a landmark that outlives its anchor moves to its next
/// observation.
class LocalMap {
 public:
  struct Options {
    int keyframes = 14;
    double max_relative_sigma = 0.35;
    double max_error = 0.004;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("keyframes", self.keyframes, 3, 1000, "[keyframes] kept at most");
      visit("max_relative_sigma", self.max_relative_sigma, 0.01, 10,
            "[] a new depth needs sigma(1/z) below this share of 1/z");
      visit("max_error", self.max_error, 1e-6, 0.1,
            "[focal lengths] of any observation of a new depth");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit LocalMap(const Options& options);

  struct Corner {
    std::uint64_t id = 0;
    Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
    double sigma = 0;                             ///< standard deviation of x, > 0
  };
  /// Adds the corners as observations of the new keyframe; unknown ids become landmarks. The image
  /// is kept, not copied.
  std::uint32_t addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Corner>& corners,
                            const cv::Mat& image = {});

  /// Gives a depth to landmarks that lack one and have been seen with enough parallax by now.
  void triangulateNew();

  /// Recomputes every depth's sigma from its observations.
  void updateSigmas();

  /// Removes observations whose error is over `max_error` (normalised); a landmark whose anchor is
  /// left alone is removed.
  void removeOutliers(double max_error);

  void clear();

  Landmark* find(std::uint64_t id);
  std::optional<WorldPoint> point(std::uint64_t id) const;
  std::optional<WorldPoint> point(const Landmark& landmark) const;

  std::deque<Keyframe>& keyframes() { return keyframes_; }
  const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  /// Precondition: the keyframe is kept.
  const Keyframe& keyframe(std::uint32_t id) const {
    return keyframes_[id - keyframes_.front().id];
  }
  std::map<std::uint64_t, Landmark>& landmarks() { return landmarks_; }
  const std::map<std::uint64_t, Landmark>& landmarks() const { return landmarks_; }

 private:
  void dropOldestKeyframe();

  Options options_;
  std::deque<Keyframe> keyframes_;
  std::map<std::uint64_t, Landmark> landmarks_;
};

}  // namespace ground_scale_vo
