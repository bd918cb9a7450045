#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "vo/feature.hpp"
#include "vo/map.hpp"
#include "vo/tracking.hpp"

namespace ground_scale_vo {

/// Affine warp, d(pixel of the current image c) / d(pixel of the reference image r), at the point
/// p_r (in camera r, VO units) of that surface. Empty when the surface is at grazing incidence in
/// the reference, when a point lies behind a camera, or when the areas of the patch in the two
/// images differ too much.
std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface);

/// Locates the patch of a reference image in the current one with subpixel accuracy: translational
/// inverse-compositional alignment (Baker & Matthews 2004) of the warped reference patch, zero-mean
/// SSD. Alignment to a fixed reference does not drift, tracking from frame to frame does.
class PatchAlignment {
 public:
  struct Match {
    Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< [px] in the current image
    double correlation = -1;                      ///< normalised, in [-1, 1]
  };

  explicit PatchAlignment(double min_correlation = 0.8) : min_correlation_(min_correlation) {}

  /// reference, current: 8-bit grey. u_ref: [px] in the reference. warp: from patchWarp. start:
  /// initial position in the current image [px], accurate to about a pixel. Empty when a patch
  /// leaves its image, lacks gradient in two independent directions (edge or uniform), or is not
  /// found within max_shift_px of the start with min_correlation.
  std::optional<Match> align(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                             const Eigen::Matrix2d& warp, const cv::Mat& current,
                             const Eigen::Vector2d& start) const;

 private:
  double min_correlation_;
};

/// Removes the drift of frame-to-frame tracking: aligns each feature that has a map point to the
/// patch of the first keyframe that observed it at about its current size.
class ReferenceAlignment {
 public:
  ReferenceAlignment(const PinholeCamera& camera, double min_correlation);

  /// predicted_T_w_c: predicted pose of the image. Updates u, sigma and surface of the aligned
  /// features; the others keep their tracked values.
  void align(const LocalMap& map, const ImagePyramid& image,
             const Eigen::Isometry3d& predicted_T_w_c, std::vector<Feature>* features);

 private:
  /// The keyframe whose patch a landmark is aligned to.
  struct Reference {
    std::size_t keyframe;  ///< its index in the map
    Eigen::Vector2d u;     ///< [px]
    Eigen::Vector3d p_r;   ///< the point in the keyframe's camera
  };
  /// A keyframe's image with the exposure of the current image.
  struct KeyframeImage {
    cv::Mat original;
    double gain;
    cv::Mat image;
  };
  /// A keyframe (r) relative to the world and to the current camera.
  struct KeyframePose {
    Eigen::Isometry3d T_r_w, T_c_r;
  };
  struct AlignedFeature {
    PatchAlignment::Match match;
    PatchSurface surface;
  };

  void updateKeyframeImages(const LocalMap& map, double exposure);
  std::optional<Reference> findReference(const LocalMap& map, const Landmark& landmark,
                                         const std::vector<KeyframePose>& poses,
                                         const Eigen::Vector3d& p_w, double depth) const;
  std::optional<AlignedFeature> alignFeature(const Feature& feature, const Reference& reference,
                                             const cv::Mat& reference_image,
                                             const Eigen::Isometry3d& T_c_r,
                                             const cv::Mat& image) const;

  const PinholeCamera camera_;
  const PatchAlignment alignment_;

  std::vector<KeyframeImage> keyframe_images_;  ///< of the map's keyframes, in their order
};

}  // namespace ground_scale_vo
