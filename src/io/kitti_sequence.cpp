#include "ground_scale_vo/io/kitti_sequence.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

/// The first of these cameras that has a folder image_<camera>; empty: none.
std::string firstCamera(const fs::path& folder, std::initializer_list<const char*> cameras) {
  for (const char* camera : cameras) {
    if (fs::is_directory(folder / (std::string("image_") + camera))) return camera;
  }
  return {};
}

std::string odometryCamera(const fs::path& folder) {
  return firstCamera(folder, {"0", "1", "2", "3"});
}

std::string rawCamera(const fs::path& folder) {
  return firstCamera(folder, {"00", "01", "02", "03"});
}

/// The stamp nearest to each image's; empty: one is more than 10 ms away. stamps: ascending.
std::optional<std::vector<std::size_t>> nearest(const std::vector<std::int64_t>& stamps,
                                                const std::vector<std::int64_t>& images) {
  constexpr std::int64_t kMaxDistance = 10'000'000;  // [ns]
  std::vector<std::size_t> result;
  for (const std::int64_t image : images) {
    const auto after = std::lower_bound(stamps.begin(), stamps.end(), image);
    const bool is_before = after == stamps.end() ||
                           (after != stamps.begin() && image - *std::prev(after) < *after - image);
    const auto best = is_before ? std::prev(after) : after;
    if (std::abs(*best - image) > kMaxDistance) return std::nullopt;
    result.push_back(static_cast<std::size_t>(best - stamps.begin()));
  }
  return result;
}

/// Those of the images. Throws DataError.
template <typename T>
std::vector<T> selected(const std::vector<T>& all,
                        const std::optional<std::vector<std::size_t>>& lines,
                        const fs::path& source, std::size_t images) {
  if (!lines) {
    throw DataError(source.string() + ": has " + std::to_string(all.size()) + " for " +
                    std::to_string(images) + " images");
  }
  std::vector<T> result;
  for (const std::size_t line : *lines) result.push_back(all[line]);
  return result;
}

/// Empty: there is none.
fs::path odometryGroundTruth(const fs::path& folder) {
  const fs::path elsewhere = folder.parent_path().parent_path() / "poses";
  for (const fs::path& file :
       {folder / "poses.txt", elsewhere / (folder.filename().string() + ".txt")}) {
    if (isThere(file)) return file;
  }
  return {};
}

std::vector<double> readGroundTruthHeights(const fs::path& file) {
  const TextFile text(file);
  std::vector<double> heights;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.isComment(i)) continue;
    heights.push_back(text.numbers(i, 4).front());
    if (!(heights.back() > 0)) text.fail(i, "its height is not positive");
  }
  return heights;
}

/// A transform of a KITTI raw calibration file: the rotation after rotation_key and the translation
/// after translation_key, which may be empty for zero.
Eigen::Isometry3d readTransform(const fs::path& file, const std::string& rotation_key,
                                const std::string& translation_key) {
  const TextFile text(file);
  const std::size_t line = text.lineOf(rotation_key);
  const std::vector<double> r = text.numbers(line, 9, 1);
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  if (!translation_key.empty()) {
    t = Eigen::Map<const Eigen::Vector3d>(text.numbers(text.lineOf(translation_key), 3, 1).data());
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(r.data());
  const auto transform = rigidTransform(R, t);
  if (!transform) text.fail(line, rotation_key + " is not a rotation");
  return *transform;
}

/// T_w_imu [m] of the GPS/IMU: a Mercator projection that is true to scale at the first latitude.
std::vector<Eigen::Isometry3d> readOxts(const fs::path& folder) {
  constexpr double kEarthRadius = 6378137.0;  // [m], WGS 84 equator
  std::vector<Eigen::Isometry3d> poses;
  double scale = 0;
  for (const fs::path& file : numberedFiles(folder, {".txt"}).files) {
    const TextFile text(file);
    const std::vector<double> v = text.numbers(0, 30);
    const double latitude = v[0], longitude = v[1], altitude = v[2];
    if (std::abs(latitude) >= 90.0) text.fail(0, "its latitude is not between -90 and 90 degrees");
    if (poses.empty()) scale = std::cos(latitude * kRadiansPerDegree);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() << scale * kEarthRadius * longitude * kRadiansPerDegree,
        scale * kEarthRadius * std::log(std::tan((90.0 + latitude) * kRadiansPerDegree / 2.0)),
        altitude;
    T.linear() = (Eigen::AngleAxisd(v[5], Eigen::Vector3d::UnitZ()) *
                  Eigen::AngleAxisd(v[4], Eigen::Vector3d::UnitY()) *
                  Eigen::AngleAxisd(v[3], Eigen::Vector3d::UnitX()))
                     .toRotationMatrix();
    poses.push_back(T);
  }
  return poses;
}

/// T_w_c [m] at the GPS/IMU readings; empty unless these and the calibration from the GPS/IMU to
/// the camera exist.
std::vector<Eigen::Isometry3d> readRawGroundTruth(const fs::path& folder) {
  const fs::path oxts = folder / "oxts" / "data";
  const fs::path camera_calibration = folder.parent_path() / "calib_cam_to_cam.txt";
  const fs::path imu_calibration = folder.parent_path() / "calib_imu_to_velo.txt";
  const fs::path velo_calibration = folder.parent_path() / "calib_velo_to_cam.txt";
  if (!isThere(oxts) || !isThere(imu_calibration) || !isThere(velo_calibration)) return {};
  const Eigen::Isometry3d T_c_imu = readTransform(camera_calibration, "R_rect_00:", "") *
                                    readTransform(velo_calibration, "R:", "T:") *
                                    readTransform(imu_calibration, "R:", "T:");
  std::vector<Eigen::Isometry3d> poses = readOxts(oxts);
  for (Eigen::Isometry3d& pose : poses) pose = pose * T_c_imu.inverse();
  return poses;
}

}  // namespace

