#include "ground_scale_vo/ros/retired_parameters.hpp"

#include <string>

namespace ground_scale_vo {
namespace {

using Now = RetiredParameter::Now;

const std::vector<RetiredParameter> kTable = {
    {"alignment/max_iterations", Now::kRemoved, ""},
    {"filter/agreement_memory_h", Now::kOffline, "filter/nis_memory_heights"},
    {"filter/correlation_h", Now::kOffline, "filter/correlation_heights"},
    {"filter/drift_per_sqrt_h", Now::kOffline, "filter/drift_per_sqrt_height"},
    {"filter/measurement_floor", Now::kOffline, "filter/min_measurement_sigma"},
    {"filter/restart_h", Now::kOffline, "filter/restart_distance_heights"},
    {"filter/start_measurements", Now::kRemoved, ""},
    {"filter/start_memory_h", Now::kRemoved, ""},
    {"filter/start_sigma", Now::kRemoved, ""},
    {"filter/start_spread", Now::kRemoved, ""},
    {"filter/start_way_h", Now::kOffline, "filter/start_distance_heights"},
    {"fit/max_iterations", Now::kRemoved, ""},
    {"fit/reject_distance_heights", Now::kRemoved, ""},
    {"fit/reject_h", Now::kRemoved, ""},
    {"fit/roughness_h", Now::kOffline, "fit/roughness_heights"},
    {"fit/sac_threshold_h", Now::kOffline, "fit/sac_threshold_heights"},
    {"gpa/feature_once", Now::kOffline, "gpa/unique_features"},
    {"gpa/max_points", Now::kRemoved, ""},
    {"gpa/window_h", Now::kOffline, "gpa/window_heights"},
    {"gpe/lane_h", Now::kOffline, "gpe/lane_half_width_heights"},
    {"gpe/lane_points", Now::kOffline, "gpe/min_lane_features"},
    {"gpe/max_ahead_h", Now::kOffline, "gpe/max_ahead_heights"},
    {"gpe/max_lateral_h", Now::kOffline, "gpe/max_half_width_heights"},
    {"gpe/min_ahead_h", Now::kOffline, "gpe/min_ahead_heights"},
    {"gpe/plane_threshold_h", Now::kOffline, "gpe/plane_threshold_heights"},
    {"image_buffer", Now::kRemoved, ""},
    {"map/max_error", Now::kOffline, "map/max_reprojection_error"},
    {"min_step_h", Now::kOffline, "standstill_distance_heights"},
    {"motion/max_frames", Now::kRemoved, ""},
    {"mounting/bounce_h", Now::kOffline, "mounting/heave_sigma_heights"},
    {"mounting/chord_h", Now::kOffline, "mounting/chord_length_heights"},
    {"mounting/memory_h", Now::kOffline, "mounting/forgetting_distance_heights"},
    {"mounting/start_pitch_sigma", Now::kRenamed, "mounting/initial_pitch_sigma"},
    {"mounting/start_roll_sigma", Now::kOffline, "mounting/initial_roll_sigma"},
    {"odometry/epipolar_error", Now::kOffline, "odometry/max_epipolar_error"},
    {"odometry/noise", Now::kOffline, "odometry/feature_sigma"},
    {"odometry/noise_aligned", Now::kOffline, "odometry/feature_sigma_aligned"},
    {"odometry/noise_flow", Now::kOffline, "odometry/feature_sigma_flow"},
    {"odometry/outlier_error", Now::kOffline, "odometry/max_reprojection_error"},
    {"odometry/start_min_share", Now::kOffline, "odometry/initialisation_min_tracked"},
    {"pose/max_iterations", Now::kRemoved, ""},
    {"refinement/baseline_h", Now::kOffline, "direct/baseline_heights"},
    {"refinement/bend_sigma", Now::kOffline, "direct/curvature_sigma"},
    {"refinement/blur", Now::kRemoved, ""},
    {"refinement/direction_sigma_rad", Now::kOffline, "direct/direction_sigma_rad"},
    {"refinement/foreign_h", Now::kRemoved, ""},
    {"refinement/half_width_h", Now::kRenamed, "direct/lane_half_width_heights"},
    {"refinement/max_ahead_h", Now::kRenamed, "direct/max_ahead_heights"},
    {"refinement/max_iterations", Now::kRemoved, ""},
    {"refinement/max_sigma", Now::kOffline, "direct/max_sigma"},
    {"refinement/max_step", Now::kOffline, "direct/max_height_change"},
    {"refinement/min_ahead_h", Now::kOffline, "direct/min_ahead_heights"},
    {"refinement/min_correlation", Now::kOffline, "direct/min_correlation"},
    {"refinement/min_tiles", Now::kOffline, "direct/min_patches"},
    {"refinement/noise", Now::kOffline, "direct/image_noise"},
    {"refinement/registration", Now::kRemoved, ""},
    {"refinement/rotation_sigma_rad", Now::kOffline, "direct/rotation_sigma_rad"},
    {"refinement/roughness_h", Now::kOffline, "direct/roughness_heights"},
    {"refinement/search_agreement", Now::kOffline, "direct/search_max_disagreement"},
    {"refinement/search_correlation", Now::kOffline, "direct/search_min_correlation"},
    {"refinement/search_every_h", Now::kOffline, "direct/search_interval_heights"},
    {"refinement/search_lead", Now::kOffline, "direct/search_min_peak_margin"},
    {"refinement/search_range", Now::kOffline, "direct/search_range"},
    {"refinement/static_memory_h", Now::kOffline, "direct/static_memory_heights"},
    {"refinement/tile", Now::kOffline, "direct/patch_size"},
    {"tracker/cell", Now::kRenamed, "tracker/cell_size"},
    {"two_view/inlier_error", Now::kOffline, "two_view/inlier_threshold"},
    {"two_view/max_second_share", Now::kOffline, "two_view/max_second_best_ratio"},
};

}  // namespace

const std::vector<RetiredParameter>& retiredParameters() { return kTable; }

void noteRetiredParameters(ParamReader& reader) {
  for (const RetiredParameter& retired : retiredParameters()) {
    const std::string replacement = retired.replacement;
    switch (retired.now) {
      case Now::kRenamed:
        reader.reject(retired.name, "is now called " + replacement);
        break;
      case Now::kOffline:
        reader.note(retired.name,
                    "is not a ROS parameter any more and has no effect; the offline tools set it: "
                    "--set " +
                        replacement + "=VALUE");
        break;
      case Now::kRemoved:
        reader.note(retired.name, "was removed and has no effect");
        break;
    }
  }
}

}  // namespace ground_scale_vo
