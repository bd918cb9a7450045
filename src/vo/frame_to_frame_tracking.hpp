#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "common/time.hpp"
#include "ground_scale_vo/vo/odometry_stages.hpp"
#include "vo/descriptor_matching.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

/// Stores the previous image and its features, and tracks them into the next image. The previous
/// image is the last tracked one; at standstill an older image is kept.
class FrameToFrameTracking {
 public:
  /// mask: as for VisualOdometry.
  FrameToFrameTracking(const PinholeCamera& camera, const OdometryOptions& options,
                       const cv::Mat& mask);

  /// Computes the pyramid of an image, and estimates its exposure relative to the map's first image
  /// (1 if there is no previous image).
  ImagePyramid preprocess(const cv::Mat& image) const;

  /// Tracks the features into the next image and returns those found, with their new positions; the
  /// others are appended to `rejected`. predicted: predicted position of each feature [px]; empty:
  /// unknown. R_next_previous: predicted rotation from the previous to the next camera frame. A
  /// feature's sigma grows with the part of its motion that the rotation does not explain, because
  /// its patch then changes in size.
  std::vector<Feature> track(const ImagePyramid& next, std::int64_t stamp_ns,
                             const std::vector<cv::Point2f>& predicted,
                             const Eigen::Matrix3d& R_next_previous,
                             std::vector<RejectedFeature>* rejected) const;

  /// The next image becomes the previous one, unless the camera is stationary: tracking from
  /// the same image throughout a standstill accumulates no drift. Returns false at a standstill.
  bool advanceUnlessStandstill(ImagePyramid next, std::int64_t stamp_ns,
                               std::vector<Feature> found);
  void advance(ImagePyramid next, std::int64_t stamp_ns, std::vector<Feature> found);

  /// Adds new corners where the previous image has no features.
  void detectNew();

  /// Descriptors of the features in the previous image, in their order.
  Descriptors describeFeatures() const;
  /// Descriptors of the corners of an image.
  Descriptors describeCorners(const ImagePyramid& image) const;

  /// True if the image has too few corners to track (dark, covered or blank). found: number of
  /// features tracked into this image.
  bool isTextureless(const ImagePyramid& image, std::size_t found) const;

  bool hasImage() const { return !previous_.levels.empty(); }
  const ImagePyramid& image() const { return previous_; }
  const std::vector<Feature>& features() const { return features_; }
  std::vector<Feature>& features() { return features_; }
  /// [s] from the previous image to a stamp.
  double secondsUntil(std::int64_t stamp_ns) const {
    return secondsBetween(previous_stamp_ns_, stamp_ns);
  }

 private:
  double medianFlow(const std::vector<Feature>& found) const;
  std::vector<cv::Point2f> pixels() const;  ///< of the features

  const OdometryOptions options_;
  const PinholeCamera camera_;
  const cv::Mat mask_;
  const FeatureTracker tracker_;

  ImagePyramid previous_;
  std::int64_t previous_stamp_ns_ = 0;
  std::vector<Feature> features_;  ///< in the previous image, ordered by id
  std::uint64_t next_feature_id_ = 0;
};

}  // namespace ground_scale_vo
