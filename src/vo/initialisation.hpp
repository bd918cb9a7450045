#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/vo/vo_options.hpp"
#include "vo/feature.hpp"
#include "vo/mapping.hpp"
#include "vo/pose.hpp"
#include "vo/two_view.hpp"

namespace gsv {

/// Starts a map: collects frames until the motion between the first and the newest one can be
/// estimated from their matches (two-view geometry), then makes a map of these two and localises
/// the frames between them in it.
class MapInitialisation {
 public:
  MapInitialisation(const PinholeCamera& camera, const OdometryOptions& options)
      : readout_time_(options.readout_time), camera_(camera) {}

  /// Removes all frames. This frame becomes the first one and defines the world frame of the map.
  void restart(std::int64_t stamp_ns, const std::vector<Feature>& features, const cv::Mat& image);

  /// True if `found` of the first frame's features suffice to continue.
  bool canContinueWith(std::size_t found) const;

  /// Rotation from the first frame to the one in which `found` of its features were tracked.
  /// Unknown when there are too few.
  RelativeRotation rotationSinceFirst(const std::vector<Feature>& found) const;

  /// Adds the next frame. found: the features of the first frame that are still tracked. With a
  /// rolling shutter the second frame's flow also shifts the features of the first to its stamp.
  void addFrame(std::int64_t stamp_ns, const std::vector<Feature>& found);

  /// The newest frame shows no motion since the one before it, whose pose it gets: a long
  /// standstill needs neither memory for its features nor time to localise its frames.
  void newestStandsStill() { observations_.back() = {}; }

  /// Creates a map from the first and the newest frame. found, image: features and image of the
  /// newest frame. Returns the poses of all frames; empty, with an empty map, if the motion cannot
  /// be estimated yet. The unit of length is the median depth in the first frame.
  std::optional<std::vector<StampedPose>> tryStartMap(const std::vector<Feature>& found,
                                                      const ImagePyramid& image, Mapping* mapping);

 private:
  std::vector<Eigen::Vector2d> pixelsInFirst(const std::vector<Feature>& found) const;
  bool makeMap(const std::vector<Feature>& found, const ImagePyramid& image,
               const TwoViewMotion& motion, Mapping* mapping) const;
  std::optional<std::vector<StampedPose>> localiseFrames(const LocalMap& map) const;

  void shiftFirstToStamp(const std::vector<Feature>& found);

  const double readout_time_;  ///< [s]
  const PinholeCamera camera_;

  std::vector<std::int64_t> stamps_ns_;  ///< of the frames
  /// Of each frame. Empty: the camera has not moved since the frame before.
  std::vector<std::vector<Observation>> observations_;
  cv::Mat first_image_;
};

}  // namespace gsv
