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

/// What a corner is, and where one is searched.
struct CornerCriteria {
  int cell_px;          ///< side of the cells of a grid; each holds at most one corner
  int border_px;        ///< without cells, at least CornerStrength::kReach + 1
  int half_patch_px;    ///< around the corner, for min_ratio
  double min_strength;  ///< see CornerStrength
  /// Smaller over larger eigenvalue of the gradient matrix of the patch: 0 on a straight edge.
  double min_ratio;
};

/// The strongest corner of each cell without one of `occupied` [px], at least half a cell away from
/// these and from each other. image: 8-bit grey. allowed: of its size, 0 at pixels that cannot be
/// corners; empty: all can.
std::vector<cv::Point2f> detectCorners(const cv::Mat& image, const cv::Mat& allowed,
                                       const std::vector<cv::Point2f>& occupied,
                                       const CornerCriteria& criteria);

}  // namespace ground_scale_vo
