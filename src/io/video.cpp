#include "ground_scale_vo/io/video.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/videoio.hpp>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

class Video : public ImageSource {
 public:
  explicit Video(const std::filesystem::path& file) : name_(file.string()) {
    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);  // silent
    if (!capture_.open(name_, cv::CAP_FFMPEG)) {
      throw DataError(name_ + ": is not a video that OpenCV can read");
    }
    count_ = static_cast<std::size_t>(std::max(0.0, capture_.get(cv::CAP_PROP_FRAME_COUNT)));
  }

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return count_; }
  /// Some formats state a duration only, or a frame rate that is not that of the images. Then the
  /// time of the last image tells.
  bool endsEarly(std::size_t read) const override {
    constexpr double kWhole = 0.95;
    const double declared_ms = 1e3 * static_cast<double>(count_) / capture_.get(cv::CAP_PROP_FPS);
    return read + 2 + count_ / 100 < count_ && last_ms_ + interval_ms_ < kWhole * declared_ms;
  }

  std::optional<StoredImage> next() override {
    StoredImage image;
    if (!capture_.read(image.pixels)) return std::nullopt;
    double ms = capture_.get(cv::CAP_PROP_POS_MSEC);
    // OpenCV 4.6 reports 0 for the images that the decoder holds at the end of the file.
    if (!(ms > 0)) ms = last_ms_ + interval_ms_;
    interval_ms_ = ms - last_ms_;
    last_ms_ = ms;
    image.stamp_ns = std::llround(1e6 * ms);
    return image;
  }

 private:
  const std::string name_;
  cv::VideoCapture capture_;
  std::size_t count_ = 0;
  double last_ms_ = 0, interval_ms_ = 0;
};

}  // namespace

std::unique_ptr<ImageSource> openVideo(const std::filesystem::path& file) {
  return std::make_unique<Video>(file);
}

}  // namespace ground_scale_vo
