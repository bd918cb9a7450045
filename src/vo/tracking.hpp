#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "common/time.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/vo_options.hpp"
#include "vo/corners.hpp"
#include "vo/descriptors.hpp"
#include "vo/feature.hpp"

namespace gsv {

/// Factor between the grey levels of two consecutive images after a step of the camera's exposure:
/// the median ratio current / previous of the unclipped pixels; 1 for a small or implausible
/// factor, and for one that is not significant compared with its variation over the image, which
/// motion causes. Both images: 8-bit grey, same size, small (the coarsest level of a pyramid).
double exposureStep(const cv::Mat& previous, const cv::Mat& current);

/// Stores the previous image and its features, and tracks them into the next image. The previous
/// image is the last tracked one; at standstill an older image is kept.
class Tracking {
 public:
  /// mask: as for VisualOdometry.
  Tracking(const PinholeCamera& camera, const OdometryOptions& options, const cv::Mat& mask)
      : options_(options), camera_(camera), mask_(mask), corners_(options, mask) {}

  /// Computes the pyramid of an image, and estimates its exposure relative to the map's first image
  /// (1 if there is no previous image).
  ImagePyramid preprocess(const cv::Mat& image) const;

  /// Tracks the features into the next image and returns those found, with their new positions.
  /// predicted: predicted position of each feature [px]; empty: unknown. R_next_previous: predicted
  /// rotation from the previous to the next camera frame. A feature's sigma grows with the part of
  /// its motion that the rotation does not explain, because its patch then changes in size.
  std::vector<Feature> track(const ImagePyramid& next, std::int64_t stamp_ns,
                             const std::vector<cv::Point2f>& predicted,
                             const Eigen::Matrix3d& R_next_previous) const;

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

  /// Whether an image is dark, covered or blank: it has too few corners. found: number of the
  /// features tracked into this image.
  bool isTextureless(const ImagePyramid& image, std::size_t found) const;

  /// The last image that was passed to advance(), and its features.
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
  const CornerDetector corners_;

  ImagePyramid previous_;
  std::int64_t previous_stamp_ns_ = 0;
  std::vector<Feature> features_;  ///< in the previous image, ordered by id
  std::uint64_t next_feature_id_ = 0;
};

}  // namespace gsv
