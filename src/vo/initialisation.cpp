#include "vo/initialisation.hpp"

#include <utility>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// [features] minimum number of matches for initialisation; more than TwoView needs.
constexpr std::size_t kMinMatches = 100;

/// Share of the first frame's features below which the initialisation restarts.
constexpr double kMinTracked = 0.4;

/// Minimum number of landmarks with depth in a new map.
constexpr std::size_t kMinPoints = kMinMatches / 2;

/// [frames] limits the memory before the first motion: five minutes at 10 Hz.
constexpr std::size_t kMaxFrames = 3000;

std::vector<Eigen::Vector2d> pixelsOf(const std::vector<Feature>& features) {
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(features.size());
  for (const Feature& feature : features) pixels.push_back(feature.atStamp());
  return pixels;
}

}  // namespace

void MapInitialisation::restart(std::int64_t stamp_ns, const std::vector<Feature>& features,
                                const cv::Mat& image) {
  stamps_ns_.clear();
  observations_.clear();
  first_image_ = image;
  addFrame(stamp_ns, features);
}

bool MapInitialisation::canContinueWith(std::size_t found) const {
  if (stamps_ns_.empty() || stamps_ns_.size() > kMaxFrames || found < kMinMatches) return false;
  const std::size_t first = observations_.front().size();
  return static_cast<double>(found) >= kMinTracked * static_cast<double>(first);
}

std::vector<Eigen::Vector2d> MapInitialisation::pixelsInFirst(
    const std::vector<Feature>& found) const {
  std::vector<Eigen::Vector2d> pixels;
  for (const Observation& corner : entriesOf(found, observations_.front())) {
    pixels.push_back(camera_.project(corner.x.homogeneous()));
  }
  return pixels;
}

RelativeRotation MapInitialisation::rotationSinceFirst(const std::vector<Feature>& found) const {
  return estimateRotation(camera_, pixelsInFirst(found), pixelsOf(found));
}

void MapInitialisation::addFrame(std::int64_t stamp_ns, const std::vector<Feature>& found) {
  if (stamps_ns_.size() == 1 && readout_time_ > 0) shiftFirstToStamp(found);
  stamps_ns_.push_back(stamp_ns);
  observations_.push_back(observationsOf(camera_, found));
}

void MapInitialisation::shiftFirstToStamp(const std::vector<Feature>& found) {
  auto corner = observations_.front().begin();
  for (const Feature& feature : found) {
    while (corner->id != feature.id) ++corner;
    const Eigen::Vector2d u = camera_.project(corner->x.homogeneous());
    corner->to_stamp = -readout_time_ * camera_.readoutShare(u.y()) * feature.flow;
    corner->x = camera_.ray(u + corner->to_stamp).head<2>();
  }
}

std::optional<std::vector<StampedPose>> MapInitialisation::tryStartMap(
    const std::vector<Feature>& found, const ImagePyramid& image, Mapping* mapping) {
  const auto motion = estimateMotion(camera_, pixelsInFirst(found), pixelsOf(found));
  if (!motion) return std::nullopt;

  if (makeMap(found, image, *motion, mapping)) {
    if (auto poses = localiseFrames(mapping->map())) {
      stamps_ns_.clear();
      return poses;
    }
  }
  mapping->map().clear();
  return std::nullopt;
}

/// Creates a map of two keyframes and the triangulated inliers, then runs bundle adjustment.
/// Returns false when it fails.
bool MapInitialisation::makeMap(const std::vector<Feature>& found, const ImagePyramid& image,
                                const TwoViewMotion& motion, Mapping* mapping) const {
  std::vector<double> depths;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (motion.inlier[i]) depths.push_back(1 / motion.inverse_depth_1[i]);
  }
  if (depths.size() < kMinPoints) return false;
  const double unit = median(depths);
  Eigen::Isometry3d T_1_2 = motion.T_2_1.inverse();
  T_1_2.translation() /= unit;

  LocalMap& map = mapping->map();
  map.clear();
  map.addKeyframe(Eigen::Isometry3d::Identity(), entriesOf(found, observations_.front()),
                  first_image_);
  map.addKeyframe(T_1_2, observations_.back(), image.image);
  map.keyframes().back().exposure = image.exposure;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!motion.inlier[i]) continue;
    const double inverse_depth = motion.inverse_depth_1[i] * unit;
    map.find(found[i].id)->depth =
        InverseDepth{inverse_depth, inverse_depth};  // initial sigma: 100 %
  }
  return mapping->adjustNow();
}

/// The poses of all frames in the new map. The first and the last are its keyframes. Empty when one
/// of them cannot be localised.
std::optional<std::vector<StampedPose>> MapInitialisation::localiseFrames(
    const LocalMap& map) const {
  std::vector<StampedPose> poses;
  Eigen::Isometry3d predicted = Eigen::Isometry3d::Identity();
  for (std::size_t i = 0; i < stamps_ns_.size(); ++i) {
    if (!observations_[i].empty()) {
      const auto estimate = estimatePose(predicted, pointObservations(map, observations_[i]));
      if (!estimate.ok) return std::nullopt;
      predicted = estimate.T_w_c;
    }
    poses.push_back({stamps_ns_[i], predicted});
  }
  poses.front().T_w_c = Eigen::Isometry3d::Identity();
  poses.back().T_w_c = map.keyframes().back().T_w_c;
  return poses;
}

}  // namespace gsv
