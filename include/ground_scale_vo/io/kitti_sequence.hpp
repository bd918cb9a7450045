#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// A folder of rectified grey images with calibration, stamps and, where it exists, ground truth.
/// Two layouts are supported:
///  - KITTI odometry: `image_0/NNNNNN.png|jpg`, `calib.txt` (`P0:`), `times.txt` [s], ground truth
///    `poses.txt` beside them or `../../poses/NN.txt`, and `ground.txt` of a rendered one: a line
///    of height [m] and unit normal in camera axes for each image, after lines that begin with #;
///  - KITTI raw synced drive: `image_00/data/N.png|jpg`, `image_00/timestamps.txt`,
///    `../calib_cam_to_cam.txt` (`P_rect_00:`), ground truth from `oxts/data/*.txt` with
///    `../calib_imu_to_velo.txt` and `../calib_velo_to_cam.txt` where all of these exist.
/// Images are numbered 0, 1, 2 ... without a gap. Surplus stamps are ignored. Stamps of raw drives
/// are UTC since the epoch. Ground truth has a pose for each image.
class KittiSequence {
 public:
  /// Throws DataError: no such folder, neither layout, missing or malformed file (names file and
  /// line), fewer stamps than images, stamps that do not increase, gaps in the numbering, or not
  /// one ground truth pose or height per image.
  explicit KittiSequence(const std::filesystem::path& folder);

  const std::string& name() const { return name_; }  ///< the folder's own name
  std::size_t size() const { return images_.size(); }
  const PinholeCamera& camera() const { return camera_; }
  std::int64_t stampNs(std::size_t i) const { return stamps_ns_.at(i); }

  /// 8-bit grey. Throws DataError (unreadable, truncated, another size). Thread safe.
  cv::Mat image(std::size_t i) const;

  /// T_c0_ci [m] of each image; empty when the folder has none. For metrics and bags only.
  const std::vector<Eigen::Isometry3d>& groundTruth() const { return ground_truth_; }
  /// Exact height of the camera above the road [m] of each image; empty when the folder has none.
  /// For metrics only.
  const std::vector<double>& groundTruthHeights() const { return ground_truth_heights_; }

 private:
  std::string name_;
  PinholeCamera camera_;
  std::vector<std::filesystem::path> images_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<Eigen::Isometry3d> ground_truth_;
  std::vector<double> ground_truth_heights_;
};

}  // namespace ground_scale_vo
