#include "vo/frame_to_frame_tracking.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/vo/exposure.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::int64_t kStamp = 1'000'000'000, kPeriod = 100'000'000;  // [ns]

/// Part of a texture (grey 20-100): the scene after it has moved left by shift_px.
cv::Mat movedScene(int shift_px) {
  cv::Mat texture(248, 800 + 20, CV_8UC1);
  cv::RNG(4).fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {0, 0}, 2);
  cv::normalize(texture, texture, 20, 100, cv::NORM_MINMAX);
  return texture(cv::Rect(shift_px, 0, 800, 248)).clone();
}

/// Tracks the corners of movedScene(0), its previous image.
FrameToFrameTracking trackingScene() {
  FrameToFrameTracking tracking(test::testCamera(), {}, {});
  tracking.advance(tracking.pyramid(movedScene(0)), kStamp, {});
  tracking.detectNew();
  return tracking;
}

std::vector<Feature> track(const FrameToFrameTracking& tracking, const cv::Mat& image,
                           const Eigen::Matrix3d& R_next_previous = Eigen::Matrix3d::Identity()) {
  std::vector<RejectedFeature> rejected;
  return tracking.track(tracking.pyramid(image), kStamp + kPeriod, {}, R_next_previous, &rejected);
}

TEST(FrameToFrameTracking, FollowsFeaturesOverAStepOfTheExposure) {
  const FrameToFrameTracking tracking = trackingScene();
  ASSERT_GT(tracking.features().size(), 300u);
  for (const double gain : {1.0, 0.5, 2.2}) {
    const std::vector<Feature> found = track(tracking, applyGain(movedScene(4), gain));
    EXPECT_GT(found.size(), tracking.features().size() * 9 / 10) << gain;
    const std::vector<Feature> previous = entriesOf(found, tracking.features());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_EQ(found[i].age, previous[i].age + 1);
      EXPECT_LT((found[i].u - previous[i].u - Eigen::Vector2d(-4, 0)).norm(), 0.5) << gain;
      EXPECT_LT((found[i].flow - (found[i].u - previous[i].u) / 0.1).norm(), 1e-9);
    }
  }
}

TEST(FrameToFrameTracking, ReportsTheFeaturesThatItDoesNotFind) {
  const FrameToFrameTracking tracking = trackingScene();
  cv::Mat image = movedScene(0);
  image.colRange(400, 800).setTo(60);
  std::vector<RejectedFeature> rejected;
  const std::vector<Feature> found = tracking.track(tracking.pyramid(image), kStamp + kPeriod, {},
                                                    Eigen::Matrix3d::Identity(), &rejected);
  EXPECT_EQ(found.size() + rejected.size(), tracking.features().size());
  EXPECT_GT(rejected.size(), tracking.features().size() / 3);
  for (const RejectedFeature& feature : rejected) {
    EXPECT_EQ(feature.reason, RejectReason::kNotFound);
    EXPECT_EQ(feature.u, tracking.features()[feature.id].u.cast<float>());
  }
}

TEST(FrameToFrameTracking, TheExposureIsThatSinceTheFirstImage) {
  FrameToFrameTracking tracking = trackingScene();
  const ImagePyramid darker = tracking.pyramid(applyGain(movedScene(0), 0.6));
  EXPECT_NEAR(darker.exposure, 0.6, 0.02);
  tracking.advance(darker, kStamp + kPeriod, {});
  EXPECT_NEAR(tracking.pyramid(applyGain(movedScene(0), 0.36)).exposure, 0.36, 0.02);
}

TEST(FrameToFrameTracking, AnImageWithoutCornersIsTextureless) {
  const FrameToFrameTracking tracking = trackingScene();
  const ImagePyramid blank = tracking.pyramid(cv::Mat(248, 800, CV_8UC1, cv::Scalar(60)));
  EXPECT_TRUE(tracking.isTextureless(blank, 0));
  EXPECT_FALSE(tracking.isTextureless(blank, 100)) << "features were found";
  EXPECT_FALSE(tracking.isTextureless(tracking.pyramid(movedScene(0)), 0));
}

TEST(FrameToFrameTracking, AddsCornersWhereThereAreNoFeatures) {
  FrameToFrameTracking tracking = trackingScene();
  const std::size_t first = tracking.features().size();
  tracking.detectNew();
  EXPECT_LT(tracking.features().size(), first * 4 / 3);
}

