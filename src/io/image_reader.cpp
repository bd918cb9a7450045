#include "ground_scale_vo/io/image_reader.hpp"

#include <utility>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/io/process_usage.hpp"

namespace ground_scale_vo {

ImageReader::ImageReader(std::size_t size, Read read, bool ahead)
    : size_(size),
      read_(std::move(read)),
      policy_(ahead ? std::launch::async : std::launch::deferred) {
  start();
}

void ImageReader::start() {
  if (index_ >= size_) return;
  pending_ = std::async(policy_, [this, i = index_] {
    const Stopwatch watch;
    const double cpu_begin = threadCpuMs();
    Image result;
    result.image = read_(i);
    result.decode_cpu_ms = threadCpuMs() - cpu_begin;
    result.decode_ms = watch.ms();
    return result;
  });
}

ImageReader::Image ImageReader::next() {
  Image image = pending_.get();
  ++index_;
  start();
  return image;
}

}  // namespace ground_scale_vo
