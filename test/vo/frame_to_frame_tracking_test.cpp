#include "vo/frame_to_frame_tracking.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/vo/exposure.hpp"
#include "support/scene.hpp"
#include "support/texture.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::int64_t kStamp = 1'000'000'000, kPeriod = 100'000'000;  // [ns]

/// Part of a texture (grey 20-100): the scene after it has moved left by shift_px.
cv::Mat movedScene(int shift_px) {
  cv::Mat texture = test::blurredNoise(4, {800 + 20, 248});
  cv::normalize(texture, texture, 20, 100, cv::NORM_MINMAX);
  return texture(cv::Rect(shift_px, 0, 800, 248)).clone();
}

/// Tracks the corners of movedScene(0), its previous image.
FrameToFrameTracking trackingScene() {
  FrameToFrameTracking tracking(test::testCamera(), {}, {});
  tracking.advance(tracking.preprocess(movedScene(0)), kStamp, {});
  tracking.detectNew();
  return tracking;
}

std::vector<Feature> track(const FrameToFrameTracking& tracking, const cv::Mat& image) {
  std::vector<RejectedFeature> rejected;
  return tracking.track(tracking.preprocess(image), kStamp + kPeriod, {},
                        Eigen::Matrix3d::Identity(), &rejected);
}

TEST(FrameToFrameTracking, FollowsFeaturesOverAStepOfTheExposure) {
  FrameToFrameTracking tracking = trackingScene();
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
  // The exposure is relative to the first image.
  const ImagePyramid darker = tracking.preprocess(applyGain(movedScene(0), 0.6));
  EXPECT_NEAR(darker.exposure, 0.6, 0.02);
  tracking.advance(darker, kStamp + kPeriod, {});
  EXPECT_NEAR(tracking.preprocess(applyGain(movedScene(0), 0.36)).exposure, 0.36, 0.02);
}

TEST(FrameToFrameTracking, KeepsTheImageOnlyAtAStandstill) {
  const auto advances = [](int shift_px, double noise_px, double share) {
    FrameToFrameTracking tracking = trackingScene();
    const std::size_t count = tracking.features().size();
    std::vector<Feature> found = track(tracking, movedScene(shift_px));
    for (Feature& feature : found) feature.u.x() += noise_px;
    found.resize(static_cast<std::size_t>(share * static_cast<double>(found.size())));
    const bool advanced = tracking.advanceUnlessStandstill(
        tracking.preprocess(movedScene(shift_px)), kStamp + kPeriod, found);
    EXPECT_NEAR(tracking.secondsUntil(kStamp + kPeriod), advanced ? 0 : 0.1, 1e-12);
    EXPECT_EQ(tracking.features().front().age, advanced ? 1u : 0u);
    EXPECT_EQ(tracking.features().size(), advanced ? found.size() : count);
    return advanced;
  };
  EXPECT_FALSE(advances(0, 0, 1));
  EXPECT_FALSE(advances(0, 0.2, 1)) << "noise";
  EXPECT_TRUE(advances(0, 0.4, 1)) << "slow motion";
  EXPECT_TRUE(advances(4, 0, 1));
  EXPECT_TRUE(advances(0, 0, 0.5)) << "an object covers half of the image";
}

}  // namespace
}  // namespace ground_scale_vo
