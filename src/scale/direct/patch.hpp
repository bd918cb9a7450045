#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

namespace ground_scale_vo::direct {

constexpr int kPatchSide = 8;  ///< [samples] along a side; 64 samples fill whole SIMD registers
constexpr int kPatchSamples = kPatchSide * kPatchSide;

using Samples = Eigen::Array<float, kPatchSamples, 1>;

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

/// Smooths the current image and samples its patches in the lane region: square cells of a regular
/// grid over the image. Smoothing removes the details of an image whose focal length in pixels is
/// large, so it is reduced first.
class PatchExtractor {
 public:
  /// camera: of the images. patch_size: [focal lengths]. image_noise: [grey levels]. mask: of the
  /// images' size, 0 where they never show the scene; empty: none.
  PatchExtractor(const PinholeCamera& camera, double patch_size, double image_noise,
                 const cv::Mat& mask);

  /// The camera of the reduced images, to which all pixels of patches and road images refer.
  const PinholeCamera& camera() const { return camera_; }
  /// 0 at the pixels whose smoothed intensity or its gradient depends on a masked pixel; empty: no
  /// mask.
  const cv::Mat& allowed() const { return allowed_; }

  /// image: 8-bit grey. faces_backwards: the camera looks against the direction of motion. Writes
  /// the smoothed lane region to *road and the patches in it to *patches; without patches the roi
  /// is empty. None touches the mask.
  void extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards, RoadImage* road,
               std::vector<Patch>* patches);

 private:
  void selectCells(const LaneRegion& lane, RoadImage* road, std::vector<Patch>* patches) const;
  cv::Mat smoothed(const cv::Mat& image, const cv::Rect& area) const;
  void sample(const cv::Mat& smoothed, const cv::Point& origin, Patch* patch) const;

  PinholeCamera camera_;
  int reduction_;  ///< of the images in each direction
  int patch_px_;   ///< side of a patch
  int radius_;     ///< of the Gaussian filter [px]
  double sigma_;   ///< of the Gaussian filter [px]
  float image_noise_;
  cv::Mat allowed_;
};

}  // namespace ground_scale_vo::direct
