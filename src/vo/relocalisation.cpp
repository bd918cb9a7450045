#include "vo/relocalisation.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {
namespace {

// Descriptors.

/// [image width] radius of the search around the predicted position of a feature, and around the
/// position predicted with the pose of the first matches.
constexpr double kSearchRadius = 0.06, kFineSearchRadius = 0.012;
// Inliers and their share of the matches: of the first search, whose pose the second one verifies,
// and of the second one, whose pose tracking verifies. Wrong matches near the projections of a
// wrong pose have neither similar descriptors nor a common motion.
constexpr int kMinCoarseInliers = 10, kMinFineInliers = 15;
constexpr double kMinCoarseInlierShare = 0.25, kMinFineInlierShare = 0.5;
/// [normalised coordinates] standard deviation of a matched corner: 2 px at a focal length of 718.
constexpr double kMatchSigma = 0.003;

// Patches.

/// [px] width of the reduced image in which poses are rated: its patches tolerate the change of
/// perspective, and the whole image can be searched.
constexpr double kCoarseWidth_px = 320;
constexpr std::size_t kMaxRatedPoints = 200;
/// [points] least number in the image at a rated pose.
constexpr std::size_t kMinRatedPoints = 25;
/// [px] by which a patch may be displaced at a rated pose, and the steps between the rotations:
/// together they leave no gaps.
constexpr int kTolerance_px = 2, kStep_px = 3;
/// [px] largest rotation about the horizontal axis: 4.5 degrees at a field of view of 80 degrees.
/// About the vertical axis it is half of the image width.
constexpr int kMaxVertical_px = 15;
/// [px] by which the row of a point may change with the rotation about the vertical axis.
constexpr int kRowChange_px = 8;
/// Distance travelled over that at the last velocity. A car that brakes or accelerates with
/// 3 m/s^2 from 10 m/s deviates by 0.3 after 2 s.
constexpr double kDistances[] = {0.55, 0.7, 0.85, 1, 1.15, 1.3, 1.45};
/// [standard deviations] least score, see PoseRating::scoreOf(). The best of all wrong poses
/// reaches about 4.
constexpr double kMinScore = 5;

/// [px] half side of a patch in the reduced image.
constexpr int kHalf_px = 4, kSide_px = 2 * kHalf_px + 1;
/// Size k: the last tracked image is scaled by kSizeStep^k before the patch is cut out, up to a
/// factor of 3.4, larger or smaller.
constexpr double kSizeStep = 1.19;
constexpr int kMaxSize = 7;
/// [grey levels] least standard deviation of a patch; sensor noise has about 1 to 2.
constexpr double kMinDeviation = 2;

/// Refinement: width of the reduced image, and distance from the projection that is searched [px].
constexpr std::pair<double, int> kLevels[] = {{320, 4}, {640, 5}, {1280, 4}};
constexpr float kMinCorrelation = 0.7f;
constexpr int kMinPatchInliers = 15;
constexpr double kMinPatchInlierShare = 0.3;

PoseEstimation::Options withThresholds(PoseEstimation::Options options, int min_inliers,
                                       double min_inlier_share) {
  options.min_inliers = min_inliers;
  options.min_inlier_share = min_inlier_share;
  return options;
}

struct Point {
  const Feature* feature;
  Eigen::Vector3d p;  ///< in the previous camera
};

std::vector<Point> pointsOf(const LocalMap& map, const std::vector<Feature>& features,
                            const Eigen::Isometry3d& T_w_previous) {
  std::vector<Point> points;
  for (const Feature& feature : features) {
    const auto point = map.point(feature.id);
    if (!point) continue;
    const Eigen::Vector3d p = T_w_previous.inverse() * point->p_w;
    if (p.z() > 0) points.push_back({&feature, p});
  }
  return points;
}

/// [VO units] largest plausible deviation of a motion from the predicted one, of the given
/// distance: a share of it, and a share of the median depth for a camera that starts to move.
double maxDeviation(double distance, const std::vector<Point>& points) {
  std::vector<double> depths;
  for (const Point& point : points) depths.push_back(point.p.z());
  return 0.5 * distance + (depths.empty() ? 0 : 0.1 * median(&depths));
}

Feature moved(Feature feature, const Eigen::Vector2d& u, double sigma) {
  feature.age += 1;
  feature.u = u;
  feature.flow = Eigen::Vector2d::Zero();  // unknown
  feature.sigma = sigma;
  return feature;
}

/// The matched features at their corners in the image, ordered by id.
std::vector<Feature> featuresAt(const std::vector<Feature>& features, const Descriptors& image,
                                const std::vector<DescriptorMatch>& matches) {
  std::vector<Feature> result;
  for (const DescriptorMatch& match : matches) {
    const cv::Point2f& corner = image.points()[match.to];
    result.push_back(moved(features[match.from], {corner.x, corner.y}, kMatchSigma));
  }
  return result;
}

/// Size of the point's patch in the next image; empty if it is too small or too large.
std::optional<int> sizeOf(const Point& point, const Eigen::Isometry3d& T_next_previous) {
  const double z = (T_next_previous * point.p).z();
  if (!(z > 0)) return std::nullopt;
  const auto size = std::lround(std::log(point.p.z() / z) / std::log(kSizeStep));
  if (std::abs(size) > kMaxSize) return std::nullopt;
  return static_cast<int>(size);
}

cv::Point2f scaled(const Eigen::Vector2d& u, double scale) {
  return {static_cast<float>((u.x() + 0.5) * scale - 0.5),
          static_cast<float>((u.y() + 0.5) * scale - 0.5)};
}

/// Patches of one image at several sizes, correlated with another one that is reduced to a width.
class ScaledPatches {
 public:
  /// Not enlarged. mask: 0 where both images never show the scene; empty: none.
  ScaledPatches(const PinholeCamera& camera, const cv::Mat& from, const cv::Mat& to,
                const cv::Mat& mask, double width)
      : from_(from), factor_(std::min(1.0, width / camera.width)), mask_(mask) {
    cv::resize(to, to_, {}, factor_, factor_, cv::INTER_AREA);
    allowed_ = cv::Mat(to_.size(), CV_8U, cv::Scalar(255));
    if (mask.empty()) return;
    cv::resize(mask != 0, allowed_, to_.size(), 0, 0, cv::INTER_AREA);
    cv::erode(allowed_ == 255, allowed_, cv::Mat::ones(kSide_px, kSide_px, CV_8U));
  }

