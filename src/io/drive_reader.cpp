#include "ground_scale_vo/io/drive_reader.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "input/camera_input.hpp"

namespace gsv {
namespace {

constexpr std::int64_t kUsualInterval = 100'000'000;  // [ns] before one is known
/// Images after which unusable stamps are refused.
constexpr std::size_t kStampProbe = 20;
constexpr const char* kWrongStamp = "have a stamp that does not continue the others";
constexpr const char* kDamaged = "cannot be decoded";

/// Without distortion, with square pixels and the principal point in the centre. degrees:
/// horizontal field of view. Throws OptionError.
CameraCalibration ofFieldOfView(double degrees, const cv::Size& size) {
  requireInRange("the field of view [degrees]", degrees, 10, 150);
  const double f = 0.5 * size.width / std::tan(0.5 * kRadiansPerDegree * degrees);
  return {size.width, size.height, f, f, 0.5 * (size.width - 1), 0.5 * (size.height - 1)};
}

}  // namespace

DriveReader::DriveReader(std::unique_ptr<ImageSource> source, Calibration calibration,
                         const Options& options)
    : source_(std::move(source)),
      calibration_(std::move(calibration)),
      options_(options),
      stamp_filter_(
          StampFilter::kDefaultClockJump,
          [this](const std::string& reason) { loseOldestWaiting(reason); },
          source_->zeroIsUnset() && options.fps == 0, StampFilter::kHoldIntervalsOfFiles) {
  startLoading();
  for (;;) {
    Stored stored = load();
    if (!stored.image) {
      if (!stored.error.empty()) throw DataError(stored.error);
      const std::string reason = first_.empty() ? "" : ": " + first_.front().image->error;
      throw DataError(source_->name() + ": has no image that can be decoded" + reason);
    }
    const cv::Size size = stored.image->pixels.size();
    first_.push_back(std::move(stored));
    if (!size.empty()) {
      open(size);
      return;
    }
  }
}

DriveReader::~DriveReader() = default;

std::optional<ImageSource::Span> DriveReader::span() const {
  const auto span = options_.fps > 0 ? std::nullopt : source_->span();
  const bool is_unset = span && source_->zeroIsUnset() && span->first == 0;
  return span && !is_unset && span->first < span->second ? span : std::nullopt;
}

const cv::Mat& DriveReader::mask() const { return input_->mask(); }

void DriveReader::open(const cv::Size& size) {
  CameraCalibration camera =
      calibration_.fov_deg > 0 ? ofFieldOfView(calibration_.fov_deg, size) : calibration_.camera;
  const std::string warning = checkCalibration(camera, calibration_.source, size);
  if (!warning.empty()) warn(warning);
  camera.width = size.width;
  camera.height = size.height;
  try {
    camera.validate();
  } catch (const OptionError& error) {
    throw DataError(calibration_.source + " cannot be used: " + error.what());
  }
  const std::string& mask = options_.mask_file;
  input_ = std::make_unique<CameraInput>(calibration_.image_is_rectified,
                                         mask.empty() ? cv::Mat() : readGreyImage(mask),
                                         "the mask " + mask);
  input_->setCalibration(camera, calibration_.source);
  camera_ = input_->camera();
}

void DriveReader::useCameraInfos(const StoredImage& image) {
  if (calibration_.info_topic.empty()) return;
  for (const auto& info : image.camera_infos) {
    try {
      input_->setCameraInfo(*info, calibration_.info_topic);
    } catch (const DataError& error) {
      if (info_error_.empty()) info_error_ = error.what();
    }
  }
}

void DriveReader::startLoading() {
  const auto policy = options_.ahead ? std::launch::async : std::launch::deferred;
  loading_ = std::async(policy, [this] {
    const Stopwatch watch;
    Stored stored;
    try {
      stored.image = source_->next();
    } catch (const DataError& error) {
      stored.error = error.what();
    }
    stored.decode_ms = watch.ms();
    return stored;
  });
}

DriveReader::Stored DriveReader::load() {
  if (!loading_.valid()) return {};
  Stored stored = loading_.get();
  if (stored.image) startLoading();
  return stored;
}

std::optional<DriveReader::Image> DriveReader::next() {
  while (!is_at_end_ && (entries_.empty() || !entries_.front()->is_decided)) {
    Stored stored;
    if (first_.empty()) {
      stored = load();
    } else {
      stored = std::move(first_.front());
      first_.pop_front();
    }
    if (stored.image) {
      add(stored);
      if (read_ == kStampProbe) requireUsableStamps();
    } else {
      end(stored.error);
    }
  }
  if (entries_.empty()) return std::nullopt;
  const Image image = entries_.front()->image;
  entries_.pop_front();
  if (!image.grey.empty()) ++used_;
  return image;
}

std::vector<cv::Mat> DriveReader::imagesAt(const std::vector<std::size_t>& numbers) {
  std::vector<cv::Mat> images;
  GreyConverter converter;
  std::size_t number = 0;
  for (const std::size_t wanted : numbers) {
    images.emplace_back();
    try {
      std::optional<StoredImage> image;
      for (; number <= wanted; ++number) {
        if (!first_.empty()) {
          image = std::move(first_.front().image);
          first_.pop_front();
        } else if (loading_.valid()) {
          image = loading_.get().image;
        } else if (number == wanted) {
          image = source_->next();
        } else {
          source_->skip();
        }
      }
      if (!image || image->pixels.empty()) continue;
      images.back() = converter.convert(image->pixels, image->encoding);
    } catch (const DataError&) {  // it stays empty
    }
  }
  return images;
}

std::optional<DriveReader::Image> DriveReader::nextOfCamera() {
  std::optional<Image> image = next();
  while (image && image->grey.empty()) image = next();
  if (image && image->camera != camera_) {
    throw DataError(camera_change_ + "; only `ground_scale_vo run` without --smooth follows that");
  }
  return image;
}

void DriveReader::add(const Stored& stored) {
  const std::size_t index = read_++;
  const StoredImage& image = *stored.image;
  useCameraInfos(image);
  const auto entry = entries_.emplace_back(std::make_shared<Entry>());
  entry->image.decode_ms = stored.decode_ms;
  entry->image.stamp_ns = options_.fps > 0 ? stampAtRate(index, options_.fps) : image.stamp_ns;
  entry->is_decided = true;
  try {
    if (image.pixels.empty()) throw DataError(image.error);
    const cv::Size size(input_->camera()->width, input_->camera()->height);
    if (image.pixels.size() != size) {
      return lose(format("have another size than %d x %d", size.width, size.height),
                  format("it has %d x %d", image.pixels.cols, image.pixels.rows));
    }
    entry->image.grey = input_->grey(image.pixels, image.encoding);
  } catch (const DataError& error) {
    return lose(kDamaged, error.what());
  }
  if (!input_->isOfCamera(image.frame_id)) {
    entry->image.grey.release();
    return lose("are of another camera", input_->sourceError(source_->name()));
  }
  entry->image.camera = input_->camera();
  if (entry->image.camera != camera_ && camera_change_.empty()) {
    const std::string before = camera_->describe(), now = entry->image.camera->describe();
    camera_change_ = "the camera changes at image " + std::to_string(index) +
                     (before == now ? " to the frame_id \"" + image.frame_id + "\""
                                    : ", from " + before + " to " + now);
  }
  entry->is_decided = false;
  waiting_.push_back(entry);
  stamp_filter_.add(entry->image.stamp_ns, [this, entry](bool clock_jumped_back) {
    waiting_.pop_front();
    use(entry, clock_jumped_back);
  });
}

void DriveReader::end(const std::string& error) {
  requireUsableStamps();
  is_at_end_ = true;
  end_error_ = error;
  if (first_used_) decideFirst(true);
  // The last image is far from the one before it, and nothing confirms it.
  if (!waiting_.empty()) loseOldestWaiting("it is the last one");
}

/// The first image waits for the next one: if that is earlier, the first stamp is the wrong one.
void DriveReader::use(const EntryPtr& entry, bool starts_again) {
  if (!has_first_) {
    has_first_ = true;
    first_used_ = entry;
  } else if (first_used_) {
    if (starts_again) {
      ++wrong_stamps_;
      lose(kWrongStamp, "the stamp of the first image is later than the next ones");
      last_stamp_ns_ = 0;
    }
    decideFirst(!starts_again);
    starts_again = false;
  }
  entry->image.stamp_ns = continued(entry->image.stamp_ns, starts_again);
  entry->is_decided = entry != first_used_;
}

void DriveReader::decideFirst(bool is_used) {
  if (!is_used) first_used_->image.grey.release();
  first_used_->is_decided = true;
  first_used_.reset();
}

void DriveReader::loseOldestWaiting(const std::string& reason) {
  ++wrong_stamps_;
  lose(kWrongStamp, reason);
  waiting_.front()->image.grey.release();
  waiting_.front()->is_decided = true;
  waiting_.pop_front();
}

/// The stamp of a used image, so that stamps which start again continue the earlier ones.
std::int64_t DriveReader::continued(std::int64_t stamp_ns, bool starts_again) {
  if (starts_again) {
    ++restarts_;
    const std::int64_t interval = interval_ns_ > 0 ? interval_ns_ : kUsualInterval;
    offset_ns_ = last_stamp_ns_ + interval - stamp_ns;
  }
  const std::int64_t result = stamp_ns + offset_ns_;
  if (last_stamp_ns_ > 0 && !starts_again) interval_ns_ = result - last_stamp_ns_;
  last_stamp_ns_ = result;
  return result;
}

void DriveReader::lose(const std::string& kind, const std::string& reason) {
  Problem& problem = problems_[kind];
  if (problem.images++ == 0) problem.first = reason;
}

void DriveReader::requireUsableStamps() const {
  if (wrong_stamps_ == 0) return;
  if (wrong_stamps_ + waiting_.size() + 1 < read_) return;
  throw DataError(source_->name() + ": the images have no usable stamps (" +
                  problems_.begin()->second.first +
                  "); if they come at a constant rate, state it with --fps N");
}

std::vector<std::string> DriveReader::warnings() const {
  std::vector<std::string> sentences = sentences_;
  if (!camera_change_.empty()) sentences.push_back(camera_change_ + ": a new map starts there");
  if (!info_error_.empty()) sentences.push_back(info_error_);
  for (const auto& [kind, problem] : problems_) {
    sentences.push_back(std::to_string(problem.images) + " of " + std::to_string(read_) +
                        " images " + kind + " and are not used, the first one because " +
                        problem.first);
  }
  if (restarts_ > 0) {
    sentences.push_back("the stamps start again " + std::to_string(restarts_) +
                        (restarts_ == 1 ? " time" : " times") +
                        "; they continue after the usual interval, as in joined recordings");
  }
  return sentences;
}

std::string DriveReader::failure() const {
  const std::string of_all = " of " + std::to_string(count()) + " images";
  if (!end_error_.empty()) {
    return end_error_ + "; " + std::to_string(read_) + of_all + " were read";
  }
  if (source_->endsEarly(read_)) {
    return name() + " ends early: only " + std::to_string(read_) + of_all + " can be read";
  }
  if (const auto damaged = problems_.find(kDamaged); damaged != problems_.end()) {
    return name() + " is damaged: " + std::to_string(damaged->second.images) + of_all +
           " cannot be decoded";
  }
  if (std::string error = input_->sourceError(name()); !error.empty()) return error;
  const std::size_t left_out = read_ - used_;
  if (static_cast<double>(left_out) <= kMaxLeftOut * static_cast<double>(read_)) return {};
  const auto most = std::max_element(
      problems_.begin(), problems_.end(),
      [](const auto& a, const auto& b) { return a.second.images < b.second.images; });
  return "only " + std::to_string(used_) + " of " + std::to_string(read_) +
         " images could be used; " +
         (most->first == kWrongStamp
              ? "if they come at a constant rate, --fps N replaces the stamps"
              : std::to_string(most->second.images) + " " + most->first);
}

}  // namespace gsv