bool KittiSequence::isThere(const fs::path& folder) {
  return !odometryCamera(folder).empty() || !rawCamera(folder).empty();
}

KittiSequence::KittiSequence(const fs::path& folder_as_given, const Options& options) try
    : options_(options) {
  fs::path folder = fs::absolute(folder_as_given).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  name_ = folder.filename().string();
  if (!fs::is_directory(folder)) throw DataError(folder.string() + ": no such folder");
  const std::string camera = odometryCamera(folder), raw_camera = rawCamera(folder);
  if (!camera.empty()) {
    readOdometry(folder, camera);
  } else if (!raw_camera.empty()) {
    readRaw(folder, raw_camera);
  } else {
    throw DataError(folder.string() + ": has neither image_0 (KITTI odometry) nor image_00/data " +
                    "(KITTI raw)");
  }
  if (!images_.warning.empty()) warnings_.push_back(images_.warning);
  try {
    readGroundTruth(folder);
  } catch (const DataError& error) {
    ground_truth_.clear();
    ground_truth_heights_.clear();
    warnings_.push_back(std::string("ground truth is not used: ") + error.what());
  }
} catch (const fs::filesystem_error& error) {
  throw DataError(error.path1().string() + ": " + error.code().message());
}

void KittiSequence::readOdometry(const fs::path& folder, const std::string& camera) {
  images_ = imageFiles(folder / ("image_" + camera));
  if (options_.needs_calibration) {
    const fs::path file = folder / "calib.txt";
    calibration_ = readKittiProjection(file, "P" + camera + ":");
    calibration_source_ = file.string() + " (P" + camera + ")";
  }
  setStamps(folder / "times.txt");
}

void KittiSequence::readRaw(const fs::path& folder, const std::string& camera) {
  const fs::path images = folder / ("image_" + camera);
  const bool is_360 = fs::is_directory(images / "data_rect");
  images_ = imageFiles(images / (is_360 ? "data_rect" : "data"));
  setStamps(images / "timestamps.txt");
  if (options_.needs_calibration) {
    const fs::path file =
        is_360 ? folder.parent_path().parent_path() / "calibration" / "perspective.txt"
               : folder.parent_path() / "calib_cam_to_cam.txt";
    calibration_ = readKittiRawCamera(file, camera, !options_.unrectified);
    calibration_source_ =
        file.string() + (options_.unrectified ? " (K_" : " (P_rect_") + camera + ")";
    const auto isSizeOf = [this](const CameraCalibration& calibration) {
      return size_ == cv::Size(calibration.width, calibration.height);
    };
    if (!options_.unrectified && calibration_.hasSize() && !isSizeOf(calibration_) &&
        isSizeOf(readKittiRawCamera(file, camera, false))) {
      throw DataError(folder.string() + ": the images are not rectified (" +
                      sizeText(size_.width, size_.height) + "); --unrectified uses K_" + camera +
                      " and D_" + camera + " of " + file.string());
    }
  }
}

/// Throws DataError.
void KittiSequence::readGroundTruth(const fs::path& folder) {
  const bool is_raw = odometryCamera(folder).empty();
  const fs::path poses = is_raw ? folder / "oxts" : odometryGroundTruth(folder);
  if (!poses.empty()) {
    const auto all = is_raw ? readRawGroundTruth(folder) : readKittiPoses(poses);
    if (all.empty()) return;
    auto lines = linesOf(images_, all.size());
    // The readings may have another rate than the images.
    if (const fs::path times = poses / "timestamps.txt"; is_raw && all.size() != size()) {
      lines = gsv::isThere(times) && !stamps_ns_.empty() ? nearest(readStamps(times), stamps_ns_)
                                                         : std::nullopt;
    }
    ground_truth_ = selected(all, lines, poses, size());
    const Eigen::Isometry3d T_first_w = ground_truth_.front().inverse();
    for (Eigen::Isometry3d& pose : ground_truth_) pose = T_first_w * pose;
  }
  if (const fs::path heights = folder / "ground.txt"; gsv::isThere(heights)) {
    const std::vector<double> all = readGroundTruthHeights(heights);
    ground_truth_heights_ = selected(all, linesOf(images_, all.size()), heights, size());
  }
}

/// And the size of the images.
void KittiSequence::setStamps(const fs::path& file) {
  if (options_.needs_stamps) stamps_ns_ = readImageStamps(file, images_);
  size_ = readPixels(images_.files.front()).size();
}

PinholeCamera KittiSequence::camera() const {
  checkCalibration(calibration_, calibration_source_, size_);
  PinholeCamera camera = pinholeOf(calibration_);
  camera.width = size_.width;
  camera.height = size_.height;
  return camera;
}

cv::Mat KittiSequence::image(std::size_t i) const {
  const fs::path& file = images_.files.at(i);
  cv::Mat image = readGreyImage(file);
  if (image.size() != size_) {
    throw DataError(file.string() + ": is " + sizeText(image.cols, image.rows) + " instead of " +
                    sizeText(size_.width, size_.height));
  }
  return image;
}

}  // namespace gsv
