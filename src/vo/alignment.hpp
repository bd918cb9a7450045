#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "vo/feature.hpp"
#include "vo/map.hpp"

namespace gsv {

/// Affine warp, d(pixel of the current image c) / d(pixel of the reference image r), at the point
/// p_r (in camera r, VO units) of that surface. Empty when the surface is at grazing incidence in
/// the reference, when a point lies behind a camera, or when the areas of the patch in the two
/// images differ too much.
std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface);

/// Where a patch is in the current image.
struct PatchMatch {
  Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< [px]
  double correlation = -1;                      ///< normalised, in [-1, 1]
};

/// Locates the patch of a reference image in the current one with subpixel accuracy: translational
/// inverse-compositional alignment (Baker & Matthews 2004) of the warped reference patch, zero-mean
/// SSD. reference, current: 8-bit grey. u_ref: [px] in the reference. warp: from patchWarp. start:
/// initial position in the current image [px], accurate to about a pixel. Empty when a patch leaves
/// its image, lacks gradient in two independent directions (edge or uniform), or is not found near
/// the start with min_correlation.
std::optional<PatchMatch> alignPatch(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                                     const Eigen::Matrix2d& warp, const cv::Mat& current,
                                     const Eigen::Vector2d& start, double min_correlation);

/// Removes the drift of frame-to-frame tracking: aligns each feature that has a map point to the
/// patch of the first keyframe that observed it at about its current size. Alignment to a fixed
/// reference does not drift.
class ReferenceAlignment {
 public:
  /// min_correlation: see OdometryOptions.
  ReferenceAlignment(const PinholeCamera& camera, double min_correlation)
      : camera_(camera), min_correlation_(min_correlation) {}

  /// predicted_T_w_c: predicted pose of the image. Updates u, sigma and surface of the aligned
  /// features; the others keep their tracked values.
  void align(const LocalMap& map, const ImagePyramid& image,
             const Eigen::Isometry3d& predicted_T_w_c, std::vector<Feature>* features);

 private:
  /// A keyframe (r), and its image with the exposure of the current image.
  struct View {
    cv::Mat original;
    double gain;
    cv::Mat image;
    Eigen::Isometry3d T_r_w, T_c_r;  ///< from the world, and to the current camera
  };
  /// The patch that a feature is aligned to.
  struct Reference {
    const View* view;
    Eigen::Vector2d u;    ///< [px]
    Eigen::Vector3d p_r;  ///< the point in the keyframe's camera
  };

  void updateViews(const LocalMap& map, double exposure, const Eigen::Isometry3d& T_c_w);
  std::optional<Reference> findReference(const LocalMap& map, const Feature& feature,
                                         const Eigen::Isometry3d& T_c_w) const;
  void alignFeature(const Reference& reference, const cv::Mat& image, Feature* feature) const;

  const PinholeCamera camera_;
  const double min_correlation_;

  std::vector<View> views_;  ///< of the map's keyframes, in their order
};

}  // namespace gsv
