// Every ROS parameter that a user may still have in a YAML file: it is read, refused with its new
// name, or warned about.

#include "ground_scale_vo/ros/retired_parameters.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {
namespace {

using XmlRpc::XmlRpcValue;
using Now = RetiredParameter::Now;

/// The parameters of both nodelets before most of them became options of the offline tools.
const std::vector<std::string> kOldNames = {"alignment/max_iterations",
                                            "alignment/max_scale",
                                            "alignment/max_shift_px",
                                            "alignment/min_correlation",
                                            "alignment/window_px",
                                            "base_frame",
                                            "bundle_adjustment/huber_sigma",
                                            "bundle_adjustment/max_iterations",
                                            "bundle_adjustment/window",
                                            "camera_height",
                                            "clock_jump_s",
                                            "filter/agreement_memory_h",
                                            "filter/correlation_h",
                                            "filter/drift_per_sqrt_h",
                                            "filter/drift_per_sqrt_rad",
                                            "filter/gate_sigma",
                                            "filter/measurement_floor",
                                            "filter/moving_average_frames",
                                            "filter/restart_h",
                                            "filter/start_measurements",
                                            "filter/start_memory_h",
                                            "filter/start_sigma",
                                            "filter/start_spread",
                                            "filter/start_way_h",
                                            "fit/camber_sigma_rad",
                                            "fit/max_iterations",
                                            "fit/max_sigma",
                                            "fit/max_tilt_rad",
                                            "fit/min_points",
                                            "fit/reject_h",
                                            "fit/reject_sigma",
                                            "fit/roughness_h",
                                            "fit/sac_iterations",
                                            "fit/sac_threshold_h",
                                            "fit/sac_tilt_rad",
                                            "gpa/feature_once",
                                            "gpa/max_frames",
                                            "gpa/max_points",
                                            "gpa/min_frames",
                                            "gpa/window_h",
                                            "gpe/lane_h",
                                            "gpe/lane_points",
                                            "gpe/max_ahead_h",
                                            "gpe/max_lateral_h",
                                            "gpe/min_ahead_h",
                                            "gpe/min_points",
                                            "gpe/most_inliers",
                                            "gpe/motion_tolerance_rad",
                                            "gpe/pitch_tolerance_rad",
                                            "gpe/plane_threshold_h",
                                            "gpe/plane_threshold_sigma",
                                            "gpe/ransac_iterations",
                                            "gpe/roll_tolerance_rad",
                                            "image_buffer",
                                            "image_is_rectified",
                                            "map/keyframes",
                                            "map/max_error",
                                            "map/max_relative_sigma",
                                            "min_step_h",
                                            "motion/max_frames",
                                            "mounting/bounce_h",
                                            "mounting/chord_h",
                                            "mounting/max_tilt_rad",
                                            "mounting/memory_h",
                                            "mounting/pitch_motion_sigma",
                                            "mounting/roll_motion_sigma",
                                            "mounting/start_pitch_sigma",
                                            "mounting/start_roll_sigma",
                                            "odom_frame",
                                            "odometry/epipolar_error",
                                            "odometry/keyframe_min_tracked",
                                            "odometry/keyframe_parallax",
                                            "odometry/lost_frames_before_new_map",
                                            "odometry/max_outlier_frames",
                                            "odometry/noise",
                                            "odometry/noise_aligned",
                                            "odometry/noise_flow",
                                            "odometry/outlier_error",
                                            "odometry/standstill_flow",
                                            "odometry/start_min_share",
                                            "paper_literal",
                                            "path_max_poses",
                                            "path_spacing_m",
                                            "pose/inlier_sigma",
                                            "pose/max_iterations",
                                            "pose/min_inlier_share",
                                            "pose/min_inliers",
                                            "publish_tf",
                                            "queue_size",
                                            "random_seed",
                                            "refine",
                                            "refinement/baseline_h",
                                            "refinement/bend_sigma",
                                            "refinement/blur",
                                            "refinement/direction_sigma_rad",
                                            "refinement/foreign_h",
                                            "refinement/half_width_h",
                                            "refinement/max_ahead_h",
                                            "refinement/max_iterations",
                                            "refinement/max_sigma",
                                            "refinement/max_step",
                                            "refinement/min_ahead_h",
                                            "refinement/min_correlation",
                                            "refinement/min_tiles",
                                            "refinement/noise",
                                            "refinement/registration",
                                            "refinement/rotation_sigma_rad",
                                            "refinement/roughness_h",
                                            "refinement/search_agreement",
                                            "refinement/search_correlation",
                                            "refinement/search_every_h",
                                            "refinement/search_lead",
                                            "refinement/search_range",
                                            "refinement/static_memory_h",
                                            "refinement/tile",
                                            "tracker/cell",
                                            "tracker/forward_backward_px",
                                            "tracker/min_corner_ratio",
                                            "tracker/min_corner_strength",
                                            "tracker/pyramid_levels",
                                            "tracker/window_px",
                                            "trajectory/direction_sigma",
                                            "trajectory/new_map_position_sigma_per_s",
                                            "trajectory/new_map_rotation_sigma_per_s",
                                            "trajectory/rotation_sigma_per_sqrt_m",
                                            "trajectory/scale_correlation_m",
                                            "two_view/inlier_error",
                                            "two_view/max_second_share",
                                            "two_view/min_inlier_share",
                                            "two_view/min_matches",
                                            "two_view/min_parallax",
                                            "world_frame"};

template <typename Params>
std::set<std::string> parameterNames() {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  ParamReader reader("/n", tree);
  Params::read(reader);
  std::set<std::string> names;
  for (const ParamReader::Entry& entry : reader.entries()) names.insert(entry.name);
  return names;
}

std::set<std::string> allParameterNames() {
  std::set<std::string> names = parameterNames<MonoVoParams>();
  names.merge(parameterNames<ScaleRecoveryParams>());
  return names;
}

std::set<std::string> optionNames() {
  std::set<std::string> names;
  MetricOdometry::Options options;
  visitAllParameters(options, [&](const std::string& name, auto&, auto...) { names.insert(name); });
  return names;
}

/// A tree with one parameter, `group/name` or `name`.
XmlRpcValue treeWith(const std::string& name) {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  const std::size_t slash = name.find('/');
  if (slash == std::string::npos) {
    tree[name] = 1;
  } else {
    tree[name.substr(0, slash)][name.substr(slash + 1)] = 1;
  }
  return tree;
}

TEST(RosParameters, AreAtMostThirty) {
  EXPECT_LE(parameterNames<MonoVoParams>().size() + parameterNames<ScaleRecoveryParams>().size(),
            30u);
}

TEST(RetiredParameters, AreListedOnceWithAReplacementThatExists) {
  const std::set<std::string> parameters = allParameterNames(), options = optionNames();
  std::set<std::string> seen;
  for (const RetiredParameter& retired : retiredParameters()) {
    EXPECT_TRUE(seen.insert(retired.name).second) << retired.name << " is listed twice";
    EXPECT_EQ(parameters.count(retired.name), 0u) << retired.name << " is a parameter";
    EXPECT_EQ(options.count(retired.name), 0u) << retired.name << " is an option";
    const std::string replacement = retired.replacement;
    EXPECT_TRUE(replacement.empty() || seen.insert(replacement).second) << replacement << ", twice";
    if (retired.now == Now::kRenamed) {
      EXPECT_EQ(parameters.count(replacement), 1u) << retired.name << " -> " << replacement;
    } else if (retired.now == Now::kOffline) {
      EXPECT_EQ(parameters.count(replacement), 0u) << retired.name << " -> " << replacement;
      EXPECT_EQ(options.count(replacement), 1u) << retired.name << " -> " << replacement;
    } else {
      EXPECT_EQ(replacement, "");
    }
  }
}

TEST(RetiredParameters, EveryOldNameIsReadOrRetiredOrAnOption) {
  const std::set<std::string> parameters = allParameterNames(), options = optionNames();
  for (const std::string& name : kOldNames) {
    const bool is_retired =
        std::any_of(retiredParameters().begin(), retiredParameters().end(),
                    [&](const RetiredParameter& retired) { return retired.name == name; });
    EXPECT_TRUE(is_retired || parameters.count(name) == 1 || options.count(name) == 1) << name;
  }
}

TEST(RetiredParameters, ARenamedOneIsRefusedWithItsNewName) {
  for (const RetiredParameter& retired : retiredParameters()) {
    if (retired.now != Now::kRenamed) continue;
    try {
      ParamReader reader("/n", treeWith(retired.name));
      ScaleRecoveryParams::read(reader);
      FAIL() << retired.name << " is accepted";
    } catch (const OptionError& error) {
      EXPECT_EQ(error.what(), "parameter /n/" + std::string(retired.name) + " is now called " +
                                  retired.replacement);
    }
  }
}

TEST(RetiredParameters, AnOfflineOneOrARemovedOneIsWarnedAbout) {
  for (const RetiredParameter& retired : retiredParameters()) {
    if (retired.now == Now::kRenamed) continue;
    ParamReader reader("/n", treeWith(retired.name));
    ScaleRecoveryParams::read(reader);
    const std::vector<std::string> warnings = reader.warnings();
    ASSERT_EQ(warnings.size(), 1u) << retired.name;
    EXPECT_EQ(warnings[0].find("parameter /n/" + std::string(retired.name)), 0u) << warnings[0];
    EXPECT_NE(warnings[0].find(retired.now == Now::kRemoved
                                   ? std::string("was removed and has no effect")
                                   : "--set " + std::string(retired.replacement) + "=VALUE"),
              std::string::npos)
        << warnings[0];
  }
}

TEST(OfflineOptions, AsParametersAreWarnedAbout) {
  ParamReader reader("/n", treeWith("paper_literal"));
  ScaleRecoveryParams::read(reader);
  EXPECT_EQ(reader.warnings(), std::vector<std::string>{
                                   "parameter /n/paper_literal is not a ROS parameter and has no "
                                   "effect; the offline tools set it: --set paper_literal=VALUE"});
}

}  // namespace
}  // namespace ground_scale_vo
