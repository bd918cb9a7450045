#include "vo/recovery.hpp"

#include <cmath>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "vo/pose.hpp"

namespace gsv {
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

}  // namespace

std::optional<RelocalisedPose> poseOfMatches(const PinholeCamera& camera, const LocalMap& map,
                                             const Eigen::Isometry3d& initial_T_w_c,
                                             const std::vector<Feature>& matches, int min_inliers,
                                             double min_inlier_share) {
  std::vector<std::size_t> index;  // indices of the observed features in `matches`
  const PoseEstimate pose =
      estimatePose(initial_T_w_c, pointObservations(map, observationsOf(camera, matches), &index),
                   min_inliers, min_inlier_share);
  if (!pose.ok) return std::nullopt;
  RelocalisedPose result;
  result.T_w_c = pose.T_w_c;
  result.rotation_sigma = std::sqrt(pose.covariance.diagonal().tail<3>().maxCoeff());
  for (std::size_t k = 0; k < index.size(); ++k) {
    if (pose.inlier[k]) result.features.push_back(matches[index[k]]);
  }
  return result;
}

double maxDeviation(double predicted_distance, const LocalMap& map,
                    const std::vector<Feature>& features, const Eigen::Isometry3d& T_w_previous) {
  std::vector<double> depths;
  for (const Feature& feature : features) {
    const auto point = map.point(feature.id);
    const double z = point ? (T_w_previous.inverse() * point->p_w).z() : 0;
    if (z > 0) depths.push_back(z);
  }
  return 0.5 * predicted_distance + 0.1 * (depths.empty() ? 0 : median(&depths));
}

std::optional<RelocalisedPose> locateByDescriptors(const PinholeCamera& camera, const LocalMap& map,
                                                   const MotionModel& motion,
                                                   const std::vector<Feature>& features,
                                                   const Descriptors& previous,
                                                   const Descriptors& next, std::int64_t stamp_ns) {
  const Eigen::Isometry3d& T_w_previous = motion.T_w_c();
  const Eigen::Isometry3d predicted = motion.extrapolate(stamp_ns);
  const double distance = (predicted.translation() - T_w_previous.translation()).norm();
  const double max_deviation = maxDeviation(distance, map, features, T_w_previous);
  const auto pixelsFrom = [&](const Eigen::Isometry3d& T_w_c) {
    return predictPixels(camera, map, features, T_w_previous, T_w_c);
  };
  const auto poseNear = [&](const std::vector<cv::Point2f>& pixels, double radius,
                            const Eigen::Isometry3d& initial_T_w_c, int min_inliers,
                            double min_inlier_share) {
    const auto matches =
        matchDescriptors(previous, next, pixels, static_cast<float>(radius * camera.width));
    auto pose = poseOfMatches(camera, map, initial_T_w_c, featuresAt(features, next, matches),
                              min_inliers, min_inlier_share);
    if (pose && !((pose->T_w_c.translation() - predicted.translation()).norm() <= max_deviation)) {
      pose.reset();
    }
    return pose;
  };
  for (const auto& pixels : {pixelsFrom(predicted), std::vector<cv::Point2f>()}) {
    const auto coarse =
        poseNear(pixels, kSearchRadius, predicted, kMinCoarseInliers, kMinCoarseInlierShare);
    if (!coarse) continue;
    auto fine = poseNear(pixelsFrom(coarse->T_w_c), kFineSearchRadius, coarse->T_w_c,
                         kMinFineInliers, kMinFineInlierShare);
    if (fine) return fine;
  }
  return std::nullopt;
}

/// Keeps the more certain of two rotations: the one since the last frame with a pose, and the
/// product of the rotations from image to image.
void Interruption::addImage(const RelativeRotation& rotation, Descriptors corners) {
  if (last_) rotation_ = rotation_.then(rotationBetween(*last_, corners));
  if (!last_ || rotation.sigma < rotation_.sigma) rotation_ = rotation;
  last_ = std::move(corners);
  ++images_;
}

void Interruption::end() {
  images_ = 0;
  last_.reset();
}

RelativeRotation Interruption::rotationBetween(const Descriptors& a, const Descriptors& b) const {
  std::vector<Eigen::Vector2d> u1, u2;
  for (const DescriptorMatch& match : matchDescriptors(a, b)) {
    const cv::Point2f &p1 = a.points()[match.from], &p2 = b.points()[match.to];
    u1.emplace_back(p1.x, p1.y);
    u2.emplace_back(p2.x, p2.y);
  }
  return estimateRotation(camera_, u1, u2);
}

}  // namespace gsv
