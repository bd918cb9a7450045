#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

/// The previous image with its features, and how they are found in the next image. The previous
/// image is the last tracked one, or an earlier one while the camera stands still.
class FrameToFrameTracking {
 public:
  FrameToFrameTracking(const PinholeCamera& camera, const VisualOdometry::Options& options);

  /// Pyramid of the next image, with its exposure relative to the map's first image.
  ImagePyramid pyramid(const cv::Mat& image) const;

  /// The features that are found in the next image, at their new pixels; the others are appended to
  /// `rejected`. predicted: where each feature is expected [px]. R_next_previous: predicted
  /// rotation. A feature's sigma grows with its motion beyond that rotation, because its patch then
  /// changes in size.
  std::vector<Feature> track(const ImagePyramid& next, std::int64_t stamp_ns,
                             const std::vector<cv::Point2f>& predicted,
                             const Eigen::Matrix3d& R_next_previous,
                             std::vector<RejectedFeature>* rejected) const;

  /// The next image becomes the previous one, unless the camera stands still: tracking from the
  /// same image through a standstill accumulates no drift.
  void advanceUnlessStill(ImagePyramid next, std::int64_t stamp_ns, std::vector<Feature> found);
  void advance(ImagePyramid next, std::int64_t stamp_ns, std::vector<Feature> found);

  /// Adds new corners where the previous image has no features.
  void detectNew();

  /// Fewer corners than an image of a textured scene has: dark, covered or blank. found: number of
  /// features that were tracked into it.
  bool isTextureless(const ImagePyramid& image, std::size_t found) const;

  bool hasImage() const { return !previous_.levels.empty(); }
  const ImagePyramid& image() const { return previous_; }
  const std::vector<Feature>& features() const { return features_; }
  /// [s] from the previous image to a stamp.
  double secondsUntil(std::int64_t stamp_ns) const {
    return static_cast<double>(stamp_ns - previous_stamp_ns_) * 1e-9;
  }

 private:
  double medianFlow(const std::vector<Feature>& found) const;

  const VisualOdometry::Options options_;
  const PinholeCamera camera_;
  const FeatureTracker tracker_;

  ImagePyramid previous_;
  std::int64_t previous_stamp_ns_ = 0;
  std::vector<Feature> features_;  ///< in the previous image, by id
  std::uint64_t next_feature_id_ = 0;
};

}  // namespace ground_scale_vo
