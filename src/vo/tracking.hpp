#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "common/time.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "vo/descriptors.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

class PyramidSearch;
struct CornerCriteria;

/// Shi-Tomasi corners, one per grid cell, and pyramidal Lucas-Kanade with a forward-backward check.
/// The cell size is a fraction of the image width, so the number of features does not depend on the
/// camera's resolution, unless a cell would be smaller than 8 px.
class FeatureTracker {
 public:
  /// [px] Side of the tracked patches: a small patch tolerates more change of size.
  static constexpr int kPatchSide = 9;

  /// mask: 8-bit, one channel, of the images' size, 0 where they never show the scene; empty: none.
  /// No corner is detected, and none tracked to a place, where its patch at full resolution would
  /// contain such a pixel.
  explicit FeatureTracker(const OdometryOptions& options, const cv::Mat& mask = {});

  /// image: 8-bit grey. Copied.
  ImagePyramid pyramid(const cv::Mat& image) const;

  /// The strongest corner of each cell that holds none of `occupied` [px]; at most one per cell. Of
  /// a large image, in a coarser level of its pyramid.
  std::vector<cv::Point2f> detect(const ImagePyramid& image,
                                  const std::vector<cv::Point2f>& occupied) const;

  struct Tracks {
    std::vector<cv::Point2f> points;  ///< [px] in the order of `from_points`; valid where ok
    std::vector<unsigned char> ok;    ///< found, in the image, not at the mask, check passed
  };

  /// from, to: of this tracker's pyramid(). predicted: initial guess of each point in `to` [px],
  /// same length as from_points; empty: none. A point that is not found near its guess is searched
  /// once more over all pyramid levels, starting from its position in `from`.
  Tracks track(const ImagePyramid& from, const ImagePyramid& to,
               const std::vector<cv::Point2f>& from_points,
               const std::vector<cv::Point2f>& predicted) const;

 private:
  bool trackThereAndBack(const cv::Point2f& from_point, int levels, PyramidSearch* there,
                         PyramidSearch* back, const cv::Mat& to, cv::Point2f* point) const;
  CornerCriteria criteria(int image_width) const;
  int reach() const;
  bool isMasked(const cv::Point2f& u) const;

  OdometryOptions options_;
  cv::Mat allowed_;  ///< 0 at the pixels whose patch touches the mask; empty: no mask
};

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

/// Factor between the grey levels of two consecutive images after a step of the camera's exposure:
/// the median ratio current / previous of the pixels. Returns 1 when the factor is between 1 / 1.25
/// and 1.25, above 5 or below 1 / 5, when fewer than 20 % of the pixels are unclipped in both
/// images, or when the factor is not significant compared with the variation of the ratios over the
/// image, which image motion causes. Both images: 8-bit grey, same size, small (the coarsest level
/// of a pyramid).
double exposureStep(const cv::Mat& previous, const cv::Mat& current);

/// The image with its grey levels multiplied by factor; for 1 the image itself, not a copy.
cv::Mat applyGain(const cv::Mat& image, double factor);

}  // namespace ground_scale_vo
