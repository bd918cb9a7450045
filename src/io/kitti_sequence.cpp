#include "ground_scale_vo/io/kitti_sequence.hpp"

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/input/calibration_check.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "kitti_raw.hpp"

namespace ground_scale_vo {
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

void requirePoseOfEachImage(const fs::path& source, std::size_t poses, std::size_t images) {
  if (poses == images) return;
  throw DataError(source.string() + ": has " + std::to_string(poses) + " ground truth poses for " +
                  std::to_string(images) + " images");
}

std::vector<Eigen::Isometry3d> readOdometryGroundTruth(const fs::path& folder, std::size_t images) {
  const fs::path elsewhere = folder.parent_path().parent_path() / "poses";
  for (const fs::path& file :
       {folder / "poses.txt", elsewhere / (folder.filename().string() + ".txt")}) {
    if (!isThere(file)) continue;
    std::vector<Eigen::Isometry3d> poses = readKittiPoses(file);
    requirePoseOfEachImage(file, poses.size(), images);
    return poses;
  }
  return {};
}

std::vector<double> readGroundTruthHeights(const fs::path& file) {
  if (!isThere(file)) return {};
  const TextFile text(file);
  std::vector<double> heights;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.isComment(i)) continue;
    heights.push_back(text.numbers(i, 4).front());
    if (!(heights.back() > 0)) text.fail(i, "its height is not positive");
  }
  return heights;
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
  const std::size_t heights = ground_truth_heights_.size();
  if (heights > 0 && heights != size()) {
    throw DataError(folder.string() + ": has " + std::to_string(heights) +
                    " ground truth heights for " + std::to_string(size()) + " images");
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
  ground_truth_ = readOdometryGroundTruth(folder, size());
  ground_truth_heights_ = readGroundTruthHeights(folder / "ground.txt");
}

void KittiSequence::readRaw(const fs::path& folder, const std::string& camera) {
  const fs::path images = folder / ("image_" + camera);
  images_ = imageFiles(images / "data");
  setStamps(images / "timestamps.txt");
  if (options_.needs_calibration) {
    const fs::path file = folder.parent_path() / "calib_cam_to_cam.txt";
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
  ground_truth_ = readRawGroundTruth(folder);
  if (!ground_truth_.empty()) requirePoseOfEachImage(folder, ground_truth_.size(), size());
}

/// And the size of the images.
void KittiSequence::setStamps(const fs::path& file) {
  stamps_ns_ = options_.fps > 0 ? constantRate(images_.files.size(), options_.fps)
                                : readImageStamps(file, images_);
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

}  // namespace ground_scale_vo
