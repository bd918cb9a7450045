#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/local_map.hpp"

namespace ground_scale_vo {

struct Feature;

/// Model of the surface on which a patch lies: the direction of its normal in the reference camera.
enum class PatchSurface : std::uint8_t {
  kFrontoParallel,  ///< along z: parallel to the image plane
  kFloor,           ///< along y: road
  kWall             ///< along x: house front, parked car
};

/// Affine warp, d(pixel of the current image c) / d(pixel of the reference image r), at the point
/// p_r (in camera r, VO units) of that surface. Empty when the surface is at grazing incidence in
/// the reference, when a point lies behind a camera, or when the areas of the patch in the two
/// images differ too much.
std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface);

/// Removes the drift of tracking from frame to frame: aligns each feature that has a map point to
/// the warped patch of the first keyframe that observed it at about its current size.
class PatchAlignment {
 public:
  struct Options {
    double sigma = 0.00025;
    double min_correlation = 0.8;
    double max_shift_px = 1.5;
    double max_scale = 1.6;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("sigma", self.sigma, 1e-6, 0.1,
            "[focal lengths] standard deviation of a corner aligned to a keyframe's patch");
      visit("min_correlation", self.min_correlation, 0, 1,
            "[] least normalised correlation of an aligned patch");
      visit("max_shift_px", self.max_shift_px, 0.1, 20,
            "[px] largest shift from the tracked position");
      visit("max_scale", self.max_scale, 1, 10,
            "[] largest ratio of the sizes of a patch in the current and the reference image");
    }
    /// Throws OptionError.
    void validate() const;
  };

  PatchAlignment(const PinholeCamera& camera, const Options& options);

  /// predicted_T_w_c: of the image. Updates u, sigma and surface of the aligned features; the
  /// others keep their tracked values.
  void align(const LocalMap& map, const ImagePyramid& image,
             const Eigen::Isometry3d& predicted_T_w_c, std::vector<Feature>* features);

 private:
  /// The keyframe (r) whose patch a landmark is aligned to.
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

  void updateKeyframeImages(const LocalMap& map, double exposure);
  std::optional<Reference> findReference(const LocalMap& map, const Landmark& landmark,
                                         const std::vector<Eigen::Isometry3d>& T_r_w,
                                         const Eigen::Vector3d& p_w, double depth) const;
  void alignFeature(const Reference& reference, const Eigen::Isometry3d& T_c_r,
                    const cv::Mat& image, Feature* feature) const;

  const PinholeCamera camera_;
  const Options options_;
  std::vector<KeyframeImage> keyframe_images_;  ///< of the map's keyframes, in their order
};

}  // namespace ground_scale_vo
