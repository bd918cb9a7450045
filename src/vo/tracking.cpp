#include "vo/tracking.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "vo/lucas_kanade.hpp"

namespace gsv {
namespace {

/// [normalised image coordinates] standard deviation of a tracked corner without flow, 0.7 px at a
/// focal length of 718, and the rotation-compensated flow that doubles its variance.
constexpr double kTrackedSigma = 0.001, kSigmaDoublingFlow = 0.028;

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
  const double step = median(&ratios), size = std::abs(std::log(step));
  if (size < std::log(kMinStep) || size > std::log(kMaxStep)) return 1;
  for (double& ratio : ratios) ratio = std::abs(std::log(ratio / step));
  const auto quartile = ratios.begin() + static_cast<std::ptrdiff_t>(3 * ratios.size() / 4);
  std::nth_element(ratios.begin(), quartile, ratios.end());
  return kMinSignificance * *quartile < size ? step : 1;
}

ImagePyramid Tracking::preprocess(const cv::Mat& image) const {
  ImagePyramid result = trackingPyramid(image);
  if (!previous_.levels.empty()) {
    result.exposure =
        previous_.exposure * exposureStep(previous_.levels.back(), result.levels.back());
  }
  return result;
}

std::vector<Feature> Tracking::track(const ImagePyramid& next, std::int64_t stamp_ns,
                                     const std::vector<cv::Point2f>& predicted,
                                     const Eigen::Matrix3d& R_next_previous) const {
  const double dt = secondsUntil(stamp_ns);
  const double gain = next.exposure / previous_.exposure;
  const auto tracks =
      trackPoints(gain == 1 ? previous_ : trackingPyramid(applyGain(previous_.image, gain)), next,
                  pixels(), predicted, corners_.allowed());
  std::vector<Feature> found;
  found.reserve(features_.size());
  for (std::size_t i = 0; i < features_.size(); ++i) {
    if (!tracks[i]) continue;
    const Feature& previous = features_[i];
    Feature feature = previous;
    feature.age += 1;
    feature.u = Eigen::Vector2d(tracks[i]->x, tracks[i]->y);
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
double Tracking::medianFlow(const std::vector<Feature>& found) const {
  const std::vector<Feature> previous = entriesOf(found, features_);
  std::vector<double> flow;
  for (std::size_t i = 0; i < found.size(); ++i) {
    flow.push_back((found[i].u - previous[i].u).norm());
  }
  return flow.empty() ? 0 : median(flow);
}

bool Tracking::advanceUnlessStandstill(ImagePyramid next, std::int64_t stamp_ns,
                                       std::vector<Feature> found) {
  if (medianFlow(found) < options_.standstill_flow * camera_.width &&
      100 * found.size() > kStandstillMinTrackedPercent * features_.size()) {
    return false;
  }
  advance(std::move(next), stamp_ns, std::move(found));
  return true;
}

void Tracking::advance(ImagePyramid next, std::int64_t stamp_ns, std::vector<Feature> found) {
  previous_ = std::move(next);
  previous_stamp_ns_ = stamp_ns;
  features_ = std::move(found);
}

void Tracking::detectNew() {
  for (const cv::Point2f& corner : corners_.detect(previous_, pixels())) {
    Feature feature;
    feature.id = next_feature_id_++;
    feature.sigma = kTrackedSigma;
    feature.u = Eigen::Vector2d(corner.x, corner.y);
    features_.push_back(feature);
  }
}

Descriptors Tracking::describeFeatures() const { return {previous_.image, pixels(), mask_}; }

Descriptors Tracking::describeCorners(const ImagePyramid& image) const {
  return {image.image, corners_.detect(image, {}), mask_};
}

std::vector<cv::Point2f> Tracking::pixels() const {
  std::vector<cv::Point2f> points;
  points.reserve(features_.size());
  for (const Feature& feature : features_) points.push_back(toCv(feature.u));
  return points;
}

bool Tracking::isTextureless(const ImagePyramid& image, std::size_t found) const {
  return found < kMinCorners && corners_.detect(image, {}).size() < kMinCorners;
}

}  // namespace gsv
