#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/io/image_folder.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

class Files : public ImageSource {
 public:
  /// stamps_ns: of each file, or empty.
  Files(std::string name, std::vector<fs::path> files, std::vector<std::int64_t> stamps_ns)
      : name_(std::move(name)), files_(std::move(files)), stamps_ns_(std::move(stamps_ns)) {}

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return files_.size(); }
  /// Among times since 1970.
  bool zeroIsUnset() const override {
    return !stamps_ns_.empty() && secondsBetween(0, stamps_ns_.back()) > kEarliestEpoch;
  }
  std::optional<Span> span() const override {
    if (stamps_ns_.empty()) return std::nullopt;
    return Span{stamps_ns_.front(), stamps_ns_.back()};
  }
  std::optional<StoredImage> next() override {
    if (index_ == files_.size()) return std::nullopt;
    StoredImage image;
    if (!stamps_ns_.empty()) image.stamp_ns = stamps_ns_[index_];
    try {
      image.pixels = readPixels(files_[index_]);
    } catch (const DataError& error) {
      image.error = error.what();
    }
    ++index_;
    return image;
  }
  void skip() override { index_ = std::min(index_ + 1, files_.size()); }

 private:
  const std::string name_;
  const std::vector<fs::path> files_;
  const std::vector<std::int64_t> stamps_ns_;
  std::size_t index_ = 0;
};

/// Whether a file is MP4 (ISO 14496-12) and all of its boxes are in it. What is not read of such a
/// file is hidden by its edit list, as after cutting without encoding.
bool isWholeMp4(const fs::path& file) {
  const std::uint64_t bytes = fs::file_size(file);
  std::ifstream stream(file, std::ios::binary);
  std::uint64_t at = 0;
  while (at < bytes) {
    std::array<unsigned char, 16> head{};
    stream.seekg(static_cast<std::streamoff>(at));
    stream.read(reinterpret_cast<char*>(head.data()), head.size());
    if (at == 0 && std::memcmp(&head[4], "ftyp", 4) != 0) return false;
    const auto number = [&](std::size_t i, std::size_t end) {
      std::uint64_t n = 0;
      for (; i < end; ++i) n = n << 8 | head[i];
      return n;
    };
    const std::uint64_t size = number(0, 4) == 1 ? number(8, 16) : number(0, 4);
    if (size == 0) return true;  // up to the end of the file
    if (size < 8 || size > bytes - at) return false;
    at += size;
  }
  return true;
}

/// Properties that OpenCV 4.2 does not have: the angle [degrees] by which the metadata turn the
/// images clockwise, and whether OpenCV turns them.
constexpr int kOrientation = 48, kTurnsImages = 49;

/// As FFmpeg decodes it: grey, turned as its metadata say. Stamps are those of the video; phones
/// record with a variable rate.
class Video : public ImageSource {
 public:
  explicit Video(const std::filesystem::path& file) : name_(file.string()) {
    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);  // silent
    if (!capture_.open(name_, cv::CAP_FFMPEG)) {
      throw DataError(name_ + ": is not a video that OpenCV can read");
    }
    capture_.set(kTurnsImages, 0);
    const auto turns = std::lround(capture_.get(kOrientation) / 90);
    // OpenCV 4.6 has the angle with the opposite sign.
    const bool is_negative = cv::getVersionMajor() == 4 && cv::getVersionMinor() == 6;
    quarter_turns_ = ((is_negative ? -turns : turns) % 4 + 4) % 4;
    count_ = static_cast<std::size_t>(std::max(0.0, capture_.get(cv::CAP_PROP_FRAME_COUNT)));
  }

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return count_; }
  /// Some formats state a duration only, or a frame rate that is not that of the images. Then the
  /// time of the last image tells.
  bool endsEarly(std::size_t read) const override {
    constexpr double kWhole = 0.95;
    const double declared_ms = 1e3 * static_cast<double>(count_) / capture_.get(cv::CAP_PROP_FPS);
    return read + 2 + count_ / 100 < count_ && last_ms_ + interval_ms_ < kWhole * declared_ms &&
           !isWholeMp4(name_);
  }

  std::optional<StoredImage> next() override {
    StoredImage image;
    if (!capture_.read(image.pixels)) return std::nullopt;
    if (quarter_turns_ > 0) {
      cv::rotate(image.pixels, image.pixels, static_cast<int>(quarter_turns_) - 1);
    }
    double ms = capture_.get(cv::CAP_PROP_POS_MSEC);
    // OpenCV 4.6 reports 0 for the images that the decoder holds at the end of the file.
    if (!(ms > 0)) ms = last_ms_ + interval_ms_;
    interval_ms_ = ms - last_ms_;
    last_ms_ = ms;
    image.stamp_ns = std::llround(1e6 * ms);
    return image;
  }
  void skip() override { capture_.grab(); }

 private:
  const std::string name_;
  cv::VideoCapture capture_;
  std::size_t count_ = 0;
  long quarter_turns_ = 0;  ///< clockwise
  double last_ms_ = 0, interval_ms_ = 0;
};

