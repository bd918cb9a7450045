#include "vo/tracking.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "common/parallel_loop.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "vo/corners.hpp"
#include "vo/lucas_kanade.hpp"

namespace ground_scale_vo {
namespace {

/// Pyramid levels above the full resolution when there is a prediction: it is accurate to a few
/// pixels, and one level doubles the reach of the window.
constexpr int kLevelsNearPrediction = 1;
constexpr int kPyramidLevels = 4;  ///< above the full resolution
/// [px] largest distance after tracking forward and backward; most features return to 0.1 px.
constexpr double kMaxReturnError_px = 0.7;
/// [normalised image coordinates] standard deviation of a tracked corner without flow, 0.7 px at a
/// focal length of 718, and the rotation-compensated flow that doubles its variance.
constexpr double kTrackedSigma = 0.001, kSigmaDoublingFlow = 0.028;
/// [px] least side of a grid cell: corners nearer to each other share most of their patches.
constexpr int kMinCell_px = 8;
/// [px] Corners are detected in the finest level of the pyramid that has at most as many pixels: in
/// a larger one the time grows, the number of cells does not.
constexpr std::size_t kMaxDetection_px = 1'500'000;

/// With the margin that the interpolation between pixels needs.
bool isInside(const cv::Mat& image, const cv::Point2f& u) {
  return cv::Rect2f(1.f, 1.f, static_cast<float>(image.cols) - 3.f,
                    static_cast<float>(image.rows) - 3.f)
      .contains(u);
}

/// [corners] minimum number in an image that is not black, covered or blank. The image of a street
/// has several hundred, and a pose needs some tens.
constexpr std::size_t kMinCorners = 60;

/// [percent] minimum share of the features that a stationary camera tracks from one image to the
/// next. With a smaller share, an object passes in front of the camera, and the flow of the other
/// features does not imply a standstill.
constexpr std::size_t kStandstillMinTrackedPercent = 90;

/// Grey levels beyond these may be clipped.
constexpr int kMinGrey = 8, kMaxGrey = 247;
/// Minimum fraction of the pixels that are unclipped in both images.
constexpr double kMinUnclipped = 0.2;
/// [ratio of grey levels] a smaller step is within the noise of the image content; a larger one
/// clips most pixels.
constexpr double kMinStep = 1.25, kMaxStep = 5;
/// The logarithm of the step must be this many times the third quartile of the pixels' deviations
/// from it, so that image motion is not taken for a change of exposure.
constexpr double kMinSignificance = 3;

}  // namespace

static_assert(FeatureTracker::kPatchSide == kTrackedSide);

FeatureTracker::FeatureTracker(const OdometryOptions& options, const cv::Mat& mask)
    : options_(options) {
  if (mask.empty()) return;
  cv::erode(mask, allowed_, cv::Mat::ones(2 * reach() + 1, 2 * reach() + 1, CV_8U));
}

/// [px] from a corner at a whole pixel to the last pixel on which its strength or its patch, with
/// gradients, depends.
int FeatureTracker::reach() const { return std::max(kPatchSide / 2, kCornerReach) + 1; }

/// Precondition: isInside() of an image.
bool FeatureTracker::isMasked(const cv::Point2f& u) const {
  return !allowed_.empty() && allowed_.at<unsigned char>(cvRound(u.y), cvRound(u.x)) == 0;
}

ImagePyramid FeatureTracker::pyramid(const cv::Mat& image) const {
  ImagePyramid result;
  result.levels = trackingPyramid(image, kPyramidLevels);
  result.image = result.levels.front();
  return result;
}

CornerCriteria FeatureTracker::criteria(int image_width) const {
  const auto cell = static_cast<int>(std::lround(options_.cell_size * image_width));
  return {std::max(kMinCell_px, cell), reach(), kPatchSide / 2, options_.min_corner_strength,
          options_.min_corner_ratio};
}

std::vector<cv::Point2f> FeatureTracker::detect(const ImagePyramid& image,
                                                const std::vector<cv::Point2f>& occupied) const {
  std::size_t level = 0;
  while (level + 1 < image.levels.size() && image.levels[level].total() > kMaxDetection_px) {
    ++level;
  }
  if (level == 0) return detectCorners(image.image, allowed_, occupied, criteria(image.image.cols));
  const auto scale = static_cast<float>(1 << level);
  cv::Mat allowed;
  if (!allowed_.empty()) {
    cv::resize(allowed_, allowed, image.levels[level].size(), 0, 0, cv::INTER_NEAREST);
  }
  std::vector<cv::Point2f> scaled = occupied;
  for (cv::Point2f& u : scaled) u /= scale;
  std::vector<cv::Point2f> corners =
      detectCorners(image.levels[level], allowed, scaled, criteria(image.levels[level].cols));
  for (cv::Point2f& u : corners) u *= scale;
  return corners;
}

/// Whether the patch of `there` is found in the second image, and from there in the first image
/// again, where it comes from. point: initial guess, replaced by the result.
bool FeatureTracker::trackThereAndBack(const cv::Point2f& from_point, int levels,
                                       PyramidSearch* there, PyramidSearch* back, const cv::Mat& to,
                                       cv::Point2f* point) const {
  if (!there->find(levels, point) || !isInside(to, *point) || isMasked(*point)) return false;
  back->setPatch(*point);
  cv::Point2f returned = from_point;
  return back->find(0, &returned) && cv::norm(returned - from_point) <= kMaxReturnError_px;
}

FeatureTracker::Tracks FeatureTracker::track(const ImagePyramid& from, const ImagePyramid& to,
                                             const std::vector<cv::Point2f>& from_points,
                                             const std::vector<cv::Point2f>& predicted) const {
  const int levels = kPyramidLevels;
  const int levels_near_prediction = std::min(kLevelsNearPrediction, levels);
  Tracks tracks;
  tracks.points = predicted.empty() ? from_points : predicted;
  tracks.ok.assign(from_points.size(), 0);
  parallelLoop(static_cast<int>(from_points.size()), [&](const cv::Range& range) {
    PyramidSearch there(from.levels, to.levels);
    PyramidSearch back(to.levels, from.levels);
    for (auto i = static_cast<std::size_t>(range.start); i < static_cast<std::size_t>(range.end);
         ++i) {
      if (i + 1 < static_cast<std::size_t>(range.end)) {
        there.prefetch(from_points[i + 1], tracks.points[i + 1], levels_near_prediction);
      }
      cv::Point2f& point = tracks.points[i];
      there.setPatch(from_points[i]);
      bool ok = !predicted.empty() && trackThereAndBack(from_points[i], levels_near_prediction,
                                                        &there, &back, to.image, &point);
      if (!ok) {
        point = from_points[i];
        ok = trackThereAndBack(from_points[i], levels, &there, &back, to.image, &point);
      }
      tracks.ok[i] = ok;
    }
  });
  return tracks;
}

FrameToFrameTracking::FrameToFrameTracking(const PinholeCamera& camera,
                                           const OdometryOptions& options, const cv::Mat& mask)
    : options_(options), camera_(camera), mask_(mask), tracker_(options, mask) {}

ImagePyramid FrameToFrameTracking::preprocess(const cv::Mat& image) const {
  ImagePyramid result = tracker_.pyramid(image);
  if (hasImage()) {
    result.exposure =
        previous_.exposure * exposureStep(previous_.levels.back(), result.levels.back());
  }
  return result;
}

std::vector<Feature> FrameToFrameTracking::track(const ImagePyramid& next, std::int64_t stamp_ns,
                                                 const std::vector<cv::Point2f>& predicted,
                                                 const Eigen::Matrix3d& R_next_previous,
                                                 std::vector<RejectedFeature>* rejected) const {
  const double dt = secondsUntil(stamp_ns);
  const std::vector<cv::Point2f> points = pixels();
  const double gain = next.exposure / previous_.exposure;
  const FeatureTracker::Tracks tracks =
      gain == 1 ? tracker_.track(previous_, next, points, predicted)
                : tracker_.track(tracker_.pyramid(applyGain(previous_.image, gain)), next, points,
                                 predicted);
  std::vector<Feature> found;
  found.reserve(features_.size());
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const Feature& previous = features_[i];
    if (!tracks.ok[i]) {
      rejected->push_back({previous.id, previous.u.cast<float>(), RejectReason::kNotFound});
      continue;
    }
    Feature feature = previous;
    feature.age += 1;
    feature.u = Eigen::Vector2d(tracks.points[i].x, tracks.points[i].y);
    feature.flow =
        dt > 0 ? Eigen::Vector2d((feature.u - previous.u) / dt) : Eigen::Vector2d::Zero();
    const Eigen::Vector3d rotated = R_next_previous * camera_.ray(previous.u);
    const double flow = (camera_.ray(feature.u).head<2>() - rotated.head<2>() / rotated.z()).norm();
    feature.sigma = kTrackedSigma * std::hypot(1.0, flow / kSigmaDoublingFlow);
    found.push_back(feature);
  }
  return found;
}

