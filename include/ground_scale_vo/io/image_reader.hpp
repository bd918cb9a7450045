#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Reads images in order, each one while the caller processes the previous one.
class ImageReader {
 public:
  struct Image {
    cv::Mat image;
    double decode_ms = 0;      ///< wall time of read()
    double decode_cpu_ms = 0;  ///< processor time of read()
  };
  using Read = std::function<cv::Mat(std::size_t)>;

  /// read(i) returns image i of `size`. ahead: on a second thread, which uses `read` until the
  /// reader is destroyed; otherwise in next(), on the caller's thread.
  ImageReader(std::size_t size, Read read, bool ahead = true);
  ImageReader(const ImageReader&) = delete;
  ImageReader& operator=(const ImageReader&) = delete;

  /// Returns image 0, 1, 2 ... with each call. Rethrows what read() threw. Precondition: at most
  /// `size` calls.
  Image next();

 private:
  void start();

  const std::size_t size_;
  const Read read_;
  const std::launch policy_;
  std::size_t index_ = 0;  ///< of the pending image
  std::future<Image> pending_;
};

}  // namespace ground_scale_vo
