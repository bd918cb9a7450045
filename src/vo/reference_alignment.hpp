#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/patch_alignment.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

/// Removes the drift of frame-to-frame tracking: aligns each feature that has a map point to the
/// patch of the first keyframe that observed it at about its current size.
class ReferenceAlignment {
 public:
  ReferenceAlignment(const PinholeCamera& camera, const PatchAlignment::Options& options);

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
