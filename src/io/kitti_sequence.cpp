#include "ground_scale_vo/io/kitti_sequence.hpp"

#include <time.h>

#include <cmath>
#include <ctime>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <regex>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxImageBytes = 256u << 20;
constexpr std::int64_t kMaxPixels = 1 << 27;

/// The files NNN.png and NNN.jpg (or NNN.txt) of a folder in the order of their numbers, which must
/// run 0, 1, 2 ...
std::vector<fs::path> numberedFiles(const fs::path& folder, bool images) {
  const std::regex pattern(images ? "([0-9]{1,18})\\.(png|jpg)" : "([0-9]{1,18})\\.txt");
  std::map<unsigned long long, fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string file_name = entry.path().filename().string();
    std::smatch match;
    if (!std::regex_match(file_name, match, pattern)) continue;
    const auto [other, is_new] = files.emplace(std::stoull(match[1]), entry.path());
    if (!is_new) {
      throw DataError(entry.path().string() + ": has the same number as " +
                      other->second.filename().string());
    }
  }
  if (files.empty()) {
    throw DataError(folder.string() + ": has no " +
                    (images ? "image NNN.png or NNN.jpg" : "file NNN.txt"));
  }
  std::vector<fs::path> ordered;
  for (const auto& [number, file] : files) {
    if (number != ordered.size()) {
      throw DataError(file.string() + ": its number follows a gap, " +
                      std::to_string(ordered.size()) + " is missing");
    }
    ordered.push_back(file);
  }
  return ordered;
}

/// OpenCV fills the missing rows of a truncated JPEG with grey and says so on stderr alone, so the
/// end is looked for here.
bool isWhole(const std::string& bytes) {
  const auto begins = [&](const std::string& s) { return bytes.compare(0, s.size(), s) == 0; };
  const auto ends = [&](const std::string& s) {
    return bytes.size() >= s.size() && bytes.compare(bytes.size() - s.size(), s.size(), s) == 0;
  };
  if (begins("\x89PNG")) return ends(std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12));
  if (begins("\xff\xd8")) return ends("\xff\xd9");
  return false;
}

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

/// What the head of a PNG or JPEG file says of its size; 0x0 when it says nothing. A small file may
/// claim any size, and decoding it would take that much memory.
cv::Size claimedSize(const std::string& bytes) {
  const auto number = [&](std::size_t at, std::size_t length) {
    std::uint32_t value = 0;
    for (std::size_t k = at; k < at + length; ++k) {
      value = value << 8 | static_cast<unsigned char>(bytes[k]);
    }
    return static_cast<int>(value & 0x7fffffffu);
  };
  constexpr std::size_t kPngSize = 16;
  if (bytes[0] == '\x89') {
    return bytes.size() < kPngSize + 8 ? cv::Size()
                                       : cv::Size(number(kPngSize, 4), number(kPngSize + 4, 4));
  }
  // JPEG: segments of a mark, a length and that many bytes; the size stands in a frame's (SOF).
  for (std::size_t at = 2; at + 9 <= bytes.size() && bytes[at] == '\xff';) {
    const int mark = number(at + 1, 1);
    const bool is_frame =
        mark >= 0xc0 && mark <= 0xcf && mark != 0xc4 && mark != 0xc8 && mark != 0xcc;
    if (is_frame) return {number(at + 7, 2), number(at + 5, 2)};
    at += mark == 0xff ? 1 : 2 + static_cast<std::size_t>(number(at + 2, 2));
  }
  return {};
}

cv::Mat readImage(const fs::path& file) {
  const std::string bytes = readFile(file, kMaxImageBytes);
  if (!isWhole(bytes)) throw DataError(file.string() + ": is not a whole PNG or JPEG file");
  const cv::Size size = claimedSize(bytes);
  if (std::int64_t{size.width} * size.height > kMaxPixels) {
    throw DataError(file.string() + ": claims " + sizeText(size) +
                    " pixels, more than are plausible");
  }
  cv::Mat image;
  try {
    const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1,
                         const_cast<char*>(bytes.data()));
    image = cv::imdecode(buffer, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) throw DataError(file.string() + ": cannot be decoded as an image");
  return image;
}

/// The camera from the row-by-row 3x4 projection matrix behind `key`.
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

/// "2011-09-26 13:02:25.964389445" in UTC, whatever the time zone of this machine.
std::optional<std::int64_t> parseUtc(const std::string& text) {
  static const std::regex kPattern(
      "(\\d{4})-(\\d{2})-(\\d{2}) (\\d{2}):(\\d{2}):(\\d{2})\\.(\\d{1,9})\\s*");
  std::smatch match;
  if (!std::regex_match(text, match, kPattern)) return std::nullopt;
  std::tm date{};
  date.tm_year = std::stoi(match[1]) - 1900;
  date.tm_mon = std::stoi(match[2]) - 1;
  date.tm_mday = std::stoi(match[3]);
  date.tm_hour = std::stoi(match[4]);
  date.tm_min = std::stoi(match[5]);
  date.tm_sec = std::stoi(match[6]);
  std::tm normalised = date;
  const std::int64_t seconds = timegm(&normalised);
  const bool exists = normalised.tm_mon == date.tm_mon && normalised.tm_mday == date.tm_mday &&
                      normalised.tm_hour == date.tm_hour && normalised.tm_min == date.tm_min &&
                      normalised.tm_sec == date.tm_sec;
  if (!exists || std::abs(static_cast<double>(seconds)) > kLatestStamp) return std::nullopt;
  std::string nanoseconds = match[7];
  nanoseconds.resize(9, '0');
  return seconds * 1000000000 + std::stoll(nanoseconds);
}

