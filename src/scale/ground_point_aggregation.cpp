#include "ground_scale_vo/scale/ground_point_aggregation.hpp"

#include <unordered_set>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// Bounds the time of a fit; the newest frames come first.
constexpr std::size_t kMaxPoints = 3000;

}  // namespace

void GroundPointAggregation::Options::validate() const {
  visitParameters(*this, RangeCheck("gpa/"));
  requireInRange("gpa/min_frames", min_frames, 1, max_frames);
  fit.validate();
}

GroundPointAggregation::GroundPointAggregation(const Options& options)
    : options_(options), fit_(options.fit) {
  options_.validate();
}

void GroundPointAggregation::add(const Eigen::Isometry3d& T_w_c, double travelled,
                                 const std::vector<GroundPoint>& points) {
  queue_.push_back({T_w_c, travelled, points});  // Alg. 2 line 7
  if (queue_.size() > static_cast<std::size_t>(options_.max_frames)) queue_.pop_front();  // line 8
}

std::vector<PlanePoint> GroundPointAggregation::window(const Eigen::Isometry3d& T_w_c) const {
  std::vector<PlanePoint> points;
  std::unordered_set<std::uint64_t> seen;  // only tested for membership: its order has no effect
  const Eigen::Isometry3d T_c_w = T_w_c.inverse();
  for (auto frame = queue_.rbegin(); frame != queue_.rend(); ++frame) {  // lines 10-13
    const Eigen::Isometry3d T_c_f = T_c_w * frame->T_w_c;
    for (const GroundPoint& point : frame->points) {
      if (points.size() >= kMaxPoints) return points;
      if (options_.unique_features && !seen.insert(point.id).second) continue;
      // Eq. 5, but into the camera frame: the fit then does not depend on the world's origin.
      points.push_back({T_c_f * point.p_c, T_c_f.translation(), point.p_c.z(), point.depth_sigma});
    }
  }
  return points;
}

GroundPointAggregation::Result GroundPointAggregation::estimate(const Eigen::Isometry3d& T_w_c,
                                                                double travelled,
                                                                const NormalPrior& prior,
                                                                double height_hint) {
  while (!queue_.empty() &&
         travelled - queue_.front().travelled > options_.window_heights * height_hint) {
    queue_.pop_front();
  }
  Result result;
  if (queue_.size() < static_cast<std::size_t>(options_.min_frames)) {
    result.fit.status = ScaleReason::kTooFewGroundPoints;
    return result;
  }
  result.window = window(T_w_c);
  result.fit = fit_.fit(result.window, prior, height_hint);  // lines 14-34
  return result;
}

void GroundPointAggregation::reset() { queue_.clear(); }

}  // namespace ground_scale_vo
