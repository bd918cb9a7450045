#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

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
  using Options = DirectPlaneEstimatorOptions;

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
