#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace gsv {

/// An image with its Gaussian pyramid, computed once for tracking to it and from it.
struct ImagePyramid {
  cv::Mat image;                ///< 8-bit grey, level 0, own memory
  std::vector<cv::Mat> levels;  ///< each half the size of the one before, with a border in memory
  double exposure = 1;          ///< relative to the map's first image
};

/// Model of the surface on which a patch lies: the direction of its normal in the reference camera.
enum class PatchSurface : std::uint8_t {
  kFrontoParallel,  ///< along z: parallel to the image plane
  kFloor,           ///< along y: road
  kWall             ///< along x: house front, parked car
};

/// A corner that is tracked from image to image. Lists of features are ordered by id.
struct Feature {
  std::uint64_t id = 0;
  /// Number of earlier frames in which it was tracked; a standstill counts as one.
  std::uint32_t age = 0;
  Eigen::Vector2d u = Eigen::Vector2d::Zero();     ///< [px]
  Eigen::Vector2d flow = Eigen::Vector2d::Zero();  ///< since the previous image [px/s]
  /// [px] from u to where the feature would be seen at the stamp; zero with a global shutter.
  Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();
  double to_stamp_sigma = 0;  ///< standard deviation of to_stamp [normalised, z = 1]
  double sigma = 0;           ///< standard deviation of u [normalised, z = 1]
  PatchSurface surface = PatchSurface::kFrontoParallel;  ///< last successful surface hypothesis

  Eigen::Vector2d atStamp() const { return u + to_stamp; }  ///< [px]
};

inline cv::Point2f toCv(const Eigen::Vector2d& u) {
  return {static_cast<float>(u.x()), static_cast<float>(u.y())};
}

/// The image with its grey levels multiplied by gain; for 1 the image itself, not a copy.
inline cv::Mat applyGain(const cv::Mat& image, double gain) {
  if (gain == 1) return image;
  cv::Mat result;
  image.convertTo(result, CV_8U, gain);
  return result;
}

/// Whether u lies inside the image, at least `margin` [px] from its last row and column, which
/// interpolation needs. A negative margin: or so far outside. False for what is not finite.
inline bool isInside(const cv::Mat& image, const cv::Point2f& u, float margin) {
  return u.x >= margin && u.y >= margin && u.x + margin < static_cast<float>(image.cols - 1) &&
         u.y + margin < static_cast<float>(image.rows - 1);
}

/// Whether the square of half side `reach` [px] around u contains a masked pixel (0). mask: as for
/// VisualOdometry, may be empty.
inline bool touchesMask(const cv::Mat& mask, const cv::Point2f& u, int reach) {
  if (mask.empty()) return false;
  const cv::Rect square(cvRound(u.x) - reach, cvRound(u.y) - reach, 2 * reach + 1, 2 * reach + 1);
  const cv::Rect inside = square & cv::Rect({0, 0}, mask.size());
  return cv::countNonZero(mask(inside)) < inside.area();
}

/// The entry of each feature in `list`, which is ordered by id and contains them all.
template <typename Entry>
std::vector<Entry> entriesOf(const std::vector<Feature>& features, const std::vector<Entry>& list) {
  std::vector<Entry> result;
  result.reserve(features.size());
  auto entry = list.begin();
  for (const Feature& feature : features) {
    while (entry->id != feature.id) ++entry;
    result.push_back(*entry);
  }
  return result;
}

}  // namespace gsv
