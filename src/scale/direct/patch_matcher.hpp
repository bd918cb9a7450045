#pragma once

#include <Eigen/Geometry>

#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/direct/patch.hpp"

namespace ground_scale_vo::direct {

constexpr int kReferences = 2;  ///< reference images per frame, at one and at two baselines

using Vector5f = Eigen::Matrix<float, 5, 1>;

/// A reference image and the motion from the current camera (c) to its camera (r):
/// x_r = R x_c + t.
struct Reference {
  RoadImage image;
  Vector6d readout_motion_c = Vector6d::Zero();             ///< of the current image
  Eigen::Isometry3d T_r_c = Eigen::Isometry3d::Identity();  ///< VO units
};

/// A patch of the current image matched with one reference image. The plane m = n / h gives the
/// viewing ray r the inverse depth -q with q = m . r; an error of m shifts the patch along its
/// epipolar line, which is an error of q.
struct Match {
  bool valid = false;     ///< the patch projects into the reference image and observes q
  float correlation = 0;  ///< zero-mean normalised, corrected for the image noise, -1 to 1
  float shift = 0;        ///< correction of q that aligns the patch [1 / VO unit]
  float variance = 0;     ///< of shift, from the residual intensities
  Eigen::Vector3f ray;    ///< z = 1; mean of the samples' rays by their information on q

  // From the linearisation, which all iterations share.
  Samples jacobian;         ///< of the reference's intensities by q, zero mean
  Vector5f motion;          ///< d shift / d motion error: rotation [rad], direction of t [rad]
  Eigen::Vector2f lens;     ///< d shift / d lens error: k1, k2 of the distortion that is left
  bool observable = false;  ///< false: the texture runs along the epipolar line (aperture problem)
};

/// Warps patches into reference images by the homography R - t m^T of a plane, and measures their
/// remaining shift along the epipolar line. With a rolling shutter, R, t and m are those of the
/// cameras at the exposure of the patch's middle row in both images.
class PatchMatcher {
 public:
  /// camera, allowed: of the PatchExtractor. image_noise: [grey levels].
  PatchMatcher(const PinholeCamera& camera, double image_noise, const cv::Mat& allowed);

  /// Intensities of the patch in the reference image under the plane m, bilinearly interpolated.
  /// False when a sample lies outside the stored part of the image, behind its camera or at the
  /// mask.
  bool sample(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m,
              Samples* values) const;

  /// Normalises intensities of sample(). Returns their correlation with the patch, corrected for
  /// the image noise, -1 to 1.
  float correlate(const Patch& patch, Samples* values) const;

  /// Derivatives of the patch's intensities in the reference image by q, by the motion and by the
  /// lens. They use the gradient of the current image, transformed by the homography (inverse
  /// compositional).
  void linearise(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m,
                 Match* match) const;

  /// One Gauss-Newton step along q with Cauchy weights. Precondition: *match is linearised.
  void measure(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m,
               Match* match) const;

 private:
  struct Warp {
    Eigen::Matrix3f H;  ///< of the rays: R - t m^T
    Eigen::Vector3f t, m;
  };
  Warp warpOf(const Reference& reference, const Patch& patch, const Eigen::Vector3d& m) const;

  PinholeCamera camera_;
  float image_noise_;
  cv::Mat allowed_;
};

}  // namespace ground_scale_vo::direct
