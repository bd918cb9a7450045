#include "scale/direct_plane_estimator.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

using direct::kReferences;
using direct::Match;
using direct::Patch;
using direct::Reference;

/// [camera heights] Least length of the visible part of the lane region. A tele lens sees no road
/// near the vehicle, so its region extends this far beyond the nearest visible road.
constexpr double kMinLaneLength = 6;
constexpr double kLaneStartHeights = 1.5;  ///< near end of the lane region
/// Matched patches, over the reference images, below which the plane is not determined.
constexpr int kMinPatches = 24;
/// [1 / camera height] Standard deviation of the curvature of the road's cross-section, and of the
/// change of the cross slope along the path; used with an estimated lens.
constexpr double kCrownSigma = 0.03, kTwistSigma = 0.01;
/// Least slope of a viewing ray towards the road at which patches still resolve its texture.
constexpr double kMinRaySlope = 0.02;
/// Cosine between optical axis and backward direction from which on a camera faces backwards: its
/// reference images show the road from nearer than the current one, so PatchMatcher smooths them
/// instead. To one that looks sideways the road is equally near in all images.
constexpr double kMinBackwards = 0.5;

// Reference images; lengths in baselines.
constexpr double kMinImageSpacing = 0.2;  ///< between kept images
/// A shorter distance leaves a parallax of the order of the pose error.
constexpr double kMinReferenceDistance = 0.2;
/// Between the distance of an image and the one asked for: allows for large steps between frames.
constexpr double kMaxReferenceRatio = 8;

/// Limits the time spent on an estimate that does not converge.
constexpr int kMaxSolverIterations = 12;
/// Relative step of m at which the iteration has converged: far below the 0.5 % that the height is
/// known to in the best case.
constexpr double kConvergedPlaneStep = 2e-4;
/// From then on the robust scale is fixed, otherwise the weights and the scale may oscillate.
constexpr int kScaleIterations = 5;
/// [standard deviations] Tuning constant of the Cauchy weights of whole patches.
constexpr double kPatchCauchyConstant = 2;
/// Typical mean correlation of patches that show nothing but road. A lower one means that part of
/// the patches show something else, and inflates the height's standard deviation.
constexpr double kRoadCorrelation = 0.92;
/// [grey levels] Standard deviation; patches with less contrast have little weight.
constexpr double kImageNoise = 2;
/// Largest accepted ratio, in either direction, of the height to the one that the fit starts from.
constexpr double kMaxHeightChange = 1.4;
constexpr double kMaxHeightSigma = 0.05;  ///< largest accepted one, relative to the height

// Search of the plane while the height is not known, over the roll and over ln h.
/// [rad] Half a step changes the height at the border of the lane by 3 %.
constexpr double kRollStep = 0.06;
constexpr double kRollRange = 3;  ///< [standard deviations of the prior]
constexpr double kHeightStep = 0.05;
constexpr int kHeightSteps = 20;  ///< to each side: a factor of 2.7
/// Only every second patch is used; the position of the maximum needs no more.
constexpr std::size_t kSearchStride = 2;

/// [1 / camera height] Standard deviation of a curvature that is none.
constexpr double kNoCurvature = 1e-9;

/// Distance at which the middle of the lower image border meets the road [camera heights]; 0 when
/// it does not, or at a slope below kMinRaySlope.
double nearestVisibleRoad(const PinholeCamera& camera, const RoadPrior& prior) {
  const Eigen::Vector3d ray(0, (camera.height - 1 - camera.cy) / camera.fy, 1);
  const double slope = -prior.n_c.dot(ray);
  return slope > kMinRaySlope ? (ray + slope * prior.n_c).norm() / slope : 0;
}

/// Median camera height over the features in the lane, each taken as a road point [VO units]. 0
/// when there are none.
double medianFeatureHeight(const VoFrame& frame, const LaneRegion& lane, const RoadPrior& prior) {
  std::vector<double> heights;
  for (const TrackedFeature& feature : frame.features) {
    if (!hasUsablePoint(feature)) continue;
    if (!lane.contains(frame.camera.ray(feature.u.cast<double>()))) continue;
    const double height = -prior.n_c.dot(feature.p_c.cast<double>());
    if (height > 0) heights.push_back(height);
  }
  return heights.empty() ? 0 : median(&heights);
}

