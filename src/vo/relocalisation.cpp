#include "vo/relocalisation.hpp"

#include <cmath>

#include "ground_scale_vo/common/math.hpp"
#include "vo/pixel_prediction.hpp"

namespace ground_scale_vo {
namespace {

/// [image width] radius of the search around the predicted position of a feature.
constexpr double kSearchRadius = 0.06;
/// [image width] the same around the position predicted with the pose of the first matches.
constexpr double kFineSearchRadius = 0.012;

// Inliers and their share of the matches: of the first search, whose pose the second one verifies,
// and of the second one, whose pose tracking verifies. Wrong matches near the projections of a
// wrong pose have neither similar descriptors nor a common motion.
constexpr int kMinCoarseInliers = 10, kMinFineInliers = 15;
constexpr double kMinCoarseInlierShare = 0.25, kMinFineInlierShare = 0.5;

/// [normalised coordinates] standard deviation of a matched corner: 2 px at a focal length of 718.
constexpr double kMatchSigma = 0.003;

/// Median depth of the features' map points; 0 if there are none.
double medianDepth(const LocalMap& map, const std::vector<Feature>& features,
                   const Eigen::Isometry3d& T_w_c) {
  std::vector<double> depths;
  for (const Feature& feature : features) {
    if (const auto point = map.point(feature.id)) {
      depths.push_back((T_w_c.inverse() * point->p_w).z());
    }
  }
  return depths.empty() ? 0 : median(&depths);
}

/// The matched features at their corners in the image, ordered by id.
std::vector<Feature> featuresAt(const std::vector<Feature>& features, const Descriptors& image,
                                const std::vector<DescriptorMatch>& matches) {
  std::vector<Feature> result;
  for (const DescriptorMatch& match : matches) {
    const cv::Point2f& corner = image.points()[match.to];
    Feature feature = features[match.from];
    feature.age += 1;
    feature.u = Eigen::Vector2d(corner.x, corner.y);
    feature.flow = Eigen::Vector2d::Zero();  // unknown
    feature.sigma = kMatchSigma;
    result.push_back(feature);
  }
  return result;
}

PoseEstimation::Options withThresholds(PoseEstimation::Options options, int min_inliers,
                                       double min_inlier_share) {
  options.min_inliers = min_inliers;
  options.min_inlier_share = min_inlier_share;
  return options;
}

}  // namespace

Relocalisation::Relocalisation(const PinholeCamera& camera, const PoseEstimation::Options& options)
    : camera_(camera),
      coarse_pose_estimation_(withThresholds(options, kMinCoarseInliers, kMinCoarseInlierShare)),
      fine_pose_estimation_(withThresholds(options, kMinFineInliers, kMinFineInlierShare)) {}

std::optional<Relocalisation::Result> Relocalisation::locate(
    const LocalMap& map, const MotionModel& motion, const std::vector<Feature>& features,
    const Descriptors& previous, const Descriptors& next, std::int64_t stamp_ns) const {
  const Eigen::Isometry3d& T_w_previous = motion.T_w_c();
  const Eigen::Isometry3d predicted = motion.extrapolate(stamp_ns);
  const double distance = (predicted.translation() - T_w_previous.translation()).norm();
  const double max_deviation = maxDeviation(distance, medianDepth(map, features, T_w_previous));
  const auto isPlausible = [&](const PoseEstimation::Result& pose) {
    return pose.status == PoseStatus::kOk &&
           (pose.T_w_c.translation() - predicted.translation()).norm() <= max_deviation;
  };
  const auto regionAround = [&](const Eigen::Isometry3d& T_w_c, double radius) {
    return SearchRegion{predictPixels(camera_, map, features, T_w_previous, T_w_c),
                        static_cast<float>(radius * camera_.width)};
  };
  for (const SearchRegion& region : {regionAround(predicted, kSearchRadius), SearchRegion{}}) {
    const auto coarse_matches =
        featuresAt(features, next, matchDescriptors(previous, next, region));
    const PoseEstimation::Result coarse = coarse_pose_estimation_.estimate(
        predicted, pointObservations(map, toCorners(camera_, coarse_matches)));
    if (!isPlausible(coarse)) continue;
    const std::vector<Feature> matched =
        featuresAt(features, next,
                   matchDescriptors(previous, next, regionAround(coarse.T_w_c, kFineSearchRadius)));
    std::vector<std::size_t> index;  // indices of the observed features in `matched`
    const auto observations = pointObservations(map, toCorners(camera_, matched), &index);
    const PoseEstimation::Result pose = fine_pose_estimation_.estimate(coarse.T_w_c, observations);
    if (!isPlausible(pose)) continue;
    Result result{pose.T_w_c, {}};
    for (std::size_t k = 0; k < index.size(); ++k) {
      if (pose.inlier[k]) result.features.push_back(matched[index[k]]);
    }
    return result;
  }
  return std::nullopt;
}

}  // namespace ground_scale_vo
