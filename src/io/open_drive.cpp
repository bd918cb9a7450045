#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image_file.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/io/image_folder.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/video.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

class Files : public ImageSource {
 public:
  Files(std::string name, std::vector<fs::path> files, std::vector<std::int64_t> stamps_ns)
      : name_(std::move(name)), files_(std::move(files)), stamps_ns_(std::move(stamps_ns)) {}

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return files_.size(); }
  /// Among times since 1970.
  bool zeroIsUnset() const override {
    return !stamps_ns_.empty() && secondsBetween(0, stamps_ns_.back()) > kEarliestEpoch;
  }
  std::optional<StoredImage> next() override {
    if (index_ == files_.size()) return std::nullopt;
    StoredImage image;
    image.stamp_ns = stamps_ns_[index_];
    try {
      image.pixels = readPixels(files_[index_]);
    } catch (const DataError& error) {
      image.error = error.what();
    }
    ++index_;
    return image;
  }

 private:
  const std::string name_;
  const std::vector<fs::path> files_;
  const std::vector<std::int64_t> stamps_ns_;
  std::size_t index_ = 0;
};

std::unique_ptr<ImageSource> openFolder(const fs::path& folder, double fps, std::string* warning) {
  const NumberedFiles images = imageFiles(folder);
  *warning = images.warning;
  const fs::path times = folder / "times.txt";
  if (fps == 0 && !isThere(times)) {
    throw DataError(folder.string() +
                    ": has no times.txt with a time for each image; if they come "
                    "at a constant rate, state it with --fps N");
  }
  return std::make_unique<Files>(
      folder.string(), images.files,
      fps > 0 ? constantRate(images.files.size(), fps) : readImageStamps(times, images));
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
  const double fps = input.options.fps;
  if (!isThere(path)) throw DataError(path.string() + ": no such file or folder");
  requireNoBag(path);
  DriveReader::Calibration calibration;
  if (!input.camera_file.empty()) {
    calibration = {readCameraFile(input.camera_file), input.camera_file};
  }
  calibration.fov_deg = input.fov_deg;
  const bool needs_calibration = input.camera_file.empty() && input.fov_deg == 0;
  std::unique_ptr<ImageSource> source;
  std::string warning;
  if (fs::is_directory(path) && KittiSequence::isThere(path)) {
    const KittiSequence sequence(path, {input.unrectified, needs_calibration, fps});
    std::vector<std::int64_t> stamps_ns;
    for (std::size_t i = 0; i < sequence.size(); ++i) stamps_ns.push_back(sequence.stampNs(i));
    source = std::make_unique<Files>(path.string(), sequence.files(), stamps_ns);
    warning = sequence.warning();
    if (needs_calibration) {
      calibration = {sequence.calibration(), sequence.calibrationSource()};
    }
    if (truth) *truth = {sequence.groundTruth(), sequence.groundTruthHeights()};
  } else {
    if (needs_calibration) {
      throw OptionError("--camera FILE is missing: " + path.string() +
                        " is no KITTI folder, which would contain its calibration");
    }
    source = fs::is_directory(path) ? openFolder(path, fps, &warning) : openVideo(path);
  }
  auto reader = std::make_unique<DriveReader>(std::move(source), calibration, input.options);
  if (!warning.empty()) reader->warn(warning);
  return reader;
}

}  // namespace ground_scale_vo
