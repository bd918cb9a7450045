// Degenerate input: failures are reported by a status, and no output is NaN or infinite.

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "support/road_image.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

RoadScene road() {
  RoadScene scene;
  scene.addPatch(6000, -2.5, 2.5, 0, 60, 0, 1);
  return scene;
}

void expectFinite(const ScaleRecovery::Output& output) {
  const ScaleEstimate& s = output.scale;
  EXPECT_TRUE(areFinite(s.raw_scale, s.scale, s.sigma, s.height, s.n_c));
  EXPECT_EQ(s.status == ScaleStatus::kUnknown, s.scale == 0);
  EXPECT_EQ(output.plane.height == 0, s.raw_scale == 0);
  EXPECT_EQ(output.ground_points_c.size(), static_cast<std::size_t>(s.window_points));
  EXPECT_EQ(output.ground_feature_ids.size(), static_cast<std::size_t>(s.ground_points));
  for (const Eigen::Vector3f& point : output.ground_points_c) EXPECT_TRUE(isFinite(point));
  if (!output.pose) return;
  EXPECT_TRUE(areFinite(output.pose->T_o_c, output.pose->covariance, output.pose->twist_c,
                        output.pose->twist_covariance, output.pose->distance));
}

/// Drives over the road with one disturbed frame in the middle: outputs stay finite, and the scale
/// is correct at the end. Every second frame has an image, without texture.
void expectSurvives(const std::function<void(VoFrame&)>& disturb) {
  const RoadScene scene = road();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i < 60; ++i) {
    VoFrame frame = scene.frame(i);
    if (i == 30) disturb(frame);
    output = recovery.process(frame, i % 2 == 0 ? cv::Mat()
                                                : cv::Mat(frame.camera.height, frame.camera.width,
                                                          CV_8UC1, cv::Scalar(90)));
    expectFinite(output);
  }
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.scale.scale * scene.height, 1.65, 0.05);
}

TEST(DegenerateRoad, OneInvalidFrameDoesNotAffectTheNextOnes) {
  void (*const kChanges[])(float, TrackedFeature*) = {
      [](float bad, TrackedFeature* f) { f->p_c.y() = bad; },
      [](float bad, TrackedFeature* f) { f->p_c.z() = bad; },
      [](float bad, TrackedFeature* f) { f->depth_sigma = bad; },
      [](float bad, TrackedFeature* f) { f->u.x() = bad; }};
  for (const double number : {kNan, kInfinity, -kInfinity, 1e300, 1e30, -1e30, 1e10}) {
    SCOPED_TRACE(number);
    expectSurvives([&](VoFrame& f) { f.T_w_c.translation().x() = number; });
    expectSurvives([&](VoFrame& f) { f.T_w_c.linear()(1, 1) = number > 1 ? kNan : number; });
    for (const auto change : kChanges) {
      expectSurvives([&](VoFrame& f) {
        for (auto& feature : f.features) change(static_cast<float>(number), &feature);
      });
    }
  }
}

TEST(DegenerateRoad, ASceneWithoutRoadHasNoScale) {
  const auto run = [](const char* name,
                      const std::function<void(std::size_t, TrackedFeature&)>& change) {
    SCOPED_TRACE(name);
    const RoadScene scene = road();
    ScaleRecovery recovery(recoveryOptions());
    for (std::uint32_t i = 0; i < 40; ++i) {
      VoFrame frame = scene.frame(i);
      for (std::size_t k = 0; k < frame.features.size(); ++k) change(k, frame.features[k]);
      const auto output = recovery.process(frame);
      expectFinite(output);
      EXPECT_EQ(output.scale.status, ScaleStatus::kUnknown);
      EXPECT_FALSE(output.pose);
    }
  };
  run("all points coincide", [](std::size_t, auto& f) { f.p_c = {0.1f, 0.7f, 5.f}; });
  run("collinear points", [](std::size_t k, auto& f) {
    f.p_c = {0.f, 0.7f, 3.f + 0.01f * static_cast<float>(k)};
  });
  run("points behind the camera", [](std::size_t, auto& f) { f.p_c = -f.p_c; });
  run("no points", [](std::size_t, auto& f) { f.has_point = false; });
  run("points above the camera", [](std::size_t, auto& f) { f.p_c.y() = -f.p_c.y(); });
  run("only one feature has a point", [](std::size_t k, auto& f) { f.has_point = k == 0; });
  run("depth sigma of 1e9", [](std::size_t, auto& f) { f.depth_sigma = 1e9f; });
}

}  // namespace
}  // namespace gsv
