#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

namespace gsv::direct {

constexpr int kPatchSide = 8;  ///< [samples] along a side; 64 samples fill whole SIMD registers
constexpr int kPatchSamples = kPatchSide * kPatchSide;
constexpr int kReferences = 2;  ///< reference images per frame, at one and at two baselines

using Samples = Eigen::Array<float, kPatchSamples, 1>;
using Vector5f = Eigen::Matrix<float, 5, 1>;

/// A patch of the current image.
struct Patch {
  cv::Point corner;        ///< upper left [px]
  float texture = 0;       ///< share of the variance that is not image noise, 0 to 1
  Samples ray_x, ray_y;    ///< viewing rays of the samples, z = 1
  Samples value;           ///< intensities, zero mean and unit variance
  Samples grad_x, grad_y;  ///< of value [1/px]
};

/// Normalises values to zero mean and unit variance (noise [grey levels] included in the variance).
/// Sets texture to the share of the variance that is not noise. Returns the standard deviation
/// [grey levels].
float normalise(float noise, Samples* values, float* texture);

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

/// Samples patches of the lane in images of one camera with one mask, warps them into reference
/// images by the homography R - t m^T of a plane, and measures their remaining shift along the
/// epipolar line. With a rolling shutter, R, t and m are those of the cameras at the exposure of
/// the patch's middle row in both images.
class PatchMatcher {
 public:
  /// camera: of the images. patch_size: [focal lengths]. image_noise: [grey levels]. mask: of the
  /// images' size, 0 where they never show the scene; empty: none.
  PatchMatcher(const PinholeCamera& camera, double patch_size, double image_noise,
               const cv::Mat& mask);

  /// The camera of the reduced images, to which all pixels of patches and road images refer:
  /// smoothing removes the details of an image whose focal length in pixels is large.
  const PinholeCamera& camera() const { return camera_; }

  /// image: 8-bit grey. faces_backwards: the camera looks against the direction of motion. Writes
  /// the smoothed lane region to *road and its patches, square cells of a regular grid, to
  /// *patches; without patches the roi is empty. None touches the mask.
  void extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards, RoadImage* road,
               std::vector<Patch>* patches) const;

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
  void selectCells(const LaneRegion& lane, RoadImage* road, std::vector<Patch>* patches) const;
  cv::Mat smoothed(const cv::Mat& image, const cv::Rect& area) const;
  void samplePatch(const cv::Mat& smoothed, const cv::Point& origin, Patch* patch) const;
  std::pair<Eigen::Isometry3d, Eigen::Vector3d> atExposure(const Reference& reference,
                                                           const Patch& patch,
                                                           const Eigen::Vector3d& m) const;

  PinholeCamera camera_;
  int reduction_;  ///< of the images in each direction
  int patch_px_;   ///< side of a patch
  int radius_;     ///< of the Gaussian filter [px]
  double sigma_;   ///< of the Gaussian filter [px]
  float image_noise_;
  /// 0 at the pixels whose smoothed intensity or its gradient depends on a masked pixel; empty: no
  /// mask.
  cv::Mat allowed_;
};

}  // namespace gsv::direct
