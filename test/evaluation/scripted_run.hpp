#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {

/// Pose at distance z along the optical axis.
inline Eigen::Isometry3d ahead(double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().z() = z;
  return T;
}

/// Appends a tracked frame of the first map, with a metric pose if T_o_c is given.
inline void appendFrame(RunRecord* record, const Eigen::Isometry3d& T_w_c,
                        const std::optional<Eigen::Isometry3d>& T_o_c, const Matrix6d& covariance,
                        const ScaleEstimate& estimate = {}, std::uint32_t map_id = 0) {
  VisualOdometry::Output vo;
  vo.frame.sequence = static_cast<std::uint32_t>(record->frames().size());
  vo.frame.stamp_ns = 100000000 * static_cast<std::int64_t>(vo.frame.sequence);
  vo.frame.status = VoStatus::kTracking;
  vo.frame.map_id = map_id;
  vo.frame.T_w_c = T_w_c;
  ScaleRecovery::Output scale;
  scale.scale = estimate;
  if (T_o_c) {
    scale.pose.emplace();
    scale.pose->T_o_c = *T_o_c;
    scale.pose->covariance = covariance;
    scale.pose->distance_sigma = std::sqrt(covariance(2, 2));
  }
  record->append(vo, scale);
}

/// Builds a RunRecord from scripted outputs of both stages, frame by frame at 10 Hz. The VO takes
/// 10 ms for the first frame and 10 ms more for each further one.
///
/// z: of the camera in its map [VO units]. start: sequence numbers and z of the frames that get
/// their poses when this frame initialises the map (VisualOdometry::Output::start).
class ScriptedRun {
 public:
  using Start = std::vector<std::pair<std::uint32_t, double>>;

  /// A frame without a VO pose.
  ScriptedRun& withoutPose(VoStatus status, std::uint32_t map_id = 0) {
    return append(status, map_id, 0, {}, {});
  }
  /// A frame with a VO pose and without a metric one.
  ScriptedRun& tracked(double z, std::uint32_t map_id = 0, const Start& start = {}) {
    return append(VoStatus::kTracking, map_id, z, start, {});
  }
  /// A frame with a VO pose and a metric pose z_m [m] ahead of the first frame; scale [m per VO
  /// unit].
  ScriptedRun& metric(double z, double scale, double z_m, std::uint32_t map_id = 0) {
    ScaleRecovery::Output output;
    output.scale.status = ScaleStatus::kOk;
    output.scale.scale = scale;
    output.scale.height = 1.65 / scale;
    output.pose.emplace();
    output.pose->T_o_c = ahead(z_m);
    return append(VoStatus::kTracking, map_id, z, {}, output);
  }

  const RunRecord& record() const { return record_; }

 private:
  ScriptedRun& append(VoStatus status, std::uint32_t map_id, double z, const Start& start,
                      const ScaleRecovery::Output& output) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(record_.frames().size());
    vo.frame.stamp_ns = 100000000 * static_cast<std::int64_t>(vo.frame.sequence);
    vo.frame.status = status;
    vo.frame.map_id = map_id;
    vo.frame.T_w_c = ahead(z);
    for (const auto& [sequence, start_z] : start) {
      vo.start.push_back({100000000 * static_cast<std::int64_t>(sequence), ahead(start_z)});
    }
    vo.times.total = 10.0 * (vo.frame.sequence + 1);
    record_.append(vo, output);
    return *this;
  }

  RunRecord record_;
};

constexpr VoStatus kInitialising = VoStatus::kInitialising;
constexpr VoStatus kLost = VoStatus::kLost;

/// Seven frames: frame 3 initialises a map that begins at frame 1; from frame 5 on the scale is
/// known, 2 m per VO unit.
inline ScriptedRun runWithInitialisation() {
  ScriptedRun run;
  run.withoutPose(kInitialising).withoutPose(kInitialising).withoutPose(kInitialising);
  run.tracked(3, 0, {{1, 0}, {2, 1.5}, {3, 3}}).tracked(4).metric(5, 2, 10).metric(6, 2, 12);
  return run;
}

}  // namespace gsv
