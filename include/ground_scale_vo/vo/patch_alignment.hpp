#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/input/camera.hpp"

namespace ground_scale_vo {

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

/// Locates the patch of a reference image in the current one with subpixel accuracy: translational
/// inverse-compositional alignment (Baker & Matthews 2004) of the warped reference patch, zero-mean
/// SSD. Alignment to a fixed reference does not drift, tracking from frame to frame does.
class PatchAlignment {
 public:
  struct Options {
    double min_correlation = 0.8;
    double max_shift_px = 1.5;
    double max_scale = 1.6;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
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

  struct Match {
    Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< [px] in the current image
    double correlation = -1;                      ///< normalised, in [-1, 1]
  };

  explicit PatchAlignment(const Options& options);

  /// reference, current: 8-bit grey. u_ref: [px] in the reference. warp: from patchWarp. start:
  /// initial position in the current image [px], accurate to about a pixel. Empty when a patch
  /// leaves its image, lacks gradient in two independent directions (edge or uniform), or is not
  /// found within max_shift_px of the start with min_correlation.
  std::optional<Match> align(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                             const Eigen::Matrix2d& warp, const cv::Mat& current,
                             const Eigen::Vector2d& start) const;

  const Options& options() const { return options_; }

 private:
  Options options_;
};

}  // namespace ground_scale_vo
