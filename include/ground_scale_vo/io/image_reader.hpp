#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Gives images in order, each read while the one before it is worked on.
class ImageReader {
 public:
  struct Image {
    cv::Mat image;
    double decode_ms = 0;      ///< wall time of reading it
    double decode_cpu_ms = 0;  ///< processor time of the same
  };
  using Read = std::function<cv::Mat(std::size_t)>;

  /// read(i) gives image i of `size`. ahead: on a second thread, which uses `read` until the reader
  /// is destroyed; otherwise on the caller's, when the image is asked for.
  ImageReader(std::size_t size, Read read, bool ahead = true);
  ImageReader(const ImageReader&) = delete;
  ImageReader& operator=(const ImageReader&) = delete;

  /// The images 0, 1, 2 ... one with each call. Throws what read() threw for it. Precondition: not
  /// more than `size` calls.
  Image next();

 private:
  void start();

  const std::size_t size_;
  const Read read_;
  const std::launch policy_;
  std::size_t index_ = 0;  ///< of the image under way
  std::future<Image> under_way_;
};

}  // namespace ground_scale_vo
