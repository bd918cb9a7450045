#include "ground_scale_vo/evaluation/run_report.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "scripted_run.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using RunReport = TemporaryFolder;

TEST_F(RunReport, HasALineForEveryFrame) {
  const ScriptedRun run = runWithInitialisation();
  for (const std::string& table : {scaleCsv(run.record()), timingCsv(run.record())}) {
    EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 1 + 7);
    std::istringstream lines(table);
    std::string line;
    std::getline(lines, line);
    const auto columns = std::count(line.begin(), line.end(), ',');
    while (std::getline(lines, line)) {
      EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns);
    }
  }
  EXPECT_NE(scaleCsv(run.record()).find("\n3,0.300000000,"), std::string::npos);
}

using Json = nlohmann::json;

TEST_F(RunReport, MetricsAreNullWithoutGroundTruth) {
  const Json json = Json::parse(metricsJson(runWithInitialisation().record(), 1.65, {}));
  EXPECT_GT(json.at("peak_rss_mb"), 0);
  Json expected = {{"frames", 7},
                   {"tracked_frames", 6},
                   {"lost_events", 0},
                   {"backfilled_frames", 5},
                   {"camera_height_m", 1.65},
                   {"length_m", 12},
                   {"ms_vo_median", 40},
                   {"ms_vo_p95", 67},
                   {"ms_scale_median", 0},
                   {"ms_scale_p95", 0},
                   {"ms_total_median", 40},
                   {"ms_total_p95", 67},
                   {"peak_rss_mb", json.at("peak_rss_mb")}};
  for (const char* member :
       {"gt_length_m", "rle_percent", "t_err_percent", "r_err_deg_per_m", "t_err_short_percent",
        "t_err_true_length_percent", "t_err_sim3_percent", "direction_median_deg", "ate_rmse_m",
        "scale_within_2_sigma", "scale_held_share", "scale_error_median_percent",
        "scale_error_spread_percent", "height_bias_percent", "first_scale_error_sigmas",
        "first_metric_pose_m", "covariance_by_length", "by_length", "by_short_length"}) {
    expected[member] = nullptr;
  }
  EXPECT_EQ(json, expected);
}

TEST_F(RunReport, MetricsHaveOneLinePerMemberInAFixedOrder) {
  const std::string text = metricsJson(runWithInitialisation().record(), 1.65, {});
  EXPECT_EQ(text.find("{\n  \"frames\": 7,\n  \"tracked_frames\": 6,\n"), 0u) << text;
  EXPECT_NE(text.find("\n  \"rle_percent\": null,\n  \"t_err_percent\": null,\n"),
            std::string::npos);
}

TEST_F(RunReport, MetricsWithGroundTruth) {
  std::vector<Eigen::Isometry3d> ground_truth;
  for (const double z : {0, 0, 3, 6, 8, 10, 15}) ground_truth.push_back(ahead(z));
  const Json json = Json::parse(metricsJson(runWithInitialisation().record(), 1.65, ground_truth));
  EXPECT_EQ(json.at("gt_length_m"), 15);
  EXPECT_EQ(json.at("rle_percent"), 20);
  EXPECT_TRUE(json.at("t_err_percent").is_null());
  EXPECT_EQ(json.at("t_err_short_percent"), 30);
  EXPECT_EQ(json.at("direction_median_deg"), 0);
  EXPECT_EQ(json.at("by_length"), Json::array());
  ASSERT_EQ(json.at("by_short_length").size(), 1u);
  EXPECT_EQ(json.at("by_short_length")[0].at("length_m"), 10);
  EXPECT_EQ(json.at("by_short_length")[0].at("segments"), 1);
  // A true scale needs 16 m, kMeasuredGroundTruthDistance; no two frames are so far apart.
  EXPECT_TRUE(json.at("scale_error_median_percent").is_null());
  EXPECT_TRUE(json.at("height_bias_percent").is_null());
  ground_truth.pop_back();
  EXPECT_THROW(metricsJson(runWithInitialisation().record(), 1.65, ground_truth), OptionError);
}

TEST_F(RunReport, ScaleErrorIsRelativeToTheTrueScale) {
  std::vector<Eigen::Isometry3d> ground_truth;
  for (const double z : {0, 0, 6, 12, 16, 20, 30}) ground_truth.push_back(ahead(z));
  const Json json = Json::parse(metricsJson(runWithInitialisation().record(), 1.65, ground_truth));
  // Around frames 5 and 6: 18 m over 3 units, so 6 m per unit instead of 2.
  EXPECT_EQ(json.at("scale_error_median_percent"), -66.66666667);
}

// With heights the ground truth counts as exact, so 2 m suffice for a true scale: 7 m over 2 units
// around frame 5, 5 m over 1 unit before frame 6. The estimate is 2 m per unit.
TEST_F(RunReport, MetricsWithGroundTruthHeights) {
  std::vector<Eigen::Isometry3d> ground_truth;
  for (const double z : {0, 0, 3, 6, 8, 10, 15}) ground_truth.push_back(ahead(z));
  const Json json = Json::parse(metricsJson(runWithInitialisation().record(), 1.65, ground_truth,
                                            std::vector<double>(7, 1.65)));
  EXPECT_EQ(json.at("scale_within_2_sigma"), 0);
  EXPECT_EQ(json.at("scale_held_share"), 0);
  EXPECT_EQ(json.at("scale_error_median_percent"), -51.42857143);
  EXPECT_TRUE(json.at("scale_error_spread_percent").is_null());
  EXPECT_EQ(json.at("height_bias_percent"), 112.5);
}

TEST_F(RunReport, WritesTheFilesOfARun) {
  const ScriptedRun run = runWithInitialisation();
  const auto folder = folder_ / "results" / "07";
  writeRun(folder, run.record(), 1.65, run.record().metricPoses());
  for (const char* name : {"poses.txt", "poses_unscaled.txt", "ground_truth.txt"}) {
    EXPECT_EQ(readKittiPoses(folder / name).size(), 7u) << name;
  }
  const auto stamped = readTumTrajectory(folder / "trajectory_tum.txt");
  ASSERT_EQ(stamped.size(), 7u);
  EXPECT_EQ(stamped[6].stamp_ns, 600000000);
  EXPECT_EQ(stamped[6].T_a_b.translation().z(), 12);
  for (const char* name : {"scale.csv", "timing.csv", "metrics.json"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  }
  writeRun(folder, run.record(), 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "ground_truth.txt"));

  RunRecord without_times;
  VisualOdometry::Output vo;
  vo.times.total = std::numeric_limits<double>::quiet_NaN();
  without_times.append(vo, {});
  writeRun(folder, without_times, 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "timing.csv"))
      << "a file of the previous run is left";

  const auto file = write("file", "");
  EXPECT_NE(dataErrorOf([&] { writeRun(file / "07", run.record(), 1.65, {}); }, folder_),
            "no error");
}

}  // namespace
}  // namespace ground_scale_vo
