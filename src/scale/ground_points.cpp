#include "scale/ground_points.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <unordered_set>

#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// Odd constant (2^64 over the golden ratio) that separates the sequences of consecutive seeds.
constexpr std::uint64_t kSeedMultiplier = 0x9E3779B97F4A7C15ull;

/// Least sine of the angle at the first corner: the normal of a flatter triangle (about 1 degree)
/// is dominated by the noise of its points.
constexpr double kMinSine = 0.02;

/// Near end of the region of interest: nearer road lies below the vehicle.
constexpr double kMinAheadHeights = 1;

/// [rad] Largest roll of a triangle. Not in the paper: Eq. 3 accepts walls along the road.
constexpr double kRollTolerance = 0.26;

constexpr int kRansacIterations = 100;  ///< Z of Alg. 1

/// Of GPA: bounds the time of a fit; the newest frames come first.
constexpr std::size_t kMaxPoints = 3000;

/// Eq. 1 and 2 for three points in camera axes. The normal is oriented upwards (y is down), so h >
/// 0 exactly when the plane lies below the camera; otherwise, and for degenerate triples, empty.
std::optional<GroundPlane> planeThrough(const Eigen::Vector3d& x1, const Eigen::Vector3d& x2,
                                        const Eigen::Vector3d& x3) {
  const Eigen::Vector3d a = x1 - x2;
  const Eigen::Vector3d b = x1 - x3;
  const Eigen::Vector3d cross = a.cross(b);
  const double length = cross.norm();
  if (!(length > kMinSine * a.norm() * b.norm())) return std::nullopt;
  GroundPlane plane;
  plane.n_c = (cross.y() < 0 ? cross : Eigen::Vector3d(-cross)) / length;  // Eq. 1
  plane.height = -plane.n_c.dot(x1);                                       // Eq. 2
  if (!(plane.height > 0)) return std::nullopt;
  return plane;
}

/// Absolute pitch (first) and roll (second) of a normal against the prior [rad].
std::pair<double, double> tilt(const Eigen::Vector3d& n_c, const RoadPrior& prior) {
  const double up = n_c.dot(prior.n_c);
  return {std::abs(std::atan2(n_c.dot(prior.forward_c), up)),
          std::abs(std::atan2(n_c.dot(prior.lateral()), up))};
}

/// Alg. 1 line 1: Delaunay triangles as indices into `features`, of those listed in `chosen`. Of
/// several features at one pixel the first is used.
std::vector<Triangle> delaunay(const PinholeCamera& camera,
                               const std::vector<TrackedFeature>& features,
                               const std::vector<std::uint32_t>& chosen) {
  std::vector<Triangle> triangles;
  if (chosen.size() < 3) return triangles;
  cv::Subdiv2D subdivision(cv::Rect(-1, -1, camera.width + 2, camera.height + 2));
  // By Subdiv2D's vertex id; the first few vertices are its own outer triangle.
  std::vector<std::uint32_t> feature_of_vertex;
  constexpr std::uint32_t kNoVertex = std::numeric_limits<std::uint32_t>::max();
  for (const std::uint32_t i : chosen) {
    const int vertex = subdivision.insert(cv::Point2f(features[i].u.x(), features[i].u.y()));
    if (vertex < 0) continue;
    const auto v = static_cast<std::size_t>(vertex);
    if (v >= feature_of_vertex.size()) feature_of_vertex.resize(v + 1, kNoVertex);
    if (feature_of_vertex[v] == kNoVertex) feature_of_vertex[v] = i;
  }
  std::vector<int> edges;
  subdivision.getLeadingEdgeList(edges);
  triangles.reserve(edges.size());
  for (int edge : edges) {
    Triangle triangle;
    bool inside = true;
    for (std::uint32_t& corner : triangle) {
      const auto vertex = static_cast<std::size_t>(subdivision.edgeOrg(edge));
      corner = vertex < feature_of_vertex.size() ? feature_of_vertex[vertex] : kNoVertex;
      inside = inside && corner != kNoVertex;
      edge = subdivision.getEdge(edge, cv::Subdiv2D::NEXT_AROUND_LEFT);
    }
    if (inside) triangles.push_back(triangle);
  }
  return triangles;
}

