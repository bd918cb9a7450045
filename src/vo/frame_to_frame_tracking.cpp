#include "vo/frame_to_frame_tracking.hpp"

#include <cmath>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/vo/exposure.hpp"

namespace ground_scale_vo {
namespace {

/// [corners] minimum number in an image that is not black, covered or blank. The image of a street
/// has several hundred, and a pose needs some tens.
constexpr std::size_t kMinCorners = 60;

/// [percent] minimum share of the features that a stationary camera tracks from one image to the
/// next. With a smaller share, an object passes in front of the camera, and the flow of the other
/// features does not imply a standstill.
constexpr std::size_t kStandstillMinTrackedPercent = 90;

}  // namespace

FrameToFrameTracking::FrameToFrameTracking(const PinholeCamera& camera,
                                           const OdometryOptions& options, const cv::Mat& mask)
    : options_(options), camera_(camera), mask_(mask), tracker_(options.tracker, mask) {}

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
    feature.sigma = options_.feature_sigma * std::hypot(1.0, flow / options_.feature_sigma_flow);
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
    feature.sigma = options_.feature_sigma;
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

}  // namespace ground_scale_vo