std::int64_t readSeconds(const TextFile& text, std::size_t i) {
  text.numbers(i, 1);
  return text.nanoseconds(i);
}

std::int64_t readUtc(const TextFile& text, std::size_t i) {
  const auto stamp = parseUtc(text.line(i));
  if (!stamp) text.fail(i, "is not a time such as 2011-09-26 13:02:25.964389445");
  return *stamp;
}

/// A line for each image and, in a folder that holds the beginning of a sequence, more: line i is
/// image i, further lines are checked and left out.
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

/// KITTI raw calibration: a rotation behind `rotation_key`, a translation behind `translation_key`
/// (none when empty).
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

/// Poses of the GPS/IMU unit in metres: a Mercator map whose scale is right at the first latitude.
std::vector<Eigen::Isometry3d> readOxts(const fs::path& folder) {
  constexpr double kEarthRadius = 6378137.0;  // [m], WGS 84 equator
  constexpr double kRadians = M_PI / 180.0;
  std::vector<Eigen::Isometry3d> poses;
  double scale = 0;
  for (const fs::path& file : numberedFiles(folder, false)) {
    const TextFile text(file);
    const std::vector<double> v = text.numbers(0, 30);
    const double latitude = v[0], longitude = v[1], altitude = v[2];
    if (std::abs(latitude) >= 90.0) text.fail(0, "its latitude is not between -90 and 90 degrees");
    if (poses.empty()) scale = std::cos(latitude * kRadians);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() << scale * kEarthRadius * longitude * kRadians,
        scale * kEarthRadius * std::log(std::tan((90.0 + latitude) * kRadians / 2.0)), altitude;
    T.linear() = (Eigen::AngleAxisd(v[5], Eigen::Vector3d::UnitZ()) *
                  Eigen::AngleAxisd(v[4], Eigen::Vector3d::UnitY()) *
                  Eigen::AngleAxisd(v[3], Eigen::Vector3d::UnitX()))
                     .toRotationMatrix();
    poses.push_back(T);
  }
  return poses;
}

/// Empty unless the GPS/IMU readings and the way from that unit to the camera are all there.
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
  const Eigen::Isometry3d T_c0_w = T_c_imu * poses.front().inverse();
  for (Eigen::Isometry3d& pose : poses) pose = T_c0_w * pose * T_c_imu.inverse();
  return poses;
}

std::vector<Eigen::Isometry3d> readOdometryGroundTruth(const fs::path& folder) {
  const fs::path elsewhere = folder.parent_path().parent_path() / "poses";
  for (const fs::path& file :
       {folder / "poses.txt", elsewhere / (folder.filename().string() + ".txt")}) {
    if (isThere(file)) return readKittiPoses(file);
  }
  return {};
}

std::vector<double> readTrueHeights(const fs::path& file) {
  if (!isThere(file)) return {};
  const TextFile text(file);
  std::vector<double> heights;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (!text.line(i).empty() && text.line(i).front() == '#') continue;
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
  images_ = is_odometry ? numberedFiles(folder / "image_0", true)
                        : numberedFiles(folder / "image_00" / "data", true);
  const cv::Size size = readImage(images_.front()).size();
  if (is_odometry) {
    camera_ = readCamera(folder / "calib.txt", "P0:", size);
    stamps_ns_ = readStamps(folder / "times.txt", images_.size(), readSeconds);
    ground_truth_ = readOdometryGroundTruth(folder);
    true_heights_ = readTrueHeights(folder / "ground.txt");
  } else {
    camera_ = readCamera(folder.parent_path() / "calib_cam_to_cam.txt", "P_rect_00:", size);
    stamps_ns_ = readStamps(folder / "image_00" / "timestamps.txt", images_.size(), readUtc);
    ground_truth_ = readRawGroundTruth(folder);
  }
  if (!ground_truth_.empty() && ground_truth_.size() != images_.size()) {
    throw DataError(folder.string() + ": has " + std::to_string(ground_truth_.size()) +
                    " true poses for " + std::to_string(images_.size()) + " images");
  }
  if (!true_heights_.empty() && true_heights_.size() != images_.size()) {
    throw DataError(folder.string() + ": has " + std::to_string(true_heights_.size()) +
                    " true heights for " + std::to_string(images_.size()) + " images");
  }
} catch (const fs::filesystem_error& error) {
  throw DataError(error.path1().string() + ": " + error.code().message());
}

cv::Mat KittiSequence::image(std::size_t i) const {
  const fs::path& file = images_.at(i);
  cv::Mat image = readImage(file);
  if (image.cols != camera_.width || image.rows != camera_.height) {
    throw DataError(file.string() + ": is " + sizeText(image.size()) + " instead of " +
                    sizeText({camera_.width, camera_.height}));
  }
  return image;
}

}  // namespace ground_scale_vo
