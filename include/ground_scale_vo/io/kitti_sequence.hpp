#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/io/image_folder.hpp"

namespace gsv {

/// A folder of images with calibration, stamps and, where it exists, ground truth. Two layouts are
/// supported:
///  - KITTI odometry: `image_0/NNNNNN.png|jpg` (or image_1, image_2, image_3 where that is
///  missing),
///    `calib.txt` (`P0:` ...), `times.txt`, ground truth `poses.txt` beside them or
///    `../../poses/NN.txt`, and `ground.txt` of a rendered one: a line of height [m] and unit
///    normal in camera axes for each image, after lines that begin with #;
///  - KITTI raw drive: `image_00/data/N.png|jpg` (or image_01 ...), `image_00/timestamps.txt`,
///    `../calib_cam_to_cam.txt` (`P_rect_00:`; of a drive before rectification `K_00:` and
///    `D_00:`), ground truth from `oxts/data/*.txt` with `../calib_imu_to_velo.txt` and
///    `../calib_velo_to_cam.txt` where all of these exist. Also a drive of KITTI-360, with
///    `image_00/data_rect/N.png` and `../../calibration/perspective.txt`, without ground truth.
/// Files and stamps: imageFiles(), readImageStamps(). Stamps of raw drives are UTC since the epoch.
/// Ground truth has a pose for each image, by linesOf() or, of the GPS/IMU, by the stamps in
/// `oxts/timestamps.txt`; if it has not, or cannot be read, a warning says so.
class KittiSequence {
 public:
  /// Whether a folder has one of the layouts.
  static bool isThere(const std::filesystem::path& folder);

  struct Options {
    bool unrectified = false;  ///< the images of a raw drive are those before rectification
    bool needs_calibration = true;
    bool needs_stamps = true;
  };
  /// Throws DataError: no such folder, neither layout, missing or malformed file (names file and
  /// line), or no stamp for each image.
  explicit KittiSequence(const std::filesystem::path& folder) : KittiSequence(folder, Options{}) {}
  KittiSequence(const std::filesystem::path& folder, const Options& options);

  const std::string& name() const { return name_; }  ///< the folder's own name
  std::size_t size() const { return images_.files.size(); }
  /// Calibration of the images as they are, or of another size: checkCalibration().
  const CameraCalibration& calibration() const { return calibration_; }
  const std::string& calibrationSource() const { return calibration_source_; }  ///< file and key
  /// Camera of images without distortion. Throws DataError: the calibration is that of other
  /// images.
  PinholeCamera camera() const;
  std::int64_t stampNs(std::size_t i) const { return stamps_ns_.at(i); }
  const std::vector<std::int64_t>& stamps() const { return stamps_ns_; }  ///< [ns]

  const std::vector<std::filesystem::path>& files() const { return images_.files; }
  /// Sentences about what may be wrong with the images, and why ground truth is not used.
  const std::vector<std::string>& warnings() const { return warnings_; }
  /// 8-bit grey of a single image. Throws DataError (unreadable, truncated, another size than the
  /// first image). Thread safe.
  cv::Mat image(std::size_t i) const;

  /// T_c0_ci [m] of each image; empty when the folder has none. For metrics and bags only.
  const std::vector<Eigen::Isometry3d>& groundTruth() const { return ground_truth_; }
  /// Exact height of the camera above the road [m] of each image; empty when the folder has none.
  /// For metrics only.
  const std::vector<double>& groundTruthHeights() const { return ground_truth_heights_; }

 private:
  void readOdometry(const std::filesystem::path& folder, const std::string& camera);
  void readRaw(const std::filesystem::path& folder, const std::string& camera);
  void setStamps(const std::filesystem::path& file);
  void readGroundTruth(const std::filesystem::path& folder);

  const Options options_;
  std::string name_, calibration_source_;
  CameraCalibration calibration_;
  NumberedFiles images_;
  cv::Size size_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<Eigen::Isometry3d> ground_truth_;
  std::vector<double> ground_truth_heights_;
  std::vector<std::string> warnings_;
};

}  // namespace gsv
