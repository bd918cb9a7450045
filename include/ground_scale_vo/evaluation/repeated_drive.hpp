#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"

namespace ground_scale_vo {

/// A KITTI sequence played forwards and backwards in turn, with stamps that continue to grow, and
/// with resized images: a long drive of any image size for benchmarks.
class RepeatedDrive {
 public:
  /// passes: over the sequence, at least 1. image_scale: of width and height. Throws DataError.
  RepeatedDrive(const std::string& folder, int passes, double image_scale);

  const std::string& name() const { return sequence_.name(); }
  std::size_t size() const { return order_.size(); }
  const PinholeCamera& camera() const { return camera_; }  ///< of the resized images
  std::int64_t stampNs(std::size_t i) const { return stamps_ns_[i]; }
  cv::Mat image(std::size_t i) const;  ///< as KittiSequence::image()

 private:
  void append(std::size_t image);

  const KittiSequence sequence_;
  const double image_scale_;
  PinholeCamera camera_;
  std::vector<std::size_t> order_;  ///< numbers of the sequence's images
  std::vector<std::int64_t> stamps_ns_;
};

}  // namespace ground_scale_vo
