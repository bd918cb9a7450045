#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// What a patch is taken for, in the axes of the camera that took it.
enum class PatchSurface : std::uint8_t { kFacing, kFloor, kWall };  ///< normal along z, y, x

/// d(pixel of the current image) / d(pixel of the reference image) at a point of that surface.
/// p_r: the point in the reference camera. Nothing where a camera sees the surface edge-on or from
/// behind.
std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface);

/// Finds the patch of a reference image in the current one to a fraction of a pixel: direct
/// alignment (inverse compositional Gauss-Newton) of the warped reference patch, both with their
/// mean taken off. Tracking from frame to frame drifts; the patch where a corner was first seen
/// does not.
class PatchAlignment {
 public:
  struct Options {
    int window_px = 9;
    int max_iterations = 10;
    double min_correlation = 0.8;
    double max_shift_px = 1.5;
    double max_scale = 1.6;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("window_px", self.window_px, 5, 21, "[px] side of the aligned patch, odd");
      visit("max_iterations", self.max_iterations, 1, 100, "[] of the alignment");
      visit("min_correlation", self.min_correlation, 0, 1,
            "[] normalised, of the patch with what it was aligned to");
      visit("max_shift_px", self.max_shift_px, 0.1, 20,
            "[px] farthest from where the corner was tracked to");
      visit("max_scale", self.max_scale, 1, 10,
            "[] a patch that is larger or smaller by more is no reference");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Match {
    Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< [px] in the current image
    double correlation = -1;                      ///< normalised, in [-1, 1]
  };

  explicit PatchAlignment(const Options& options);

  /// reference, current: 8-bit grey. warp: as patchWarp gives it. start: where u_ref appears in the
  /// current image, to about a pixel. Nothing when a patch leaves its image, has no corner in it,
  /// or is not found within max_shift_px of the start with min_correlation.
  std::optional<Match> align(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                             const Eigen::Matrix2d& warp, const cv::Mat& current,
                             const Eigen::Vector2d& start) const;

  const Options& options() const { return options_; }

 private:
  Options options_;
  std::vector<float> mask_;  ///< of a patch in memory: 1 for its pixels, 0 for what fills it up
};

}  // namespace ground_scale_vo
