#include "ground_scale_vo/io/kitti_sequence.hpp"

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/image_file.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "kitti_raw.hpp"
#include "numbered_files.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

/// The camera from the 3x4 projection matrix after `key`, row by row.
PinholeCamera readCamera(const fs::path& file, const std::string& key, const cv::Size& size) {
  const TextFile text(file);
  const std::size_t line = text.lineOf(key);
  const std::vector<double> p = text.numbers(line, 12, 1);
  const bool is_pinhole = p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1;
  if (!is_pinhole) text.fail(line, key + " is not the projection of a rectified pinhole camera");
  PinholeCamera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = p[0];
  camera.fy = p[5];
  camera.cx = p[2];
  camera.cy = p[6];
  try {
    camera.validate();
  } catch (const OptionError& error) {
    text.fail(line, error.what());
  }
  return camera;
}

std::int64_t readSeconds(const TextFile& text, std::size_t i) {
  text.numbers(i, 1);
  return text.nanoseconds(i);
}

/// The stamp of image i is in line i. A folder may hold only the first images of a
/// sequence; further lines are checked and ignored.
std::vector<std::int64_t> readStamps(const fs::path& file, std::size_t images,
                                     std::int64_t (*read)(const TextFile&, std::size_t)) {
  const TextFile text(file);
  if (text.size() < images) {
    throw DataError(file.string() + ": has " + std::to_string(text.size()) + " stamps for " +
                    std::to_string(images) + " images");
  }
  std::vector<std::int64_t> stamps;
  for (std::size_t i = 0; i < text.size(); ++i) {
    stamps.push_back(read(text, i));
    if (i > 0 && stamps[i] <= stamps[i - 1]) text.fail(i, "its stamp is not later than the last");
  }
  stamps.resize(images);
  return stamps;
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

KittiSequence::KittiSequence(const fs::path& folder_as_given) try {
  fs::path folder = fs::absolute(folder_as_given).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  name_ = folder.filename().string();
  if (!fs::is_directory(folder)) throw DataError(folder.string() + ": no such folder");

  const bool is_odometry = fs::is_directory(folder / "image_0");
  const bool is_raw = fs::is_directory(folder / "image_00" / "data");
  if (!is_odometry && !is_raw) {
    throw DataError(folder.string() + ": has neither image_0 (KITTI odometry) nor image_00/data " +
                    "(KITTI raw)");
  }
  images_ = is_odometry ? numberedFiles(folder / "image_0", "png|jpg")
                        : numberedFiles(folder / "image_00" / "data", "png|jpg");
  const cv::Size size = readGreyImage(images_.front()).size();
  if (is_odometry) {
    camera_ = readCamera(folder / "calib.txt", "P0:", size);
    stamps_ns_ = readStamps(folder / "times.txt", images_.size(), readSeconds);
    ground_truth_ = readOdometryGroundTruth(folder, images_.size());
    ground_truth_heights_ = readGroundTruthHeights(folder / "ground.txt");
  } else {
    camera_ = readCamera(folder.parent_path() / "calib_cam_to_cam.txt", "P_rect_00:", size);
    stamps_ns_ = readStamps(folder / "image_00" / "timestamps.txt", images_.size(), readUtc);
    ground_truth_ = readRawGroundTruth(folder);
    if (!ground_truth_.empty())
      requirePoseOfEachImage(folder, ground_truth_.size(), images_.size());
  }
  if (!ground_truth_heights_.empty() && ground_truth_heights_.size() != images_.size()) {
    throw DataError(folder.string() + ": has " + std::to_string(ground_truth_heights_.size()) +
                    " ground truth heights for " + std::to_string(images_.size()) + " images");
  }
} catch (const fs::filesystem_error& error) {
  throw DataError(error.path1().string() + ": " + error.code().message());
}

cv::Mat KittiSequence::image(std::size_t i) const {
  const fs::path& file = images_.at(i);
  cv::Mat image = readGreyImage(file);
  if (image.cols != camera_.width || image.rows != camera_.height) {
    throw DataError(file.string() + ": is " + sizeText(image.size()) + " instead of " +
                    sizeText({camera_.width, camera_.height}));
  }
  return image;
}

}  // namespace ground_scale_vo
