#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/camera_path.hpp"
#include "ground_scale_vo/scale/road.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Direct (photometric) estimate of the ground plane from the intensities of the road. Not
/// part of the paper. It needs image texture but no corners and no map points.
///
/// Between two frames with relative pose (R, t) a point of the plane m = n / h with viewing ray r
/// moves to R r - t (m . r). For each frame:
///  1. The lane, ahead or behind, is divided into patches.
///  2. Two reference images are chosen, about one and two baselines away.
///  3. Each patch is warped into each reference image by the plane's homography, normalised to zero
///     mean and unit variance. Its remaining shift along the epipolar line is a measurement of
///     q = m . r, with a variance from its residual and its texture.
///  4. A robust Gauss-Newton step corrects m. The errors of the relative poses and of the lens are
///     marginalised out: they shift all patches in common. Steps 3 and 4 are repeated until
///     convergence.
///  5. When that fails while the height is not known, a search over height and roll provides
///     another start.
///
/// Regions of a given mask are used in neither image.
///
/// Not thread safe.
class DirectPlaneEstimator {
 public:
  /// Lengths ending in _heights are in camera heights.
  struct Options {
    // Lane region and patches.
    double min_ahead_heights = 1.5;
    double max_ahead_heights = 10;
    double lane_half_width_heights = 1.0;  ///< the own lane; kerbs and pavements lie higher
    double patch_size = 0.03;              ///< [focal lengths]
    double baseline_heights = 0.7;

    // Noise model.
    double roughness_heights = 0.005;
    double curvature_sigma = 1e-3;  ///< [1 / camera height]
    double crown_sigma = 0.03;      ///< [1 / camera height]
    double twist_sigma = 0.01;      ///< [1 / camera height]
    double lens_k1_sigma = 0.02;
    double lens_k2_sigma = 0.01;
    double rotation_sigma_rad = 7e-5;
    double direction_sigma_rad = 1e-3;

    // Acceptance.
    double min_correlation = 0.8;
    int min_patches = 24;

    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_ahead_heights", self.min_ahead_heights, 0, 1000,
            "[camera heights] near end of the lane region");
      visit("max_ahead_heights", self.max_ahead_heights, 0.1, 1000,
            "[camera heights] far end of the lane region; at least 6 beyond the road at the lower "
            "image border");
      visit("lane_half_width_heights", self.lane_half_width_heights, 0.01, 1000,
            "[camera heights] half width of the lane region");
      visit("patch_size", self.patch_size, 1e-3, 1, "[focal lengths] side of a patch");
      visit("baseline_heights", self.baseline_heights, 0.01, 100,
            "[camera heights] distance to the first reference image; the second is twice as far");
      visit(
          "roughness_heights", self.roughness_heights, 1e-6, 1,
          "[camera heights] standard deviation of the road surface; limits the weight of a patch");
      visit("curvature_sigma", self.curvature_sigma, 1e-9, 1,
            "[1/camera height] standard deviation of the road's vertical curvature");
      visit("crown_sigma", self.crown_sigma, 1e-9, 1,
            "[1/camera height] standard deviation of the curvature of the road's cross-section, "
            "used with an estimated lens");
      visit("twist_sigma", self.twist_sigma, 1e-9, 1,
            "[1/camera height] standard deviation of the twist: change of the cross slope along "
            "the path, used with an estimated lens");
      visit("lens_k1_sigma", self.lens_k1_sigma, 1e-9, 1,
            "[] standard deviation of the radial distortion (k1) that the calibration has left");
      visit("lens_k2_sigma", self.lens_k2_sigma, 1e-9, 1, "[] the same of k2");
      visit("rotation_sigma_rad", self.rotation_sigma_rad, 1e-9, 1,
            "[rad] standard deviation of the odometry's rotation between two images");
      visit("direction_sigma_rad", self.direction_sigma_rad, 1e-9, 1,
            "[rad] standard deviation of the odometry's direction of motion between two images");
      visit("min_correlation", self.min_correlation, 0, 1,
            "[] least accepted mean correlation of the patches");
      visit("min_patches", self.min_patches, 3, 1e6,
            "[patches] least number of matched patches, summed over the reference images");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    /// kMeasured: plane, height_sigma, road_distance and correlation are valid. Otherwise
    /// kStandstill (no reference image at a sufficient distance, or neither a height nor a feature
    /// in the lane) or kNoPlane.
    MeasurementStatus status = MeasurementStatus::kNoPlane;
    /// In the axes of this frame's camera. Its height belongs to the camera of the path that is
    /// nearest to the lane region, VO units.
    GroundPlane plane;
    double height_sigma = 0;   ///< standard deviation of plane.height [VO units]
    double road_distance = 0;  ///< of the patches' centre from that camera [VO units]
    double correlation = 0;    ///< mean over the matched patches, weighted by texture; -1 to 1
    int patches = 0;           ///< matched patches, counted once for each reference image
  };

  /// Throws OptionError.
  explicit DirectPlaneEstimator(const Options& options);
  ~DirectPlaneEstimator();

  /// Estimates the plane of one frame, and keeps the image in the path as a reference for later
  /// frames. frame: tracking. image: rectified, 8-bit grey, of the camera's size. height: predicted
  /// [VO units]; 0: not known, the median of the features in the lane replaces it. path: its newest
  /// camera is the one of the frame. mask: as for ScaleRecovery::process().
  Result estimate(const VoFrame& frame, const cv::Mat& image, double height, CameraPath* path,
                  const cv::Mat& mask = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
