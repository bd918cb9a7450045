#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/patch_alignment.hpp"

namespace ground_scale_vo {

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

/// Whether the square of half side `reach` [px] around u contains a masked pixel (0). mask: as for
/// VisualOdometry, may be empty.
inline bool touchesMask(const cv::Mat& mask, const cv::Point2f& u, int reach) {
  if (mask.empty()) return false;
  const cv::Rect square(cvRound(u.x) - reach, cvRound(u.y) - reach, 2 * reach + 1, 2 * reach + 1);
  const cv::Rect inside = square & cv::Rect({0, 0}, mask.size());
  return cv::countNonZero(mask(inside)) < inside.area();
}

/// The features as observations of a keyframe, in normalised image coordinates.
inline std::vector<LocalMap::Corner> toCorners(const PinholeCamera& camera,
                                               const std::vector<Feature>& features) {
  std::vector<LocalMap::Corner> corners;
  corners.reserve(features.size());
  for (const Feature& feature : features) {
    corners.push_back({feature.id, camera.ray(feature.atStamp()).head<2>(),
                       std::hypot(feature.sigma, feature.to_stamp_sigma), feature.to_stamp});
  }
  return corners;
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

}  // namespace ground_scale_vo