  double factor() const { return factor_; }  ///< reduced over original pixels
  cv::Size size() const { return to_.size(); }
  /// Of the reduced image; 0 where a patch touches the mask.
  const cv::Mat& allowed() const { return allowed_; }

  /// Normalised cross-correlation of the patch around a pixel with those around the pixels of a
  /// region; float, one element per pixel. region: [reduced px], is cut to the pixels where the
  /// patch fits; 0 at those that are not allowed. Empty when there are none, when the patch leaves
  /// its image, touches the mask or has no texture.
  cv::Mat correlate(const Eigen::Vector2d& u_from, int size, cv::Rect* region) {
    const double scale = factor_ * std::pow(kSizeStep, size);
    cv::Mat& source = from_at_[size];
    if (source.empty()) {
      cv::resize(from_, source, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    }
    const cv::Point2f centre = scaled(u_from, scale), pixel = scaled(u_from, 1);
    const cv::Rect2f inside(kHalf_px, kHalf_px, static_cast<float>(source.cols - kSide_px),
                            static_cast<float>(source.rows - kSide_px));
    *region &= cv::Rect(kHalf_px, kHalf_px, to_.cols - kSide_px + 1, to_.rows - kSide_px + 1);
    // With half a pixel of the reduced image, and one for the interpolation.
    const int reach = static_cast<int>(std::ceil((kHalf_px + 1.5) / scale)) + 1;
    if (!inside.contains(centre) || region->empty() || touchesMask(mask_, pixel, reach)) return {};
    cv::Mat patch, correlation;
    cv::getRectSubPix(source, {kSide_px, kSide_px}, centre, patch);
    cv::Scalar mean, deviation;
    cv::meanStdDev(patch, mean, deviation);
    if (deviation[0] < kMinDeviation) return {};
    const cv::Rect around(region->tl() - cv::Point(kHalf_px, kHalf_px),
                          region->size() + cv::Size(kSide_px - 1, kSide_px - 1));
    cv::matchTemplate(to_(around), patch, correlation, cv::TM_CCOEFF_NORMED);
    correlation.setTo(0, allowed_(*region) == 0);
    return correlation;
  }

 private:
  const cv::Mat from_;
  const double factor_;
  const cv::Mat mask_;
  cv::Mat to_, allowed_;
  std::map<int, cv::Mat> from_at_;  ///< by size
};

/// Rates poses by the sum of the correlations of all patches at their projections.
class PoseRating {
 public:
  PoseRating(const PinholeCamera& camera, const std::vector<Point>& points, const cv::Mat& previous,
             const cv::Mat& image, const cv::Mat& mask)
      : camera_(camera), patches_(camera, previous, image, mask, kCoarseWidth_px) {
    const std::size_t count = std::min(kMaxRatedPoints, points.size());
    for (std::size_t i = 0; i < count; ++i) points_.push_back(points[i * points.size() / count]);
  }

