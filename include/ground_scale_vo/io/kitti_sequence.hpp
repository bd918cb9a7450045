#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// A folder of rectified grey images with calibration, stamps and, where there is one, ground
/// truth. Two layouts are known:
///  - KITTI odometry: `image_0/NNNNNN.png|jpg`, `calib.txt` (`P0:`), `times.txt` [s], ground truth
///    `poses.txt` beside them or `../../poses/NN.txt`, and `ground.txt` of a rendered one: a line
///    of height [m] and unit normal in camera axes for each image, after lines that begin with #;
///  - KITTI raw synced drive: `image_00/data/*.png`, `image_00/timestamps.txt`,
///    `../calib_cam_to_cam.txt` (`P_rect_00:`), ground truth from `oxts/data/*.txt` with
///    `../calib_imu_to_velo.txt` and `../calib_velo_to_cam.txt` where all are there.
/// Images are numbered 0, 1, 2 ... without a gap. Stamps may be more than images (the rest is left
/// out), never fewer; stamps of raw drives are UTC since the epoch. Ground truth has a pose for
/// each image.
class KittiSequence {
 public:
  /// Throws DataError: no such folder, nothing known in it, missing or malformed file (names file
  /// and line), fewer stamps than images, stamps that do not grow, gaps in the numbering, another
  /// number of true poses or heights than images.
  explicit KittiSequence(const std::filesystem::path& folder);

  const std::string& name() const { return name_; }  ///< the folder's own name
  std::size_t size() const { return images_.size(); }
  const PinholeCamera& camera() const { return camera_; }
  std::int64_t stampNs(std::size_t i) const { return stamps_ns_.at(i); }

  /// 8-bit grey. Throws DataError (unreadable, truncated, another size). Thread safe.
  cv::Mat image(std::size_t i) const;

  /// T_c0_ci, [m]; empty when the folder has none. Read by metrics and bag writing alone.
  const std::vector<Eigen::Isometry3d>& groundTruth() const { return ground_truth_; }
  /// Of the camera over the road, exact [m]; empty when the folder has none. Read by metrics alone.
  const std::vector<double>& trueHeights() const { return true_heights_; }

 private:
  std::string name_;
  PinholeCamera camera_;
  std::vector<std::filesystem::path> images_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<Eigen::Isometry3d> ground_truth_;
  std::vector<double> true_heights_;
};

}  // namespace ground_scale_vo
