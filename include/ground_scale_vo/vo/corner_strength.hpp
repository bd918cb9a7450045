#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo {

/// Shi-Tomasi corner strength, row by row: the smaller eigenvalue of the gradient matrix around
/// each pixel, with Sobel gradients summed over a square of 5 px, as in
/// cv::cornerMinEigenVal(image, ..., 5, 3). The running sums are integers, hence exact, and fit
/// into the cache.
class CornerStrength {
 public:
  static constexpr int kReach = 3;  ///< [px] pixels nearer to the image border have strength 0

  /// image: 8-bit grey, shared, not copied. first_row: the row of the first call of next().
  /// Precondition: kReach <= first_row, and at least 2 kReach columns.
  CornerStrength(const cv::Mat& image, int first_row);

  /// Writes the strength of the next row, for grey levels in [0, 1]: one float per image column.
  /// Precondition: the row is at least kReach above the last.
  void next(float* strength);

 private:
  static constexpr int kSide = 5;                ///< [px]
  static constexpr int kStoredRows = kSide + 1;  ///< the window and the row that it leaves
  struct Gradients {
    std::vector<std::int16_t> x, y;
  };
  void addRow(int row);

  const cv::Mat image_;
  int row_;                                        ///< the next one
  std::array<Gradients, kStoredRows> gradients_;   ///< row y at y % kStoredRows
  std::vector<std::int16_t> smooth_, difference_;  ///< of three rows
  std::vector<std::int32_t> xx_, xy_, yy_;  ///< products of the gradients, summed over kSide rows
};

}  // namespace ground_scale_vo
