#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <future>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/input/stamps.hpp"

namespace gsv {

struct CameraInfo;
class CameraInput;

/// An image as it is stored.
struct StoredImage {
  std::int64_t stamp_ns = 0;
  cv::Mat pixels;        ///< of 8 or 16 bits; empty with an error
  std::string encoding;  ///< of the pixels, for GreyConverter::convert()
  std::string error;     ///< why there are no pixels
  std::string frame_id;  ///< of a message: the name of the camera
  /// That came between the previous image and this one.
  std::vector<std::shared_ptr<const CameraInfo>> camera_infos;
};

/// The images of a drive in their order: a folder, a video, or a topic of a bag.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// For messages: folder, file or topic.
  virtual const std::string& name() const = 0;
  /// Images that the folder or file declares.
  virtual std::size_t count() const = 0;
  /// A stamp of zero is that of an image without one, as in ROS messages.
  virtual bool zeroIsUnset() const { return false; }
  /// Stamps of the first and the last image [ns], where they are known without reading all.
  using Span = std::pair<std::int64_t, std::int64_t>;
  virtual std::optional<Span> span() const { return {}; }
  /// After the last image: whether fewer than count() of them were read.
  virtual bool endsEarly(std::size_t read) const { return read < count(); }
  /// Empty after the last one. Throws DataError when no further image can be read.
  virtual std::optional<StoredImage> next() = 0;
  /// Passes over the next image without decoding it.
  virtual void skip() { next(); }
};

/// Largest share of the images of a drive that may be left out.
constexpr double kMaxLeftOut = 0.25;

/// Reads a drive image by image, by the rules that the nodelets apply to their topics: decoding,
/// grey, size, stamps. Decodes an image while the caller processes the previous one.
class DriveReader {
 public:
  /// A calibration and where it is from, for messages: a file or topic.
  struct Calibration {
    CameraCalibration camera;
    std::string source;
    double fov_deg = 0;  ///< horizontal field of view, instead of `camera`; 0: none
    /// Topic of StoredImage::camera_infos, of which `camera` is the first valid one; empty: they
    /// are not used.
    std::string info_topic = {};
    bool image_is_rectified = false;  ///< readCameraInfo()
  };
  struct Options {
    std::string mask_file;  ///< of the images as they come; empty: none
    double fps = 0;         ///< [Hz] the images have this rate, stamps are not used; 0: stamps
    bool ahead = true;      ///< decode on a second thread
  };
  struct Image {
    std::int64_t stamp_ns = 0;  ///< increases from image to image
    cv::Mat grey;               ///< 8-bit, as it comes; empty: the image cannot be used
    /// Another object than that of the image before: another camera, the odometry starts anew.
    std::shared_ptr<const CameraCalibration> camera;
    double decode_ms = 0;
  };

  /// Reads the first images. Throws DataError: none of them can be decoded, or the calibration or
  /// the mask is not that of the images.
  DriveReader(std::unique_ptr<ImageSource> source, Calibration calibration, const Options& options);
  ~DriveReader();

  const std::string& name() const { return source_->name(); }
  std::size_t count() const { return source_->count(); }  ///< approximate for a video
  /// ImageSource::span(); empty for stamps that are replaced or do not increase.
  std::optional<ImageSource::Span> span() const;
  /// Of the first images as they come, with their size; and their mask, which may be empty.
  const CameraCalibration& camera() const { return *camera_; }
  const cv::Mat& mask() const;

  /// Every image of the source in order, also those that cannot be used. Empty after the last one.
  /// Throws DataError when the stamps of the first images are unusable.
  std::optional<Image> next();
  /// The next one that can be used, for users of a single camera: throws DataError when another
  /// camera follows.
  std::optional<Image> nextOfCamera();

  /// Some images of the drive as they come, instead of next(): those with these numbers (from 0,
  /// ascending), in grey; an empty one where it cannot be decoded. The others are not decoded.
  std::vector<cv::Mat> imagesAt(const std::vector<std::size_t>& numbers);

  /// Adds a sentence to warnings().
  void warn(const std::string& sentence) { sentences_.push_back(sentence); }
  std::size_t read() const { return read_; }
  std::size_t used() const { return used_; }
  /// What went wrong so far: one sentence for each kind, with the number of images.
  std::vector<std::string> warnings() const;
  /// After the last image: why the result is not that of the whole drive, in one sentence, or
  /// empty. An image is damaged, the file ends early, or more than a quarter of the images are not
  /// used.
  std::string failure() const;

 private:
  struct Stored {
    std::optional<StoredImage> image;  ///< empty: the end, because of the error if there is one
    std::string error;
    double decode_ms = 0;
  };
  struct Entry {
    Image image;
    bool is_decided = false;  ///< whether the image is used
  };
  using EntryPtr = std::shared_ptr<Entry>;
  struct Problem {
    std::size_t images = 0;
    std::string first;  ///< reason
  };

  void startLoading();
  Stored load();
  void open(const cv::Size& size);
  void useCameraInfos(const StoredImage& image);
  void add(const Stored& stored);
  void end(const std::string& error);
  void use(const EntryPtr& entry, bool starts_again);
  void decideFirst(bool is_used);
  void loseOldestWaiting(const std::string& reason);
  void lose(const std::string& kind, const std::string& reason);
  void requireUsableStamps() const;
  std::int64_t continued(std::int64_t stamp_ns, bool starts_again);

  const std::unique_ptr<ImageSource> source_;
  const Calibration calibration_;
  const Options options_;
  std::future<Stored> loading_;
  std::deque<Stored> first_;  ///< read by the constructor
  std::unique_ptr<CameraInput> input_;
  std::shared_ptr<const CameraCalibration> camera_;  ///< of the first images
  /// Sentences: the first camera_info that is refused, the first change of the camera; or empty.
  std::string info_error_, camera_change_;
  StampFilter stamp_filter_;
  std::deque<EntryPtr> entries_;  ///< not yet returned
  std::deque<EntryPtr> waiting_;  ///< those in stamp_filter_
  EntryPtr first_used_;           ///< the first image, while it waits for the second
  bool has_first_ = false, is_at_end_ = false;
  std::int64_t offset_ns_ = 0, last_stamp_ns_ = 0, interval_ns_ = 0;
  std::size_t read_ = 0, used_ = 0, wrong_stamps_ = 0, restarts_ = 0;
  std::map<std::string, Problem> problems_;  ///< by kind
  std::string end_error_;                    ///< why no further image can be read
  std::vector<std::string> sentences_;       ///< of warn()
};

/// What the commands accept as a drive, and their options.
struct DriveInput {
  std::string path;          ///< KITTI folder, folder of images with times.txt, or video
  std::string camera_file;   ///< calibration; empty: that of the KITTI folder
  double fov_deg = 0;        ///< instead of a calibration: DriveReader::Calibration
  bool unrectified = false;  ///< KITTI raw drive before rectification
  DriveReader::Options options;
};
struct GroundTruth {
  std::vector<Eigen::Isometry3d> poses;  ///< KittiSequence::groundTruth()
  std::vector<double> heights;
};

/// Throws DataError that says what to do when the path is that of a bag or another recording.
void requireNoBag(const std::filesystem::path& path);

/// Throws DataError, and OptionError: a calibration is missing.
std::unique_ptr<DriveReader> openDrive(const DriveInput& input, GroundTruth* truth = nullptr);

}  // namespace gsv