/// Number of points whose descriptor in b differs from that in a.
std::size_t differingDescriptors(const Descriptors& a, const Descriptors& b) {
  EXPECT_EQ(a.points(), b.points());
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.points().size(); ++i) {
    const int bits = a.distance(i, b, i);
    count += bits > 0 && bits < 256;  // 256: it has none
  }
  return count;
}

TEST(FrameToFrameTracking, DescriptorsDoNotDependOnMaskedPixels) {
  const cv::Rect hood(0, 200, 800, 48);
  cv::Mat mask(248, 800, CV_8UC1, cv::Scalar(255)), image = movedScene(0);
  mask(hood).setTo(0);
  movedScene(9)(hood).copyTo(image(hood));
  FrameToFrameTracking a(test::testCamera(), {}, mask), b = a;
  a.advance(a.pyramid(movedScene(0)), kStamp, {});
  b.advance(b.pyramid(image), kStamp, {});
  a.detectNew();
  b.detectNew();
  EXPECT_EQ(differingDescriptors(a.describeFeatures(), b.describeFeatures()), 0u);
  EXPECT_EQ(differingDescriptors(a.describeCorners(a.image()), b.describeCorners(b.image())), 0u);
}

TEST(FrameToFrameTracking, SigmaGrowsWithTheFlowThatTheRotationDoesNotExplain) {
  const FrameToFrameTracking tracking = trackingScene();
  const VisualOdometry::Options options;
  const double flow = 4 / test::testCamera().fx;
  const double expected =
      options.feature_sigma * std::hypot(1.0, flow / options.feature_sigma_flow);
  // The rotation to the right moves the centre of the image to the left, as the shift does.
  const Eigen::Matrix3d R = test::pose({0, -flow, 0}, {0, 0, 0}).linear();
  for (const Feature& feature : track(tracking, movedScene(4))) {
    EXPECT_NEAR(feature.sigma, expected, 0.01 * options.feature_sigma);
  }
  for (const Feature& feature : track(tracking, movedScene(4), R)) {
    if (std::abs(feature.u.x() - test::testCamera().cx) > 50) continue;
    EXPECT_NEAR(feature.sigma, options.feature_sigma, 1e-3 * options.feature_sigma);
  }
}

TEST(FrameToFrameTracking, AtAStandstillTheImageIsKept) {
  FrameToFrameTracking tracking = trackingScene();
  const auto sinceImage = [&] { return tracking.secondsUntil(kStamp + kPeriod); };
  tracking.advanceUnlessStandstill(tracking.pyramid(movedScene(0)), kStamp + kPeriod,
                                   track(tracking, movedScene(0)));
  EXPECT_NEAR(sinceImage(), 0.1, 1e-12);
  EXPECT_EQ(tracking.features().front().age, 0u);

  // Noise moves the features by less than a quarter of a pixel.
  std::vector<Feature> noisy = track(tracking, movedScene(0));
  for (Feature& feature : noisy) feature.u.x() += 0.2;
  tracking.advanceUnlessStandstill(tracking.pyramid(movedScene(0)), kStamp + kPeriod, noisy);
  EXPECT_NEAR(sinceImage(), 0.1, 1e-12);

  // A slow motion is more than that.
  std::vector<Feature> slow = track(tracking, movedScene(0));
  for (Feature& feature : slow) feature.u.x() += 0.4;
  FrameToFrameTracking moving = trackingScene();
  EXPECT_TRUE(moving.advanceUnlessStandstill(moving.pyramid(movedScene(0)), kStamp, slow));

  // An object covers half of the image, and the other half does not move.
  std::vector<Feature> half = track(tracking, movedScene(0));
  half.resize(half.size() / 2);
  FrameToFrameTracking covered = trackingScene();
  covered.advanceUnlessStandstill(covered.pyramid(movedScene(0)), kStamp + kPeriod, half);
  EXPECT_EQ(covered.features().size(), half.size());

  tracking.advanceUnlessStandstill(tracking.pyramid(movedScene(4)), kStamp + kPeriod,
                                   track(tracking, movedScene(4)));
  EXPECT_EQ(sinceImage(), 0);
  EXPECT_EQ(tracking.features().front().age, 1u);
}

}  // namespace
}  // namespace ground_scale_vo