/// Indices of the features with a point whose ray meets the expected plane in the region of
/// interest: the narrow one if it contains enough of them, otherwise the wide one.
std::vector<std::uint32_t> selectRegion(const VoFrame& frame, const RoadPrior& prior,
                                        const GroundPointExtractionOptions& options,
                                        bool* is_wide) {
  const auto region = [&](double half_width) {
    return LaneRegion(prior, 0, kMinAheadHeights, options.max_ahead_heights, half_width);
  };
  const LaneRegion lane_region = region(options.lane_half_width_heights);
  const LaneRegion wide_region = region(options.max_half_width_heights);
  std::vector<std::uint32_t> wide, lane;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const TrackedFeature& feature = frame.features[i];
    if (!hasUsablePoint(feature) || !(feature.depth_sigma > 0)) continue;
    if (!(feature.u.x() >= 0 && feature.u.x() <= static_cast<float>(frame.camera.width) &&
          feature.u.y() >= 0 && feature.u.y() <= static_cast<float>(frame.camera.height))) {
      continue;
    }
    const Eigen::Vector3d ray = frame.camera.ray(feature.u.cast<double>());
    if (!wide_region.contains(ray)) continue;
    wide.push_back(static_cast<std::uint32_t>(i));
    if (lane_region.contains(ray)) lane.push_back(static_cast<std::uint32_t>(i));
  }
  *is_wide = lane.size() < static_cast<std::size_t>(options.min_lane_features);
  return *is_wide ? wide : lane;
}

/// theta_1 of Alg. 1 line 10 for a triangle's own normal, relative to the mounting. The printed
/// test of the frame's rotation replaces it with frame_pitch_test.
bool isTilted(const GroundPlane& plane, const RoadPrior& prior,
              const GroundPointExtractionOptions& options, double roll_tolerance) {
  if (options.frame_pitch_test) return false;
  const auto [pitch, roll] = tilt(plane.n_c, prior);
  return pitch >= prior.pitchTolerance(options.pitch_tolerance_rad) ||
         roll >= prior.rollTolerance(roll_tolerance);
}

/// Alg. 1 lines 17-33: keeps the points of *result that lie on the best plane through three of
/// them: that with the least total distance, truncated at the threshold (Eq. 4; untruncated, one
/// outlier would decide), or with the most inliers (line 28).
void ransac(std::uint64_t seed, const RoadPrior& prior, const GroundPointExtractionOptions& options,
            GroundPoints* result) {
  std::vector<GroundPoint>& points = result->points;
  const std::size_t n = points.size();
  result->status = MeasurementStatus::kTooFewGroundPoints;
  if (n < static_cast<std::size_t>(options.min_points)) return;  // line 18

  // For a point near the plane, the relative error of its depth equals the error of its distance
  // from the plane over the height.
  std::vector<double> threshold(n);
  for (std::size_t i = 0; i < n; ++i) {
    threshold[i] =
        std::hypot(options.plane_threshold_heights,
                   options.plane_threshold_sigma * points[i].depth_sigma / points[i].depth);
  }
  std::mt19937_64 random(seed);
  double best_cost = std::numeric_limits<double>::infinity();
  std::vector<bool> best, inlier(n);                                            // G_best, G_k
  for (int k = 0; k < kRansacIterations; ++k) {                                 // line 19
    const std::size_t i1 = random() % n, i2 = random() % n, i3 = random() % n;  // line 20
    if (i1 == i2 || i1 == i3 || i2 == i3) continue;
    const std::optional<GroundPlane> plane =
        planeThrough(points[i1].p_c, points[i2].p_c, points[i3].p_c);  // line 21
    if (!plane) continue;
    // A plane through distant points has a smaller roll error than a triangle of neighbours.
    if (isTilted(*plane, prior, options, options.pitch_tolerance_rad)) continue;
    double cost = 0;
    for (std::size_t g = 0; g < n; ++g) {  // lines 22-27
      const double distance = std::abs(plane->n_c.dot(points[g].p_c) + plane->height) /
                              plane->height;  // line 23, over the height
      inlier[g] = distance < threshold[g];    // line 24
      cost += !inlier[g] ? 1 : options.most_inliers ? 0 : distance / threshold[g];
    }
    if (cost < best_cost) {  // lines 28-30
      best_cost = cost;
      best = inlier;
      result->plane = *plane;
    }
  }
  result->status = MeasurementStatus::kNoPlane;
  if (best.empty()) return;
  std::size_t kept = 0;  // line 32
  for (std::size_t g = 0; g < n; ++g) {
    if (best[g]) points[kept++] = points[g];
  }
  points.resize(kept);
  if (kept >= static_cast<std::size_t>(options.min_points))
    result->status = MeasurementStatus::kMeasured;
}

}  // namespace