  /// T_previous_next with the largest score. path: displacement at the last velocity, axes of the
  /// previous camera. Empty when no score is large enough.
  std::optional<Eigen::Isometry3d> best(const Eigen::Vector3d& path) {
    double best_score = kMinScore;
    std::optional<Eigen::Isometry3d> best;
    const double fx = camera_.fx * patches_.factor(), fy = camera_.fy * patches_.factor();
    const int max_horizontal_px = patches_.size().width / 2;
    for (const double distance : kDistances) {
      selectResponses(distance * path);
      for (int x = -max_horizontal_px; x <= max_horizontal_px; x += kStep_px) {
        for (int y = -kMaxVertical_px; y <= kMaxVertical_px; y += kStep_px) {
          const Eigen::Isometry3d T = exponentialMap({y / fy, x / fx, 0}, distance * path);
          const double score = scoreOf(T.inverse());
          if (score <= best_score) continue;
          best_score = score;
          best = T;
        }
      }
    }
    return best;
  }

 private:
  /// Correlation of a patch with a horizontal strip of the image.
  struct Response {
    cv::Mat correlation;  ///< the largest within kTolerance_px; empty: unknown
    cv::Point origin;
    double mean = 0, variance = 0;  ///< over the strip: those at unrelated places
  };

  cv::Point project(const Eigen::Vector3d& p) const {
    const cv::Point2f u = scaled(camera_.project(p), patches_.factor());
    return {cvRound(u.x), cvRound(u.y)};
  }

  /// Sets selected_ to each point's response at its size after this displacement.
  void selectResponses(const Eigen::Vector3d& path) {
    const Eigen::Isometry3d T = exponentialMap({0, 0, 0}, path).inverse();
    selected_.assign(points_.size(), nullptr);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const auto size = sizeOf(points_[i], T);
      if (!size) continue;
      const auto [entry, is_new] = responses_.try_emplace({i, *size});
      if (is_new) {
        entry->second = responseAround(project(T * points_[i].p).y, *points_[i].feature, *size);
      }
      if (!entry->second.correlation.empty()) selected_[i] = &entry->second;
    }
  }

  Response responseAround(int row, const Feature& feature, int size) {
    constexpr int kReach = kMaxVertical_px + kRowChange_px, kWidth = 2 * kTolerance_px + 1;
    Response response;
    cv::Rect region(0, row - kReach, patches_.size().width, 2 * kReach + 1);
    const cv::Mat correlation = patches_.correlate(feature.u, size, &region);
    if (correlation.empty()) return response;
    cv::dilate(correlation, response.correlation, cv::Mat::ones(kWidth, kWidth, CV_8U));
    cv::Scalar mean, deviation;
    cv::meanStdDev(response.correlation, mean, deviation, patches_.allowed()(region));
    response.origin = region.tl();
    response.mean = mean[0];
    response.variance = deviation[0] * deviation[0];
    return response;
  }

  /// In standard deviations of the sum at an unrelated pose; 0 if too few points are in the image.
  double scoreOf(const Eigen::Isometry3d& T_next_previous) const {
    double sum = 0, variance = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!selected_[i]) continue;
      const Eigen::Vector3d p = T_next_previous * points_[i].p;
      if (!(p.z() > 0)) continue;
      const cv::Mat& correlation = selected_[i]->correlation;
      const cv::Point pixel = project(p), at = pixel - selected_[i]->origin;
      if (!cv::Rect({0, 0}, correlation.size()).contains(at) ||
          patches_.allowed().at<unsigned char>(pixel) == 0) {
        continue;
      }
      sum += correlation.at<float>(at) - selected_[i]->mean;
      variance += selected_[i]->variance;
      ++count;
    }
    return count < kMinRatedPoints ? 0 : sum / std::sqrt(variance);
  }

  const PinholeCamera& camera_;
  ScaledPatches patches_;
  std::vector<Point> points_;
  std::map<std::pair<std::size_t, int>, Response> responses_;  ///< by point and size
  std::vector<const Response*> selected_;                      ///< by point; null: none
};

/// The features at the pixels near their projections at which their patches correlate best.
std::vector<Feature> matchesNear(const PinholeCamera& camera, const std::vector<Point>& points,
                                 const Eigen::Isometry3d& T_next_previous, int reach_px,
                                 ScaledPatches* patches) {
  std::vector<Feature> matches;
  for (const Point& point : points) {
    const auto size = sizeOf(point, T_next_previous);
    if (!size) continue;
    const cv::Point2f u = scaled(camera.project(T_next_previous * point.p), patches->factor());
    cv::Rect region(cvRound(u.x) - reach_px, cvRound(u.y) - reach_px, 2 * reach_px + 1,
                    2 * reach_px + 1);
    const cv::Mat correlation = patches->correlate(point.feature->u, *size, &region);
    if (correlation.empty()) continue;
    double peak = 0;
    cv::Point offset;
    cv::minMaxLoc(correlation, nullptr, &peak, nullptr, &offset);
    if (peak < kMinCorrelation) continue;
    const cv::Point at = region.tl() + offset;
    const cv::Point2f original = scaled(Eigen::Vector2d(at.x, at.y), 1 / patches->factor());
    matches.push_back(
        moved(*point.feature, {original.x, original.y}, 1 / (camera.fx * patches->factor())));
  }
  return matches;
}

}  // namespace

