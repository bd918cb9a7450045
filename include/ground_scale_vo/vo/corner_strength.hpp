#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo {

/// Smaller eigenvalue of the gradient matrix around each pixel, row by row: Sobel gradients summed
/// over a square of 5 px, as cv::cornerMinEigenVal(image, ..., 5, 3) defines it. The sums are of
/// integers and slide down the image, so they are exact and all they need stays in the cache.
class CornerStrength {
 public:
  static constexpr int kReach = 3;  ///< [px] a pixel this near to the image's edge has no strength

  /// image: 8-bit grey, kept, not copied. first_row: the one that the first call of next gives.
  /// Precondition: kReach <= first_row, and at least 2 kReach columns.
  CornerStrength(const cv::Mat& image, int first_row);

  /// Of the next row, for an image in [0, 1]; as many floats as the image has columns.
  /// Precondition: the row is at least kReach away from the last.
  void next(float* strength);

 private:
  static constexpr int kSide = 5;  ///< [px]
  struct Gradients {
    std::vector<std::int16_t> x, y;
  };
  void addRow(int row);

  const cv::Mat image_;
  int row_;                                        ///< the next one
  std::array<Gradients, kSide> gradients_;         ///< of the last rows; row y in y % kSide
  std::vector<std::int16_t> smooth_, difference_;  ///< of three rows
  std::vector<std::int32_t> xx_, xy_, yy_;  ///< sums of the gradients' products down a column
};

}  // namespace ground_scale_vo