/// The images whose distances from the newest pose are nearest to one and two baselines [VO units];
/// fewer when there are none in range. road: of the newest pose.
std::vector<Reference> selectReferences(const CameraPath& path, const RoadImage& road,
                                        double baseline) {
  std::vector<Reference> references;
  const CameraPath::Pose &current = path.newest(), *first = nullptr;
  for (int k = 1; k <= kReferences; ++k) {
    const CameraPath::Pose* best = nullptr;
    double best_ratio = kMaxReferenceRatio;
    for (const CameraPath::Pose& pose : path.poses()) {
      if (pose.road.roi.empty() || pose.road.setting != road.setting || &pose == first) continue;
      const double length = (pose.T_w_c.translation() - current.T_w_c.translation()).norm();
      if (length < kMinReferenceDistance * baseline) continue;
      const double ratio = std::max(length / (k * baseline), k * baseline / length);
      if (ratio < best_ratio) {
        best_ratio = ratio;
        best = &pose;
      }
    }
    if (best == nullptr) break;
    first = best;
    references.push_back({best->road, road.readout_motion, best->T_w_c.inverse() * current.T_w_c});
  }
  return references;
}

}  // namespace

void DirectPlaneEstimator::setCamera(const PinholeCamera& camera, const cv::Mat& mask) {
  if (matcher_ && isSameCamera(camera_, camera) && mask_.data == mask.data) return;
  camera_ = camera;
  mask_ = mask;
  matcher_.emplace(camera, options_.patch_size, kImageNoise, mask);
  ++setting_;
}

LaneRegion DirectPlaneEstimator::laneRegion(const RoadPrior& prior, double height) const {
  const double max_ahead = std::max(options_.max_ahead_heights,
                                    nearestVisibleRoad(matcher_->camera(), prior) + kMinLaneLength);
  return {prior, height, kLaneStartHeights, max_ahead, options_.lane_half_width_heights};
}

/// Centre of the patches on a plane, in this frame's camera axes [VO units].
Eigen::Vector3d DirectPlaneEstimator::roadCentre(const GroundPlane& plane) const {
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();
  for (const Patch& patch : patches_) {
    const Eigen::Vector3d ray(patch.ray_x.mean(), patch.ray_y.mean(), 1);
    centre_c -= plane.height / (plane.n_c.dot(ray) * static_cast<double>(patches_.size())) * ray;
  }
  return centre_c;
}

/// Robust Gauss-Newton estimate of the plane m = n / h from the epipolar shifts of all patches in
/// all reference images. The status of the result is kMeasured or kNoPlane.
PlaneMeasurement DirectPlaneEstimator::solve(const RoadPrior& prior, const GroundPlane& initial) {
  PlaneMeasurement result;
  const double initial_height = initial.height;
  Eigen::Vector3d m = initial.n_c / initial_height;
  matches_.resize(patches_.size() * kReferences);
  double robust_scale = 1;
  for (int iteration = 0; iteration < kMaxSolverIterations; ++iteration) {
    if (!matchPatches(m, iteration == 0, &result)) return result;
    if (iteration < kScaleIterations) {
      robust_scale = std::max(1.0, kMadToSigma * median(&normalised_shifts_));
    }
    PlaneEquations equations =
        marginaliseMotion(accumulate(prior, m, initial_height, robust_scale));
    addPriors(prior, m, initial_height, &equations);
    const Eigen::Vector3d step = equations.H.ldlt().solve(equations.b).head<3>();
    if (!isFinite(step)) return result;
    if (step.norm() < kConvergedPlaneStep * m.norm()) {
      // Without this last step, so that the correlation and H belong to the accepted plane.
      accept(m, equations.H.inverse().topLeftCorner<3, 3>(), initial_height, &result);
      return result;
    }
    m += step;
    if (!(m.dot(prior.n_c) > 0)) return result;
  }
  return result;  // not converged
}

/// The plane under which the patches correlate best with the first reference image: at the heights
/// around `centre` [VO units], and within the roll that the prior leaves open. Its pitch is that of
/// the prior, which knows it from the direction of motion.
GroundPlane DirectPlaneEstimator::search(const RoadPrior& prior, double centre) const {
  GroundPlane best{prior.n_c, centre};
  double best_correlation = -1;
  const int rolls = static_cast<int>(kRollRange * prior.roll_sigma / kRollStep);
  for (int k = -rolls; k <= rolls; ++k) {
    const Eigen::Vector3d n_c = Eigen::AngleAxisd(kRollStep * k, prior.forward_c) * prior.n_c;
    for (int i = -kHeightSteps; i <= kHeightSteps; ++i) {
      const double height = centre * std::exp(kHeightStep * i);
      const double correlation = meanCorrelation(n_c / height);
      if (correlation <= best_correlation) continue;
      best_correlation = correlation;
      best = {n_c, height};
    }
  }
  return best;
}