Relocalisation::Relocalisation(const PinholeCamera& camera, const PoseEstimation::Options& options,
                               const cv::Mat& mask)
    : camera_(camera),
      mask_(mask),
      coarse_estimation_(withThresholds(options, kMinCoarseInliers, kMinCoarseInlierShare)),
      fine_estimation_(withThresholds(options, kMinFineInliers, kMinFineInlierShare)),
      patch_estimation_(withThresholds(options, kMinPatchInliers, kMinPatchInlierShare)) {}

std::optional<Relocalisation::Result> Relocalisation::estimate(
    const PoseEstimation& estimation, const LocalMap& map, const Eigen::Isometry3d& initial_T_w_c,
    const std::vector<Feature>& matches) const {
  std::vector<std::size_t> index;  // indices of the observed features in `matches`
  const auto observations = pointObservations(map, toCorners(camera_, matches), &index);
  const PoseEstimation::Result pose = estimation.estimate(initial_T_w_c, observations);
  if (pose.status != PoseStatus::kOk) return std::nullopt;
  Result result{pose.T_w_c, std::sqrt(pose.covariance.diagonal().tail<3>().maxCoeff()), {}};
  for (std::size_t k = 0; k < index.size(); ++k) {
    if (pose.inlier[k]) result.features.push_back(matches[index[k]]);
  }
  return result;
}

std::optional<Relocalisation::Result> Relocalisation::matchDescriptors(
    const LocalMap& map, const MotionModel& motion, const std::vector<Feature>& features,
    const Descriptors& previous, const Descriptors& next, std::int64_t stamp_ns) const {
  const Eigen::Isometry3d& T_w_previous = motion.T_w_c();
  const Eigen::Isometry3d predicted = motion.extrapolate(stamp_ns);
  const double distance = (predicted.translation() - T_w_previous.translation()).norm();
  const double max_deviation = maxDeviation(distance, pointsOf(map, features, T_w_previous));
  const auto isPlausible = [&](const std::optional<Result>& result) {
    return result &&
           (result->T_w_c.translation() - predicted.translation()).norm() <= max_deviation;
  };
  const auto regionAround = [&](const Eigen::Isometry3d& T_w_c, double radius) {
    return SearchRegion{predictPixels(camera_, map, features, T_w_previous, T_w_c),
                        static_cast<float>(radius * camera_.width)};
  };
  const auto match = [&](const SearchRegion& region) {
    return featuresAt(features, next, ground_scale_vo::matchDescriptors(previous, next, region));
  };
  for (const SearchRegion& region : {regionAround(predicted, kSearchRadius), SearchRegion{}}) {
    const auto coarse = estimate(coarse_estimation_, map, predicted, match(region));
    if (!isPlausible(coarse)) continue;
    const auto fine = estimate(fine_estimation_, map, coarse->T_w_c,
                               match(regionAround(coarse->T_w_c, kFineSearchRadius)));
    if (isPlausible(fine)) return fine;
  }
  return std::nullopt;
}

std::optional<Relocalisation::Result> Relocalisation::searchPose(
    const LocalMap& map, const MotionModel& motion, const std::vector<Feature>& features,
    const cv::Mat& previous, const cv::Mat& image, std::int64_t stamp_ns) const {
  const Eigen::Isometry3d& T_w_previous = motion.T_w_c();
  const std::vector<Point> points = pointsOf(map, features, T_w_previous);
  if (points.size() < kMinRatedPoints) return std::nullopt;
  const Eigen::Vector3d path =
      T_w_previous.linear().transpose() *
      (motion.extrapolate(stamp_ns).translation() - T_w_previous.translation());
  const auto coarse = PoseRating(camera_, points, previous, image, mask_).best(path);
  if (!coarse) return std::nullopt;
  std::optional<Result> result = Result{T_w_previous * *coarse, 0, {}};
  for (const auto& [width, reach] : kLevels) {
    ScaledPatches patches(camera_, previous, image, mask_, width);
    result = estimate(
        patch_estimation_, map, result->T_w_c,
        matchesNear(camera_, points, result->T_w_c.inverse() * T_w_previous, reach, &patches));
    if (!result) return std::nullopt;
  }
  const double distance = (result->T_w_c.translation() - T_w_previous.translation()).norm();
  const double deviation = std::abs(distance - path.norm());
  if (!(deviation <= maxDeviation(path.norm(), points))) return std::nullopt;
  return result;
}

}  // namespace ground_scale_vo