/// [px] since the previous image.
double FrameToFrameTracking::medianFlow(const std::vector<Feature>& found) const {
  const std::vector<Feature> previous = entriesOf(found, features_);
  std::vector<double> flow;
  for (std::size_t i = 0; i < found.size(); ++i) {
    flow.push_back((found[i].u - previous[i].u).norm());
  }
  return flow.empty() ? 0 : median(flow);
}

bool FrameToFrameTracking::advanceUnlessStandstill(ImagePyramid next, std::int64_t stamp_ns,
                                                   std::vector<Feature> found) {
  if (medianFlow(found) < options_.standstill_flow * camera_.width &&
      100 * found.size() > kStandstillMinTrackedPercent * features_.size()) {
    return false;
  }
  advance(std::move(next), stamp_ns, std::move(found));
  return true;
}

void FrameToFrameTracking::advance(ImagePyramid next, std::int64_t stamp_ns,
                                   std::vector<Feature> found) {
  previous_ = std::move(next);
  previous_stamp_ns_ = stamp_ns;
  features_ = std::move(found);
}

void FrameToFrameTracking::detectNew() {
  for (const cv::Point2f& corner : tracker_.detect(previous_, pixels())) {
    Feature feature;
    feature.id = next_feature_id_++;
    feature.sigma = kTrackedSigma;
    feature.u = Eigen::Vector2d(corner.x, corner.y);
    features_.push_back(feature);
  }
}