GroundPoints extractGroundPoints(const VoFrame& frame, const RoadPrior& prior,
                                 const Eigen::Isometry3d& last_motion,
                                 const GroundPointExtractionOptions& options,
                                 std::uint64_t random_seed) {
  GroundPoints result;
  const Stopwatch watch;
  const std::vector<Triangle> triangles =  // Alg. 1 line 1
      delaunay(frame.camera, frame.features,
               selectRegion(frame, prior, options, &result.are_beside_lane));
  result.delaunay_ms = watch.ms();
  result.triangles = static_cast<int>(triangles.size());
  if (triangles.empty()) return result;

  // Eq. 3 as printed: the rotation between frames, so it selects frames and not triangles.
  const Eigen::Matrix3d R = last_motion.linear();
  const bool frame_is_level = !options.frame_pitch_test ||
                              std::abs(std::atan(-R(2, 1) / R(2, 2))) < options.pitch_tolerance_rad;

  const double max_sine = std::sin(options.motion_tolerance_rad);
  std::vector<bool> is_ground(frame.features.size(), false);
  for (const Triangle& triangle : triangles) {  // Alg. 1 lines 6-15
    // Alg. 1 line 7: the pixel's ray has no depth, so the tracked map points are the corners.
    const std::optional<GroundPlane> plane = planeThrough(
        frame.features[triangle[0]].p_c.cast<double>(),
        frame.features[triangle[1]].p_c.cast<double>(),
        frame.features[triangle[2]].p_c.cast<double>());  // lines 8-9; h > 0 of line 10
    if (!plane || !frame_is_level) continue;
    if (isTilted(*plane, prior, options, kRollTolerance)) continue;  // theta_1 of line 10
    // Line 11 (Eq. 3): |90 deg - angle(n, t)| < theta_2.
    if (prior.chord && std::abs(plane->n_c.dot(prior.chord->direction_c)) >= max_sine) continue;
    ++result.ground_triangles;
    for (const std::uint32_t corner : triangle) is_ground[corner] = true;  // lines 12 and 16
  }
  for (std::size_t i = 0; i < is_ground.size(); ++i) {
    if (!is_ground[i]) continue;
    const TrackedFeature& feature = frame.features[i];
    GroundPoint& point = result.points.emplace_back();
    point.id = feature.id;
    point.p_c = feature.p_c.cast<double>();
    point.depth = point.p_c.z();
    point.depth_sigma = static_cast<double>(feature.depth_sigma);
  }
  // A seed for each frame, so that its result does not depend on earlier frames.
  ransac(random_seed * kSeedMultiplier + frame.sequence, prior, options, &result);
  if (result.status != MeasurementStatus::kMeasured) result.points.clear();
  return result;
}

std::vector<GroundPoint> aggregateGroundPoints(const CameraPath& path,
                                               const Eigen::Isometry3d& T_w_c, double height_hint,
                                               const GroundPointAggregationOptions& options) {
  const double max_length = options.window_heights * height_hint;  // along the path
  std::vector<GroundPoint> points;
  std::unordered_set<std::uint64_t> seen;  // only tested for membership: its order has no effect
  int frames = 0;
  const Eigen::Isometry3d T_c_w = T_w_c.inverse();
  for (auto pose = path.poses().rbegin(); pose != path.poses().rend(); ++pose) {
    if (path.newest().travelled - pose->travelled > max_length) break;
    if (pose->ground_points.empty()) continue;
    if (++frames > options.max_frames) break;
    const Eigen::Isometry3d T_c_f = T_c_w * pose->T_w_c;
    for (const GroundPoint& point : pose->ground_points) {
      if (points.size() >= kMaxPoints) return points;
      if (options.unique_features && !seen.insert(point.id).second) continue;
      // Eq. 5, but into the camera frame: the fit then does not depend on the world's origin.
      points.push_back(
          {point.id, T_c_f * point.p_c, T_c_f.translation(), point.depth, point.depth_sigma});
    }
  }
  return points;
}

}  // namespace gsv
