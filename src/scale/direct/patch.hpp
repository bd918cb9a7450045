#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/scale/lane_region.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/direct/image_buffer.hpp"
#include "scale/direct/smoothing.hpp"

namespace ground_scale_vo::direct {

constexpr int kPatchSide = 8;  ///< [samples] along a side; 64 samples fill whole SIMD registers
constexpr int kPatchSamples = kPatchSide * kPatchSide;

using Samples = Eigen::Array<float, kPatchSamples, 1>;

/// Regular grid of square cells over the image; each cell is one patch.
struct PatchGrid {
  PatchGrid() = default;
  /// patch_size: [focal lengths].
  PatchGrid(const PinholeCamera& camera, double patch_size);

  std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(row * columns + column);
  }
  std::size_t size() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  cv::Rect cell(int row, int column) const {
    return {column * patch_px, row * patch_px, patch_px, patch_px};
  }

  int patch_px = 0;  ///< side of a cell
  int columns = 0, rows = 0;
};

/// A patch of the current image.
struct Patch {
  std::size_t cell = 0;    ///< index in the PatchGrid
  bool masked = false;     ///< excluded from the estimate
  cv::Point corner;        ///< upper left [px]
  float texture = 0;       ///< share of the variance that is not image noise, 0 to 1
  Samples ray_x, ray_y;    ///< viewing rays of the samples, z = 1
  Samples value;           ///< intensities, zero mean and unit variance
  Samples grad_x, grad_y;  ///< of value [1/px]
};

/// Normalises values to zero mean and unit variance (noise included in the variance). Sets texture
/// to the share of the variance that is not noise. Returns the standard deviation [grey levels].
float normalise(float noise, Samples* values, float* texture);

/// Zero-mean normalised cross-correlation of a patch with values (which are normalised in place),
/// corrected for the image noise. noise: [grey levels].
float correlate(const Patch& patch, float noise, Samples* values);

/// Smoothing removes the details of an image whose focal length [px] is large, so the direct stage
/// works on smaller images: by this factor, 1 or more, in each direction.
int imageReduction(const PinholeCamera& camera);

/// The camera of images that are smaller by a factor: each pixel is the mean of factor x factor.
PinholeCamera reduced(const PinholeCamera& camera, int factor);

/// Smooths the current image and samples its patches in the lane region.
class PatchExtractor {
 public:
  /// camera: of the patches; its images are larger by the factor `reduction`. image_noise: [grey
  /// levels]. mask: of the images' size, 0 where they never show the scene; empty: none.
  PatchExtractor(const PinholeCamera& camera, int reduction, const PatchGrid& grid,
                 double image_noise, const cv::Mat& mask);

  /// 0 at the pixels whose smoothed intensity or its gradient depends on a masked pixel; empty: no
  /// mask.
  const cv::Mat& allowed() const { return allowed_; }

  /// image: 8-bit grey, of the camera's size times the reduction. Writes the smoothed lane region
  /// to *current and the patches in it (`masked` is false; none touches the mask) to *patches.
  /// faces_backwards: against the direction of motion. Without patches current->roi is empty.
  void extract(const cv::Mat& image, const LaneRegion& lane, bool faces_backwards,
               RoadImage* current, std::vector<Patch>* patches);

 private:
  bool touchesMask(const cv::Rect& cell) const;
  void selectCells(const LaneRegion& lane, RoadImage* current, std::vector<Patch>* patches) const;
  cv::Rect sampledPart(const std::vector<Patch>& patches) const;
  void sample(const cv::Mat& smoothed, const cv::Point& origin, Patch* patch) const;
  cv::Mat reducedPart(const cv::Mat& image, cv::Rect* area) const;

  PinholeCamera camera_;
  int reduction_;
  PatchGrid grid_;
  cv::Mat allowed_;
  Smoothing smoothing_;
  cv::Mat twice_smoothed_;
  float image_noise_;
};

}  // namespace ground_scale_vo::direct