Descriptors FrameToFrameTracking::describeFeatures() const {
  return {previous_.image, pixels(), mask_};
}

Descriptors FrameToFrameTracking::describeCorners(const ImagePyramid& image) const {
  return {image.image, tracker_.detect(image, {}), mask_};
}

std::vector<cv::Point2f> FrameToFrameTracking::pixels() const {
  std::vector<cv::Point2f> points;
  points.reserve(features_.size());
  for (const Feature& feature : features_) points.push_back(toCv(feature.u));
  return points;
}

bool FrameToFrameTracking::isTextureless(const ImagePyramid& image, std::size_t found) const {
  return found < kMinCorners && tracker_.detect(image, {}).size() < kMinCorners;
}

double exposureStep(const cv::Mat& previous, const cv::Mat& current) {
  std::vector<double> ratios;
  ratios.reserve(previous.total());
  for (int y = 0; y < previous.rows; ++y) {
    const unsigned char *a = previous.ptr(y), *b = current.ptr(y);
    for (int x = 0; x < previous.cols; ++x) {
      if (a[x] < kMinGrey || b[x] < kMinGrey || a[x] > kMaxGrey || b[x] > kMaxGrey) continue;
      ratios.push_back(static_cast<double>(b[x]) / a[x]);
    }
  }
  if (ratios.empty() ||
      static_cast<double>(ratios.size()) < kMinUnclipped * static_cast<double>(previous.total())) {
    return 1;
  }
  // Nearly always the median is no step; counting takes less time than finding it.
  const auto brighter =
      std::count_if(ratios.begin(), ratios.end(), [](double ratio) { return ratio >= kMinStep; });
  const auto darker = std::count_if(ratios.begin(), ratios.end(),
                                    [](double ratio) { return ratio <= 1 / kMinStep; });
  if (2 * static_cast<std::size_t>(std::max(brighter, darker)) < ratios.size()) return 1;
  const double step = median(&ratios), size = std::abs(std::log(step));
  if (size < std::log(kMinStep) || size > std::log(kMaxStep)) return 1;
  for (double& ratio : ratios) ratio = std::abs(std::log(ratio / step));
  const auto quartile = ratios.begin() + static_cast<std::ptrdiff_t>(3 * ratios.size() / 4);
  std::nth_element(ratios.begin(), quartile, ratios.end());
  return kMinSignificance * *quartile < size ? step : 1;
}

cv::Mat applyGain(const cv::Mat& image, double factor) {
  if (factor == 1) return image;
  cv::Mat result;
  image.convertTo(result, CV_8U, factor);
  return result;
}

}  // namespace ground_scale_vo
