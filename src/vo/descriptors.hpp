#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace gsv {

/// A point of one image and the point of another image with the most similar descriptor.
struct DescriptorMatch {
  std::size_t from = 0;
  std::size_t to = 0;
};

/// Binary descriptors (BRIEF, as in ORB but upright) of points of an image at three scales.
class Descriptors {
 public:
  static constexpr int kScales = 3;

  /// mask: of the image's size, 0 where it never shows the scene; empty: none.
  Descriptors(const cv::Mat& image, std::vector<cv::Point2f> points, const cv::Mat& mask = {});

  const std::vector<cv::Point2f>& points() const { return points_; }
  /// Number of differing bits at the pair of scales that fits best.
  int distance(std::size_t i, const Descriptors& other, std::size_t k) const;

 private:
  using Bits = std::array<std::uint64_t, 4>;

  static int differingBits(const Bits& a, const Bits& b);

  std::vector<cv::Point2f> points_;
  /// Descriptor of each point at each scale; empty near the image border and near the mask.
  std::array<std::vector<std::optional<Bits>>, kScales> at_scale_;
};

/// Matches points of two images; bridges rotations and changes of size that Lucas-Kanade tracking
/// cannot. A match is the best in both directions and distinctly better than the second best. near:
/// where each point is searched, within radius_px; empty: in the whole image.
std::vector<DescriptorMatch> matchDescriptors(const Descriptors& from, const Descriptors& to,
                                              const std::vector<cv::Point2f>& near = {},
                                              float radius_px = 0);

/// Predicts where all points of an image are in another one: moves each by the median displacement
/// of the matches nearest to it. Precondition: matches is not empty.
std::vector<cv::Point2f> predictPixelsByMatches(const std::vector<cv::Point2f>& from,
                                                const std::vector<cv::Point2f>& to,
                                                const std::vector<DescriptorMatch>& matches);

}  // namespace gsv