/// Mean correlation of the patches with the first reference image under the plane m, weighted by
/// texture; -1 when too few project into it.
double DirectPlaneEstimator::meanCorrelation(const Eigen::Vector3d& m) const {
  double sum = 0, weights = 0, all_weights = 0;
  int inside = 0;
  direct::Samples values;
  for (std::size_t i = 0; i < patches_.size(); i += kSearchStride) {
    const Patch& patch = patches_[i];
    all_weights += patch.texture;
    if (!matcher_->sample(references_.front(), patch, m, &values)) continue;
    sum += patch.texture * matcher_->correlate(patch, &values);
    weights += patch.texture;
    ++inside;
  }
  const bool enough =
      static_cast<int>(kSearchStride) * inside >= kMinPatches && weights > 0.5 * all_weights;
  return enough ? sum / weights : -1;
}

/// Matches all patches under the plane m. False when too few are valid.
bool DirectPlaneEstimator::matchPatches(const Eigen::Vector3d& m, bool linearise,
                                        PlaneMeasurement* result) {
  double correlation = 0, weights = 0;
  result->support = 0;
  normalised_shifts_.clear();
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    for (std::size_t k = 0; k < references_.size(); ++k) {
      Match& match = matches_[i * kReferences + k];
      if (linearise) matcher_->linearise(references_[k], patches_[i], m, &match);
      matcher_->measure(references_[k], patches_[i], m, &match);
      if (!match.valid) continue;
      ++result->support;
      correlation += patches_[i].texture * match.correlation;
      weights += patches_[i].texture;
      normalised_shifts_.push_back(std::abs(match.shift) / std::sqrt(shiftVariance(match, m)));
    }
  }
  if (result->support < kMinPatches || !(weights > 0)) return false;
  result->correlation = correlation / weights;
  return true;
}

/// From the pixels, and from the roughness of the road: the reference images see the same bump, so
/// its variance counts once for each.
double DirectPlaneEstimator::shiftVariance(const Match& match, const Eigen::Vector3d& m) const {
  const double roughness = options_.roughness_heights * m.dot(match.ray.cast<double>());
  return match.variance + kReferences * roughness * roughness;
}

/// Normal equations of all shifts with Cauchy weights, one system for each reference image.
DirectPlaneEstimator::JointEquations DirectPlaneEstimator::accumulate(const RoadPrior& prior,
                                                                      const Eigen::Vector3d& m,
                                                                      double height,
                                                                      double robust_scale) const {
  JointEquations joint;
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    for (std::size_t k = 0; k < references_.size(); ++k) {
      const Match& match = matches_[i * kReferences + k];
      if (!match.valid) continue;
      const Eigen::Vector3d ray = match.ray.cast<double>();
      const double q = m.dot(ray);
      // [camera heights] from the origin; the curved road lies lower by c x^2 / 2.
      const double ahead = prior.forward_c.dot(-ray / q - origin_c_) / height;
      const double across = prior.lateral().dot(-ray / q - origin_c_) / height;
      Eigen::Matrix<double, kShared + kMotion, 1> jacobian;
      jacobian << ray, -0.5 * q * ahead * ahead, -0.5 * q * across * across, -q * ahead * across,
          match.lens.cast<double>(), match.motion.cast<double>();
      const double expected = shiftVariance(match, m) * robust_scale * robust_scale;
      const double shift = match.shift;
      const double weight =
          1 / (expected + shift * shift / (kPatchCauchyConstant * kPatchCauchyConstant));
      joint[k].H.noalias() += weight * jacobian * jacobian.transpose();
      joint[k].b += weight * shift * jacobian;
    }
  }
  return joint;
}

