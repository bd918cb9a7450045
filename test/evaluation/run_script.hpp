#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

inline Eigen::Isometry3d ahead(double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().z() = z;
  return T;
}

/// Builds a RunRecord from scripted outputs of both stages, frame by frame.
class Script {
 public:
  /// Odometry without a pose.
  Script& no(VoStatus status, std::uint32_t map_id = 0) {
    vo(status, map_id, 0.0);
    return append({});
  }
  /// Odometry with a pose z VO units ahead of its map's origin, no metric pose.
  Script& tracks(double z, std::uint32_t map_id = 0,
                 const std::vector<std::pair<std::uint32_t, double>>& start = {}) {
    vo(VoStatus::kTracking, map_id, z, start);
    return append({});
  }
  /// The same with a metric pose z_m metres ahead.
  Script& metric(double z, double scale, double z_m, std::uint32_t map_id = 0,
                 const std::vector<std::pair<std::uint32_t, double>>& start = {}) {
    vo(VoStatus::kTracking, map_id, z, start);
    ScaleRecovery::Output output;
    output.scale.status = ScaleStatus::kOk;
    output.scale.scale = scale;
    output.scale.height = 1.65 / scale;
    output.pose.emplace();
    output.pose->T_o_c = ahead(z_m);
    return append(output);
  }

  const RunRecord& record() const { return record_; }

 private:
  void vo(VoStatus status, std::uint32_t map_id, double z,
          const std::vector<std::pair<std::uint32_t, double>>& start = {}) {
    vo_ = {};
    vo_.frame.sequence = next_;
    vo_.frame.stamp_ns = 100000000 * static_cast<std::int64_t>(next_++);
    vo_.frame.status = status;
    vo_.frame.map_id = map_id;
    vo_.frame.T_w_c = ahead(z);
    for (const auto& [sequence, start_z] : start) {
      VisualOdometry::StartPose pose;
      pose.sequence = sequence;
      pose.T_w_c = ahead(start_z);
      vo_.start.push_back(pose);
    }
    vo_.times.total = 10.0 * next_;
  }
  Script& append(const ScaleRecovery::Output& output) {
    record_.append(vo_, output);
    return *this;
  }

  RunRecord record_;
  VisualOdometry::Output vo_;
  std::uint32_t next_ = 0;
};

constexpr VoStatus kInitialising = VoStatus::kInitialising;
constexpr VoStatus kLost = VoStatus::kLost;

/// Map from frame 1 on, found in frame 3; scale 2 m per unit from frame 5 on.
inline Script started() {
  Script script;
  script.no(kInitialising).no(kInitialising).no(kInitialising);
  script.tracks(3, 0, {{1, 0}, {2, 1.5}, {3, 3}}).tracks(4).metric(5, 2, 10).metric(6, 2, 12);
  return script;
}

}  // namespace ground_scale_vo
