#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/recovery.hpp"

namespace gsv {
namespace {

// Grid of poses, rated in a reduced image: its patches of 9 px tolerate the change of perspective,
// and the whole image can be searched.
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

/// Largest |k| of a patch size k (ScaledPatches): a factor of 3.4, larger or smaller.
constexpr int kMaxSize = 7;

/// Refinement: width of the reduced image, and distance from the projection that is searched [px].
constexpr std::pair<double, int> kLevels[] = {{320, 4}, {640, 5}, {1280, 4}};
constexpr float kMinCorrelation = 0.7f;
constexpr int kMinInliers = 15;
constexpr double kMinInlierShare = 0.3;

/// [grey levels] least standard deviation of a patch; sensor noise has about 1 to 2.
constexpr double kMinDeviation = 2;

/// Least sum of the squared differences from the mean of a patch. A patch of integers has zero or
/// more than this; the correlation with a patch of zero becomes about zero.
constexpr double kMinSquaredNorm = 0.5;

cv::Point2f scaled(const Eigen::Vector2d& u, double scale) {
  return {static_cast<float>((u.x() + 0.5) * scale - 0.5),
          static_cast<float>((u.y() + 0.5) * scale - 0.5)};
}

/// Square patches of one image at several sizes, and their normalised cross-correlation with
/// another image. "Resized" pixels are those of the other image after its reduction to a width.
class ScaledPatches {
 public:
  static constexpr int kHalf_px = 4, kSide_px = 2 * kHalf_px + 1;  ///< of a patch, resized pixels
  /// Size k: the image `from` is scaled by factor() * kSizeStep^k before the patch is cut out.
  static constexpr double kSizeStep = 1.19;

  /// from, to: 8-bit grey, of the camera's size. mask: 0 where both never show the scene; empty:
  /// none. width: [px] to which `to` is reduced; not enlarged.
  ScaledPatches(const PinholeCamera& camera, const cv::Mat& from, const cv::Mat& to,
                const cv::Mat& mask, double width)
      : from_(from), factor_(std::min(1.0, width / camera.width)), mask_(mask) {
    cv::Mat resized, mean, mean_square;
    cv::resize(to, resized, {}, factor_, factor_, cv::INTER_AREA);
    resized.convertTo(to_, CV_32F);
    cv::boxFilter(resized, mean, CV_64F, {kSide_px, kSide_px});
    cv::sqrBoxFilter(resized, mean_square, CV_64F, {kSide_px, kSide_px});
    cv::Mat norm;
    cv::sqrt(cv::max((mean_square - mean.mul(mean)) * kSide_px * kSide_px, kMinSquaredNorm), norm);
    norm.convertTo(norm_, CV_32F);
    if (mask.empty()) return;
    cv::resize(mask != 0, allowed_, to_.size(), 0, 0, cv::INTER_AREA);
    cv::erode(allowed_ == 255, allowed_, cv::Mat::ones(kSide_px, kSide_px, CV_8U));
  }

  double factor() const { return factor_; }  ///< resized over original pixels
  cv::Size size() const { return to_.size(); }
  /// The nearest resized pixel; of a projection far outside the image, one that is outside, too.
  cv::Point resized(const Eigen::Vector2d& u) const {
    constexpr double kFar_px = 1e6;
    const cv::Point2f at = scaled(u.cwiseMin(kFar_px).cwiseMax(-kFar_px), factor_);
    return {cvRound(at.x), cvRound(at.y)};
  }
  Eigen::Vector2d original(const cv::Point2f& u) const {
    return {(u.x + 0.5) / factor_ - 0.5, (u.y + 0.5) / factor_ - 0.5};
  }
  /// Whether a patch around this resized pixel touches the mask.
  bool isMasked(const cv::Point& u) const {
    return !allowed_.empty() && allowed_.at<unsigned char>(u) == 0;
  }
  /// 0 at the pixels of a region for which isMasked(); empty without a mask.
  cv::Mat allowed(const cv::Rect& region) const {
    return allowed_.empty() ? cv::Mat() : allowed_(region);
  }

  /// Correlation in [-1, 1] of the patch around a pixel with those around the pixels of a region;
  /// float, one element per pixel. region: [resized px], reduced to the pixels where the patch
  /// fits; -1 at those of isMasked(). Empty when there are none, when the patch leaves its image,
  /// touches the mask or has no texture.
  cv::Mat correlate(const Eigen::Vector2d& u_from, int size, cv::Rect* region) {
    const double scale = factor_ * std::pow(kSizeStep, size);
    cv::Mat& source = from_at_[size];
    if (source.empty()) {
      cv::resize(from_, source, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    }
    const cv::Point2f centre = scaled(u_from, scale);
    *region &= cv::Rect(kHalf_px, kHalf_px, to_.cols - kSide_px + 1, to_.rows - kSide_px + 1);
    if (!isInside(source, centre, kHalf_px) || region->empty()) return {};
    // With half a pixel of the resized image, and one for the interpolation.
    const int reach = static_cast<int>(std::ceil((kHalf_px + 1.5) / scale)) + 1;
    if (touchesMask(mask_, toCv(u_from), reach)) return {};
    cv::Mat patch, correlation;
    cv::getRectSubPix(source, {kSide_px, kSide_px}, centre, patch);
    cv::Scalar mean, deviation;
    cv::meanStdDev(patch, mean, deviation);
    if (deviation[0] < kMinDeviation) return {};
    patch.convertTo(patch, CV_32F, 1 / (kSide_px * deviation[0]),
                    -mean[0] / (kSide_px * deviation[0]));
    cv::filter2D(to_(*region), correlation, CV_32F, patch);  // also reads around the region
    cv::divide(correlation, norm_(*region), correlation);
    if (!mask_.empty()) correlation.setTo(-1, allowed(*region) == 0);
    return correlation;
  }

 private:
  const cv::Mat from_;
  const double factor_;
  const cv::Mat mask_;
  cv::Mat to_;       ///< float
  cv::Mat norm_;     ///< of the patch around each pixel of to_, without its mean
  cv::Mat allowed_;  ///< of the size of to_, 0 where a patch touches the mask; empty: no mask
  std::map<int, cv::Mat> from_at_;  ///< by size
};

/// A feature and its map point in the previous camera.
using Point = std::pair<const Feature*, Eigen::Vector3d>;

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

/// Size of the point's patch in the next image; empty if it is too small or too large.
std::optional<int> sizeOf(const Point& point, const Eigen::Isometry3d& T_next_previous) {
  const double z = (T_next_previous * point.second).z();
  if (!(z > 0)) return std::nullopt;
  const auto size =
      std::lround(std::log(point.second.z() / z) / std::log(ScaledPatches::kSizeStep));
  if (std::abs(size) > kMaxSize) return std::nullopt;
  return static_cast<int>(size);
}

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

