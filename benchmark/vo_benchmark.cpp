// Time of the expensive steps of the visual odometry over the size of the input.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "ground_scale_vo/vo/feature_tracker.hpp"
#include "ground_scale_vo/vo/local_bundle_adjustment.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "ground_scale_vo/vo/patch_alignment.hpp"
#include "ground_scale_vo/vo/pose_estimation.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::keyframePose;
using test::kObservationSigma;
using test::normalised;
using test::pose;
using test::randomPoints;

constexpr int kWidth = 1241;  // KITTI's images
constexpr double kAspect = 376.0 / 1241.0;

/// Blurred noise: corners everywhere. dx, dy: shift of the image content [px].
cv::Mat texture(int width, double dx = 0, double dy = 0) {
  cv::Mat noise(static_cast<int>(width * kAspect), width, CV_8UC1), image;
  cv::RNG generator(1);
  generator.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, image, {0, 0}, 2.0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  const cv::Mat M = (cv::Mat_<double>(2, 3) << 1, 0, dx, 0, 1, dy);
  cv::warpAffine(image, image, M, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return image;
}

/// n corners of an image in random order, or all of them if there are fewer.
std::vector<cv::Point2f> cornersOf(const cv::Mat& image, std::size_t n) {
  FeatureTracker::Options options;
  options.cell_size = 0.0065;  // half of the default: enough cells for 2000 corners
  const FeatureTracker detector(options);
  std::vector<cv::Point2f> corners = detector.detect(detector.pyramid(image), {});
  std::shuffle(corners.begin(), corners.end(), std::mt19937(1));
  corners.resize(std::min(n, corners.size()));
  return corners;
}

void overWidths(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("width")->Arg(620)->Arg(1241)->Arg(1920)->Arg(2482);
}
void overPointCounts(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("points")->ArgsProduct({{125, 250, 500, 1000, 2000}})->Complexity();
}

void pyramid(benchmark::State& state) {
  const cv::Mat image = texture(static_cast<int>(state.range(0)));
  const FeatureTracker tracker({});
  for (auto _ : state) benchmark::DoNotOptimize(tracker.pyramid(image));
}
BENCHMARK(pyramid)->Apply(overWidths)->Unit(benchmark::kMillisecond);

void detector(benchmark::State& state) {
  const cv::Mat image = texture(static_cast<int>(state.range(0)));
  const FeatureTracker tracker({});
  const ImagePyramid pyramid = tracker.pyramid(image);
  std::vector<cv::Point2f> occupied = tracker.detect(pyramid, {});
  // As in a new keyframe: half of the features are still tracked.
  occupied.resize(occupied.size() / 2);
  std::size_t found = 0;
  for (auto _ : state) found = tracker.detect(pyramid, occupied).size();
  state.counters["corners"] = static_cast<double>(found);
}
BENCHMARK(detector)->Apply(overWidths)->Unit(benchmark::kMillisecond);

void tracker(benchmark::State& state) {
  const cv::Mat image = texture(kWidth);
  const FeatureTracker tracker({});
  const ImagePyramid from = tracker.pyramid(image), to = tracker.pyramid(texture(kWidth, 6, 2));
  const auto corners = cornersOf(image, static_cast<std::size_t>(state.range(0)));
  auto predicted = corners;
  // The prediction is off by (1, 0.5) px.
  for (cv::Point2f& u : predicted) u += cv::Point2f(5, 1.5);
  std::size_t found = 0;
  for (auto _ : state) {
    const auto tracks = tracker.track(from, to, corners, predicted);
    found = static_cast<std::size_t>(std::count(tracks.ok.begin(), tracks.ok.end(), 1));
  }
  state.counters["found"] = static_cast<double>(found);
  state.SetComplexityN(static_cast<std::int64_t>(corners.size()));
}
BENCHMARK(tracker)->Apply(overPointCounts)->Unit(benchmark::kMillisecond);

void patchAlignment(benchmark::State& state) {
  const cv::Mat reference = texture(kWidth), current = texture(kWidth, 6, 2);
  const PatchAlignment alignment({});
  const auto corners = cornersOf(reference, static_cast<std::size_t>(state.range(0)));
  std::size_t found = 0;
  for (auto _ : state) {
    found = 0;
    for (const cv::Point2f& corner : corners) {
      const Eigen::Vector2d u(corner.x, corner.y);
      found += alignment
                   .align(reference, u, Eigen::Matrix2d::Identity(), current,
                          u + Eigen::Vector2d(5.6, 2.3))
                   .has_value();
    }
  }
  state.counters["found"] = static_cast<double>(found);
  state.SetComplexityN(static_cast<std::int64_t>(corners.size()));
}
BENCHMARK(patchAlignment)->Apply(overPointCounts)->Unit(benchmark::kMillisecond);

void poseEstimation(benchmark::State& state) {
  std::mt19937 generator(2);
  std::normal_distribution<double> error(0, kObservationSigma);
  const Eigen::Isometry3d T_w_c = pose({0.01, 0.02, 0}, {0.05, 0, 0.8});
  std::vector<PointObservation> observations;
  for (const Eigen::Vector3d& p : randomPoints(static_cast<int>(state.range(0)), 3)) {
    const Eigen::Vector2d e(error(generator), error(generator));
    // One in ten is an outlier.
    const double wrong = observations.size() % 10 == 0 ? 0.02 : 0;
    observations.push_back({p, 0.02 * p,
                            normalised(T_w_c.inverse() * p) + e + Eigen::Vector2d(wrong, 0),
                            kObservationSigma});
  }
  const PoseEstimation estimation({});
  const Eigen::Isometry3d predicted = T_w_c * pose({0.002, 0.002, 0}, {0.01, 0.01, 0.05});
  int inliers = 0;
  for (auto _ : state) inliers = estimation.estimate(predicted, observations).inliers;
  state.counters["inliers"] = inliers;
  state.SetComplexityN(state.range(0));
}
BENCHMARK(poseEstimation)->Apply(overPointCounts)->Unit(benchmark::kMillisecond);

/// A map of twice as many keyframes as the window: the older half is fixed. Each keyframe observes
/// all points.
void bundleAdjustment(benchmark::State& state) {
  const int window = static_cast<int>(state.range(0)), n = static_cast<int>(state.range(1));
  std::mt19937 generator(4);
  std::normal_distribution<double> error(0, kObservationSigma);
  auto world = randomPoints(n, 5);
  for (Eigen::Vector3d& p : world) p.z() += 2.0 * window;  // in front of every keyframe
  LocalMap::Options map_options;
  map_options.keyframes = 2 * window;
  LocalMap map(map_options);
  for (int k = 0; k < 2 * window; ++k) {
    const Eigen::Isometry3d T_w_c = keyframePose(k);
    std::vector<LocalMap::Corner> corners;
    for (std::size_t i = 0; i < world.size(); ++i) {
      const Eigen::Vector2d e(error(generator), error(generator));
      corners.push_back({i, normalised(T_w_c.inverse() * world[i]) + e, kObservationSigma});
    }
    const bool is_adjusted = k >= window;
    map.addKeyframe(is_adjusted ? T_w_c * pose({0.001, 0.001, 0}, {0.01, 0, 0.02}) : T_w_c,
                    corners);
  }
  map.triangulateNew();
  LocalBundleAdjustment::Options options;
  options.window = window;
  LocalBundleAdjustment adjustment(options);
  int residuals = 0;
  for (auto _ : state) {
    state.PauseTiming();
    LocalMap copy = map;
    state.ResumeTiming();
    residuals = adjustment.adjust(&copy).residuals;
  }
  state.counters["residuals"] = residuals;
}
BENCHMARK(bundleAdjustment)
    ->ArgNames({"window", "points"})
    ->ArgsProduct({{7}, {125, 250, 500, 1000}})
    ->ArgsProduct({{3, 5, 10, 14}, {500}})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace ground_scale_vo