/// Schur complement: removes each reference's motion error, with its prior, from its equations.
DirectPlaneEstimator::PlaneEquations DirectPlaneEstimator::marginaliseMotion(
    JointEquations joint) const {
  PlaneEquations plane;
  for (std::size_t k = 0; k < references_.size(); ++k) {
    auto& [H, b] = joint[k];
    H.diagonal().segment<3>(kShared).array() += std::pow(options_.rotation_sigma_rad, -2);
    H.diagonal().tail<2>().array() += std::pow(options_.direction_sigma_rad, -2);
    const Eigen::Matrix<double, kShared, kMotion> cross = H.topRightCorner<kShared, kMotion>();
    const auto motion = H.bottomRightCorner<kMotion, kMotion>().ldlt();
    plane.H += H.topLeftCorner<kShared, kShared>() - cross * motion.solve(cross.transpose());
    plane.b += b.head<kShared>() - cross * motion.solve(b.tail<kMotion>());
  }
  return plane;
}

/// Pitch and roll of the normal, zero curvatures and no distortion. The road is flat across the
/// lane unless the lens is known.
void DirectPlaneEstimator::addPriors(const RoadPrior& prior, const Eigen::Vector3d& m,
                                     double height, PlaneEquations* equations) const {
  prior.addTo(m, height, equations->H.topLeftCorner<3, 3>(), equations->b.head<3>());
  const bool lens_is_known = camera_.lens_is_estimated;
  equations->H(3, 3) += std::pow(options_.curvature_sigma, -2);
  equations->H(4, 4) += std::pow(lens_is_known ? kCrownSigma : kNoCurvature, -2);
  equations->H(5, 5) += std::pow(lens_is_known ? kTwistSigma : kNoCurvature, -2);
  equations->H(6, 6) += std::pow(options_.lens_k1_sigma, -2);
  equations->H(7, 7) += std::pow(options_.lens_k2_sigma, -2);
}

/// Fills in the plane and its standard deviation, and decides whether it is accepted. covariance:
/// of m.
void DirectPlaneEstimator::accept(const Eigen::Vector3d& m, const Eigen::Matrix3d& covariance,
                                  double initial_height, PlaneMeasurement* result) const {
  const GroundPlane plane{m.normalized(), (1 + m.dot(origin_c_)) / m.norm()};
  if (!(plane.height > 0)) return;
  // Of ln height by m.
  const Eigen::Vector3d gradient = origin_c_ / (1 + m.dot(origin_c_)) - m / m.squaredNorm();
  const double relative_sigma = std::sqrt(gradient.dot(covariance * gradient));
  const double inflation = std::max(1.0, (1 - result->correlation) / (1 - kRoadCorrelation));
  const double change = std::abs(std::log(plane.height / initial_height));
  if (result->correlation >= options_.min_correlation && change <= std::log(kMaxHeightChange) &&
      relative_sigma <= kMaxHeightSigma) {
    result->status = MeasurementStatus::kMeasured;
    result->plane = plane;
    result->sigma = inflation * relative_sigma * plane.height;
    result->road_distance = (roadCentre(plane) - origin_c_).norm();
  }
}

PlaneMeasurement DirectPlaneEstimator::estimate(const VoFrame& frame, const cv::Mat& image,
                                                double height, const CameraPath& path,
                                                const cv::Mat& mask, RoadImage* road) {
  setCamera(frame.camera, mask);
  const CameraPath::Pose& current = path.newest();
  const RoadPrior& prior = current.prior;
  const LaneRegion lane = laneRegion(prior, height);
  const bool faces_backwards = prior.forward_c.z() < -kMinBackwards;
  *road = {};
  road->setting = setting_;
  PlaneMeasurement result;
  result.status = MeasurementStatus::kStandstill;
  const double initial = height > 0 ? height : medianFeatureHeight(frame, lane, prior);
  if (!(initial > 0)) return result;
  matcher_->extract(image, lane, faces_backwards, road, &patches_);
  road->readout_motion = frame.readout_motion;
  const double baseline = options_.baseline_heights * initial;
  road->min_spacing = kMinImageSpacing * baseline;
  references_ = selectReferences(path, *road, baseline);
  if (references_.empty()) return result;
  origin_c_.setZero();
  if (!patches_.empty()) {
    const Eigen::Vector3d centre_w = current.T_w_c * roadCentre({prior.n_c, initial});
    const double max_length = options_.max_ahead_heights * initial;
    origin_c_ = current.T_w_c.inverse() * path.nearest(centre_w, max_length).T_w_c.translation();
  }
  result = solve(prior, {prior.n_c, initial});
  if (result.status != MeasurementStatus::kMeasured && !(height > 0)) {
    result = solve(prior, search(prior, initial));
  }
  return result;
}

}  // namespace gsv