  /// Sets selected_ to each point's response at its size after this displacement.
  void selectResponses(const Eigen::Vector3d& path) {
    const Eigen::Isometry3d T = exponentialMap({0, 0, 0}, path).inverse();
    selected_.assign(points_.size(), nullptr);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const auto size = sizeOf(points_[i], T);
      if (!size) continue;
      const auto [entry, is_new] = responses_.try_emplace({i, *size});
      if (is_new) {
        const cv::Point pixel = patches_.resized(camera_.project(T * points_[i].second));
        entry->second = responseAround(pixel.y, *points_[i].first, *size);
      }
      if (!entry->second.correlation.empty()) selected_[i] = &entry->second;
    }
  }

  Response responseAround(int row, const Feature& feature, int size) {
    constexpr int kReach = kMaxVertical_px + kRowChange_px, kSide = 2 * kTolerance_px + 1;
    Response response;
    cv::Rect region(0, row - kReach, patches_.size().width, 2 * kReach + 1);
    const cv::Mat correlation = patches_.correlate(feature.u, size, &region);
    if (correlation.empty()) return response;
    cv::dilate(correlation, response.correlation, cv::Mat::ones(kSide, kSide, CV_8U));
    cv::Scalar mean, deviation;
    cv::meanStdDev(response.correlation, mean, deviation, patches_.allowed(region));
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
      const Eigen::Vector3d p = T_next_previous * points_[i].second;
      if (!(p.z() > 0)) continue;
      const cv::Mat& correlation = selected_[i]->correlation;
      const cv::Point pixel = patches_.resized(camera_.project(p));
      const cv::Point at = pixel - selected_[i]->origin;
      if (!cv::Rect({0, 0}, correlation.size()).contains(at) || patches_.isMasked(pixel)) continue;
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
    const cv::Point pixel = patches->resized(camera.project(T_next_previous * point.second));
    cv::Rect region(pixel.x - reach_px, pixel.y - reach_px, 2 * reach_px + 1, 2 * reach_px + 1);
    const cv::Mat correlation = patches->correlate(point.first->u, *size, &region);
    if (correlation.empty()) continue;
    double peak = 0;
    cv::Point offset;
    cv::minMaxLoc(correlation, nullptr, &peak, nullptr, &offset);
    if (peak < kMinCorrelation) continue;
    Feature feature = *point.first;
    feature.age += 1;
    feature.u = patches->original(region.tl() + offset);
    feature.flow = Eigen::Vector2d::Zero();  // unknown
    feature.sigma = 1 / (camera.fx * patches->factor());
    matches.push_back(feature);
  }
  return matches;
}

}  // namespace

std::optional<RelocalisedPose> locateBySearch(const PinholeCamera& camera, const cv::Mat& mask,
                                              const LocalMap& map, const MotionModel& motion,
                                              const std::vector<Feature>& features,
                                              const cv::Mat& previous, const cv::Mat& image,
                                              std::int64_t stamp_ns) {
  const Eigen::Isometry3d& T_w_previous = motion.T_w_c();
  const std::vector<Point> points = pointsOf(map, features, T_w_previous);
  if (points.size() < kMinRatedPoints) return std::nullopt;
  const Eigen::Vector3d path =
      T_w_previous.linear().transpose() *
      (motion.extrapolate(stamp_ns).translation() - T_w_previous.translation());
  const auto coarse = PoseRating(camera, points, previous, image, mask).best(path);
  if (!coarse) return std::nullopt;

  RelocalisedPose result;
  result.T_w_c = T_w_previous * *coarse;
  for (const auto& [width, reach] : kLevels) {
    ScaledPatches patches(camera, previous, image, mask, width);
    auto pose = poseOfMatches(
        camera, map, result.T_w_c,
        matchesNear(camera, points, result.T_w_c.inverse() * T_w_previous, reach, &patches),
        kMinInliers, kMinInlierShare);
    if (!pose) return std::nullopt;
    result = std::move(*pose);
  }
  const double distance = (result.T_w_c.translation() - T_w_previous.translation()).norm();
  const double max_deviation = maxDeviation(path.norm(), map, features, T_w_previous);
  if (!(std::abs(distance - path.norm()) <= max_deviation)) return std::nullopt;
  return result;
}

}  // namespace gsv
