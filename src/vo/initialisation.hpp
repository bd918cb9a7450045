#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "vo/feature.hpp"
#include "vo/mapping.hpp"
#include "vo/pose.hpp"
#include "vo/two_view.hpp"

namespace ground_scale_vo {

/// Starts a map: collects frames until the motion between the first and the newest one can be
/// estimated from their matches (two-view geometry), then makes a map of these two and localises
/// the frames between them in it.
class MapInitialisation {
 public:
  MapInitialisation(const PinholeCamera& camera, const OdometryOptions& options);

  /// Removes all frames. This frame becomes the first one and defines the world frame of the map.
  void restart(std::int64_t stamp_ns, const std::vector<Feature>& features, const cv::Mat& image);

  /// True if `found` of the first frame's features suffice to continue.
  bool canContinueWith(std::size_t found) const;

  /// Rotation from the first frame to the one in which `found` of its features were tracked. Empty
  /// when there are too few.
  std::optional<RelativeRotation> rotationSinceFirst(const std::vector<Feature>& found) const;

  /// Adds the next frame. found: the features of the first frame that are still tracked. With a
  /// rolling shutter the second frame's flow also shifts the features of the first to its stamp.
  void addFrame(std::int64_t stamp_ns, const std::vector<Feature>& found);

  /// The newest frame shows no motion since the one before it, whose pose it gets: a long
  /// standstill needs neither memory for its features nor time to localise its frames.
  void newestStandsStill() { frames_.back().corners = std::vector<Observation>(); }

  /// Creates a map from the first and the newest frame. found, image: features and image of the
  /// newest frame. Returns the poses of all frames; empty, with an empty map, if the motion cannot
  /// be estimated yet. The unit of length is the median depth in the first frame.
  std::optional<std::vector<StampedPose>> tryStartMap(const std::vector<Feature>& found,
                                                      const ImagePyramid& image, Mapping* mapping);

 private:
  struct Frame {
    std::int64_t stamp_ns = 0;
    std::vector<Observation> corners;  ///< empty: at the pose of the frame before
  };

  std::vector<Eigen::Vector2d> pixelsInFirst(const std::vector<Feature>& found) const;
  bool makeMap(const std::vector<Feature>& found, const ImagePyramid& image,
               const TwoView::Result& motion, Mapping* mapping) const;
  std::optional<std::vector<StampedPose>> localiseFrames(const LocalMap& map) const;

  void shiftFirstToStamp(const std::vector<Feature>& found);

  const double readout_time_;  ///< [s]
  const PinholeCamera camera_;
  const TwoView two_view_{};
  const PoseEstimation pose_estimation_{};

  std::vector<Frame> frames_;
  cv::Mat first_image_;
};

}  // namespace ground_scale_vo
