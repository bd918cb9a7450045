// Time of the expensive steps of the scale stage over the size of the input.

#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "ground_scale_vo/scale/direct_plane_estimator.hpp"
#include "ground_scale_vo/scale/ground_points.hpp"
#include "ground_scale_vo/scale/plane_fit.hpp"
#include "support/road_image.hpp"
#include "support/road_scene.hpp"

namespace ground_scale_vo {
namespace {

/// A road of n points 1.9 to 9 VO units (2.7 to 13 camera heights) ahead; those within the image
/// become features. The depth noise is 2 %.
RoadScene road(int n) {
  RoadScene scene;
  scene.depth_noise = 0.02;
  scene.addPatch(n, -1.2, 1.2, 1.9, 9.0, 0, 1);
  return scene;
}

void overFeatureCounts(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("features")->ArgsProduct({{125, 250, 500, 1000, 2000}})->Complexity();
  benchmark->Unit(benchmark::kMicrosecond);
}

/// Ground point extraction, or its triangulation alone.
void extraction(benchmark::State& state, bool delaunay_alone) {
  const RoadScene scene = road(static_cast<int>(state.range(0)));
  const VoFrame frame = scene.frame(0);
  RoadPrior prior = priorOf(scene);
  prior.chord = Chord{prior.forward_c, scene.step, Eigen::Vector3d::Zero()};
  const GroundPointExtraction extraction({});
  GroundPointExtraction::Result result;
  for (auto _ : state) {
    result = extraction.extract(frame, prior, Eigen::Isometry3d::Identity());
    if (delaunay_alone) state.SetIterationTime(1e-3 * result.delaunay_ms);
  }
  state.counters["triangles"] = result.triangles;
  state.counters["ground_points"] = static_cast<double>(result.points.size());
  state.SetComplexityN(state.range(0));
}
void delaunay(benchmark::State& state) { extraction(state, true); }
void groundPointExtraction(benchmark::State& state) { extraction(state, false); }
BENCHMARK(delaunay)->Apply(overFeatureCounts)->UseManualTime();
BENCHMARK(groundPointExtraction)->Apply(overFeatureCounts);

void planeFit(benchmark::State& state) {
  // Four times as many points as needed, because the image does not show all of them.
  const RoadScene scene = road(4 * static_cast<int>(state.range(0)));
  std::vector<PlanePoint> points;
  for (const TrackedFeature& feature : scene.frame(0).features) {
    if (points.size() == static_cast<std::size_t>(state.range(0))) break;
    const Eigen::Vector3d p = feature.p_c.cast<double>();
    points.push_back({p, Eigen::Vector3d::Zero(), p.z(), feature.depth_sigma});
  }
  const PlaneFit fit({});
  const RoadPrior prior = priorOf(scene);
  std::size_t inliers = 0;
  for (auto _ : state) inliers = fit.fit(points, prior, scene.height).inliers.size();
  state.counters["inliers"] = static_cast<double>(inliers);
  state.SetComplexityN(state.range(0));
}
BENCHMARK(planeFit)->Apply(overFeatureCounts);

/// One frame against its reference images, over the image width.
void directPlaneEstimation(benchmark::State& state) {
  RoadScene scene = road(400);
  const double scale = static_cast<double>(state.range(0)) / scene.camera.width;
  scene.camera.width = static_cast<int>(state.range(0));
  scene.camera.height = static_cast<int>(std::lround(scale * scene.camera.height));
  for (double* length : {&scene.camera.fx, &scene.camera.fy, &scene.camera.cx, &scene.camera.cy}) {
    *length *= scale;
  }
  DirectPlaneEstimator estimator({});
  CameraPath path;
  // The first frames are not timed: they have too few reference images.
  constexpr std::uint32_t kUntimed = 4, kTimed = 4;
  std::vector<cv::Mat> images;
  for (std::uint32_t i = 0; i < kUntimed + kTimed; ++i) {
    images.push_back(roadImage(scene, scene.step * i));
  }
  const auto estimate = [&](std::uint32_t i) {
    const VoFrame frame = scene.frame(i);
    path.add(frame.T_w_c);
    path.newest().prior = priorOf(scene);
    return estimator.estimate(frame, images[i], scene.height, &path);
  };
  DirectPlaneEstimator::Result result;
  std::uint32_t next = 0;
  for (auto _ : state) {
    if (next == 0 || next == images.size()) {
      state.PauseTiming();
      path = CameraPath();
      for (next = 0; next < kUntimed; ++next) estimate(next);
      state.ResumeTiming();
    }
    result = estimate(next++);
  }
  state.counters["patches"] = result.patches;
}
BENCHMARK(directPlaneEstimation)
    ->ArgName("width")
    ->Arg(620)
    ->Arg(1241)
    ->Arg(1920)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace ground_scale_vo