/// Where a folder other than KITTI's has its images, their stamps and their calibration.
struct Layout {
  const char *images, *stamps, *calibration;
};

Layout layoutOf(const fs::path& folder) {
  constexpr Layout kLayouts[] = {
      {"mav0/cam0/data", "mav0/cam0/data.csv", "mav0/cam0/sensor.yaml"},  // EuRoC
      {"cam0/data", "cam0/data.csv", "cam0/sensor.yaml"},                 // EuRoC: mav0
      {"data", "data.csv", "sensor.yaml"},                                // EuRoC: mav0/cam0
      {"frames/rgb/Camera_0", "times.txt", "intrinsic.txt"}};             // Virtual KITTI 2
  for (const Layout& layout : kLayouts) {
    if (fs::is_directory(folder / layout.images)) return layout;
  }
  return {"", "times.txt", ""};
}

std::unique_ptr<ImageSource> openFolder(const fs::path& folder, bool needs_stamps,
                                        std::vector<std::string>* warnings) {
  const Layout layout = layoutOf(folder);
  const NumberedFiles images = imageFiles(folder / layout.images);
  if (!images.warning.empty()) warnings->push_back(images.warning);
  if (!needs_stamps) {
    return std::make_unique<Files>(folder.string(), images.files, std::vector<std::int64_t>());
  }
  const fs::path times = folder / layout.stamps;
  if (!isThere(times)) {
    throw DataError(folder.string() + ": has no " + layout.stamps +
                    " with a time for each image; if they come at a constant rate, state it with "
                    "--fps N");
  }
  return std::make_unique<Files>(folder.string(), images.files, readImageStamps(times, images));
}

}  // namespace

void requireNoBag(const fs::path& path) {
  const std::string type = path.extension().string();
  if (type == ".active") {
    throw DataError(path.string() +
                    ": is a bag whose recording was interrupted; `rosbag reindex` "
                    "makes it readable");
  }
  if (type == ".mcap" || type == ".db3") {
    throw DataError(path.string() +
                    ": is no bag of ROS 1: convert it, for example with "
                    "rosbags-convert (pip install rosbags)");
  }
  if (type == ".bag") {
    throw DataError(path.string() +
                    ": a bag is read by `ground_scale_vo run`, scripts/demo --bag "
                    "and kitti.launch");
  }
}

std::unique_ptr<DriveReader> openDrive(const DriveInput& input, GroundTruth* truth) {
  const fs::path path = input.path;
  const bool needs_stamps = input.options.fps == 0;
  if (!isThere(path)) throw DataError(path.string() + ": no such file or folder");
  requireNoBag(path);
  DriveReader::Calibration calibration;
  fs::path camera_file = input.camera_file;
  calibration.fov_deg = input.fov_deg;
  const bool needs_calibration = camera_file.empty() && input.fov_deg == 0;
  const bool is_kitti = fs::is_directory(path) && KittiSequence::isThere(path);
  if (needs_calibration && !is_kitti) {
    camera_file = path / layoutOf(path).calibration;
    if (!fs::is_regular_file(camera_file)) {
      throw OptionError("--camera FILE is missing (or --fov DEGREES): " + path.string() +
                        " does not contain its calibration, as a KITTI folder does");
    }
  }
  if (!camera_file.empty()) calibration = {readCameraFile(camera_file), camera_file};
  std::unique_ptr<ImageSource> source;
  std::vector<std::string> warnings;
  if (is_kitti) {
    const KittiSequence sequence(path, {input.unrectified, needs_calibration, needs_stamps});
    source = std::make_unique<Files>(path.string(), sequence.files(), sequence.stamps());
    warnings = sequence.warnings();
    if (needs_calibration) {
      calibration = {sequence.calibration(), sequence.calibrationSource()};
    }
    if (truth) *truth = {sequence.groundTruth(), sequence.groundTruthHeights()};
  } else {
    source = fs::is_directory(path) ? openFolder(path, needs_stamps, &warnings)
                                    : std::make_unique<Video>(path);
  }
  auto reader = std::make_unique<DriveReader>(std::move(source), calibration, input.options);
  for (const std::string& warning : warnings) reader->warn(warning);
  return reader;
}

}  // namespace gsv
