#include "ground_scale_vo/evaluation/run_report.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/covariance_metrics.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "scripted_run.hpp"
#include "support/comma_locale.hpp"
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

/// The values of the last line of a table by column.
std::map<std::string, std::string> lastLine(const std::string& table) {
  std::vector<std::vector<std::string>> lines;
  std::istringstream stream(table);
  for (std::string line; std::getline(stream, line);) {
    std::istringstream cells(line);
    lines.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) lines.back().push_back(cell);
  }
  std::map<std::string, std::string> values;
  for (std::size_t i = 0; i < lines.front().size(); ++i) {
    values[lines.front()[i]] = lines.back().at(i);
  }
  return values;
}

using Cells = std::map<std::string, std::string>;

TEST_F(RunReport, EachColumnHasItsValue) {
  VisualOdometry::Output vo;
  vo.frame.stamp_ns = 1500000000;
  vo.frame.status = VoStatus::kTracking;
  vo.frame.map_id = 7;
  vo.times = {1, 2, 3, 4, 5, 6, 7, 8, 40};  // in the order of the struct
  ScaleRecovery::Output scale;
  scale.times = {11, 12, 13, 14, 15, 70};
  ScaleEstimate& s = scale.scale;
  s.status = ScaleStatus::kHeld;
  s.reason = ScaleReason::kStandstill;
  s.raw_scale = 1.25;
  s.scale = 1.5;
  s.sigma = 0.125;
  s.height = 1.75;
  s.n_c = {0.5, -0.25, 0.75};
  s.triangles = 5;
  s.ground_triangles = 4;
  s.ground_points = 3;
  s.window_points = 2;
  s.plane_inliers = 1;
  RunRecord record;
  record.append(vo, scale, 9);
  EXPECT_EQ(lastLine(scaleCsv(record)), (Cells{{"frame", "0"},
                                               {"stamp", "1.500000000"},
                                               {"status", "held"},
                                               {"reason", toString(s.reason)},
                                               {"raw_scale", "1.25"},
                                               {"scale", "1.5"},
                                               {"sigma", "0.125"},
                                               {"height", "1.75"},
                                               {"nx", "0.5"},
                                               {"ny", "-0.25"},
                                               {"nz", "0.75"},
                                               {"triangles", "5"},
                                               {"ground_triangles", "4"},
                                               {"ground_points", "3"},
                                               {"window_points", "2"},
                                               {"plane_inliers", "1"},
                                               {"backfilled", "0"},
                                               {"map_id", "7"},
                                               {"vo_status", toString(vo.frame.status)}}));
  EXPECT_EQ(lastLine(timingCsv(record)), (Cells{{"frame", "0"},
                                                {"decode", "9"},
                                                {"vo_pyramid", "1"},
                                                {"vo_track", "2"},
                                                {"vo_align", "3"},
                                                {"vo_detect", "4"},
                                                {"vo_pose", "5"},
                                                {"vo_triangulate", "6"},
                                                {"vo_bundle_adjustment", "7"},
                                                {"vo_adjustment_wait", "8"},
                                                {"vo_total", "40"},
                                                {"scale_delaunay", "11"},
                                                {"scale_gpe", "12"},
                                                {"scale_gpa", "13"},
                                                {"scale_direct", "14"},
                                                {"scale_filter", "15"},
                                                {"scale_total", "70"},
                                                {"total", "110"}}));
  s.scale = 1234.56789;
  RunRecord precise;
  precise.append(vo, scale);
  EXPECT_EQ(lastLine(scaleCsv(precise))["scale"], "1234.56789");
  const auto json = nlohmann::json::parse(metricsJson(record, 1.65, {}));
  EXPECT_EQ(json.at("ms_vo_median"), 40);
  EXPECT_EQ(json.at("ms_scale_median"), 70);
  EXPECT_EQ(json.at("ms_total_median"), 110);
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

/// A drive of 240 m with a scale that is 4 % too large; in every fourth frame it is held. The
/// covariance makes the error along the motion one standard deviation over the whole drive.
RunRecord biasedDrive(std::vector<Eigen::Isometry3d>* ground_truth) {
  RunRecord record;
  for (int i = 0; i <= 240; ++i) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(i);
    vo.frame.status = VoStatus::kTracking;
    vo.frame.T_w_c = ahead(0.5 * i);
    ScaleRecovery::Output scale;
    scale.scale.status = i % 4 == 3 ? ScaleStatus::kHeld : ScaleStatus::kOk;
    scale.scale.scale = 2.08;
    scale.scale.sigma = 0.05;
    scale.scale.height = 1.65 / 2.08;
    if (i >= 5) {
      scale.pose.emplace();
      scale.pose->T_o_c = ahead(1.04 * i);
      scale.pose->covariance = 1e-3 * i * Matrix6d::Identity();
    }
    ground_truth->push_back(ahead(i));
    record.append(vo, scale);
  }
  return record;
}

// By heights the ground truth counts as exact.
TEST_F(RunReport, EachMetricIsThatOfItsName) {
  std::vector<Eigen::Isometry3d> ground_truth;
  const RunRecord record = biasedDrive(&ground_truth);
  const Json json =
      Json::parse(metricsJson(record, 1.65, ground_truth, std::vector<double>(241, 1.65)));
  const OdometryMetrics odometry = computeOdometryMetrics(ground_truth, record.metricPoses());
  EXPECT_NEAR(json.at("rle_percent"), 4, 1e-6);
  EXPECT_NEAR(json.at("t_err_percent"), odometry.t_err_percent.value(), 1e-6);
  EXPECT_NEAR(json.at("t_err_short_percent"), odometry.t_err_short_percent.value(), 1e-6);
  EXPECT_NEAR(json.at("ate_rmse_m"), odometry.ate_rmse_m, 1e-6);
  EXPECT_GT(json.at("t_err_percent"), 4);
  EXPECT_NEAR(json.at("t_err_true_length_percent"), 0, 1e-6);
  EXPECT_NEAR(json.at("t_err_sim3_percent"), 0, 1e-6);
  EXPECT_EQ(json.at("scale_within_2_sigma"), 1);
  EXPECT_NEAR(json.at("first_scale_error_sigmas"), 1.6, 1e-6);
  EXPECT_NEAR(json.at("scale_held_share"), 59. / 236, 1e-6);
  EXPECT_NEAR(json.at("scale_error_median_percent"), 4, 1e-6);
  EXPECT_NEAR(json.at("height_bias_percent"), 100 * (1 / 1.04 - 1), 1e-6);
  EXPECT_EQ(json.at("first_metric_pose_m"), 5);
  const CovarianceMetrics covariance = computeCovarianceMetrics(record, ground_truth);
  ASSERT_EQ(json.at("covariance_by_length").size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const Json& entry = json.at("covariance_by_length")[i];
    const CovarianceMetrics::Length& expected = covariance.by_length[i];
    EXPECT_EQ(entry.at("length_m"), expected.length_m);
    EXPECT_EQ(entry.at("segments"), expected.segments);
    EXPECT_NEAR(entry.at("nees_per_dof"), expected.nees_per_dof, 1e-6);
    EXPECT_NEAR(entry.at("within_2_sigma"), expected.within_2_sigma, 1e-6);
    EXPECT_EQ(entry.at("nees_per_dof_exact_ground_truth"), entry.at("nees_per_dof"));
  }
  ASSERT_EQ(json.at("by_length").size(), 2u);
  EXPECT_EQ(json.at("by_length")[1].at("length_m"), 200);
  EXPECT_EQ(json.at("by_length")[1].at("r_err_deg_per_m"), 0);
}

TEST_F(RunReport, ErrorsOfTheTrajectoryAreNotMixedUp) {
  constexpr double kDegree = M_PI / 180;
  const Eigen::Vector3d direction(std::sin(0.5 * kDegree), 0, std::cos(0.5 * kDegree));
  const Eigen::AngleAxisd yaw(0.01 * kDegree, Eigen::Vector3d::UnitY());
  std::vector<Eigen::Isometry3d> ground_truth;
  RunRecord record;
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity(), T_o_c = T_w_c;
  for (int i = 0; i <= 240; ++i) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(i);
    vo.frame.status = VoStatus::kTracking;
    vo.frame.T_w_c = T_w_c;
    ScaleRecovery::Output scale;
    scale.pose.emplace();
    scale.pose->T_o_c = T_o_c;
    ground_truth.push_back(ahead(i));
    record.append(vo, scale);
    T_w_c = T_w_c * Eigen::Translation3d((i < 120 ? 0.5 : 0.52) * direction) * yaw;
    T_o_c = T_o_c * Eigen::Translation3d((i < 120 ? 1.06 : 0.98) * direction) * yaw;
  }
  const Json json = Json::parse(metricsJson(record, 1.65, ground_truth));
  const auto metric = computeOdometryMetrics(ground_truth, record.metricPoses());
  const auto unscaled = computeOdometryMetrics(ground_truth, record.unscaledPoses());
  const std::map<std::string, double> expected = {
      {"gt_length_m", metric.gt_length_m},
      {"rle_percent", metric.rle_percent.value()},
      {"t_err_percent", metric.t_err_percent.value()},
      {"r_err_deg_per_m", metric.r_err_deg_per_m.value()},
      {"t_err_short_percent", metric.t_err_short_percent.value()},
      {"t_err_true_length_percent", metric.t_err_true_length_percent.value()},
      {"t_err_sim3_percent", unscaled.t_err_sim3_percent.value()},
      {"direction_median_deg", metric.direction_median_deg.value()},
      {"ate_rmse_m", metric.ate_rmse_m}};
  std::vector<double> values;
  for (const auto& [name, value] : expected) {
    EXPECT_NEAR(json.at(name), value, 1e-6 * value) << name;
    values.push_back(value);
  }
  std::sort(values.begin(), values.end());
  for (std::size_t i = 1; i < values.size(); ++i) {
    EXPECT_GT(values[i], 1.001 * values[i - 1]) << "the test cannot tell two errors apart";
  }
  const auto compare = [](const Json& entries, const auto& errors) {
    ASSERT_EQ(entries.size(), errors.size());
    for (std::size_t i = 0; i < errors.size(); ++i) {
      EXPECT_EQ(entries[i].at("length_m"), errors[i].length_m);
      EXPECT_EQ(entries[i].at("segments"), errors[i].segments);
      EXPECT_NEAR(entries[i].at("t_err_percent"), errors[i].t_err_percent, 1e-6);
      EXPECT_NEAR(entries[i].at("r_err_deg_per_m"), errors[i].r_err_deg_per_m, 1e-8);
    }
  };
  compare(json.at("by_length"), metric.by_length);
  compare(json.at("by_short_length"), metric.by_short_length);
}

TEST_F(RunReport, EachFileHasItsPoses) {
  std::vector<Eigen::Isometry3d> ground_truth;
  const RunRecord record = biasedDrive(&ground_truth);
  writeRun(folder_, record, 1.65, ground_truth, std::vector<double>(241, 1.65));
  EXPECT_NEAR(readKittiPoses(folder_ / "poses.txt").back().translation().z(), 1.04 * 240, 1e-9);
  EXPECT_EQ(readKittiPoses(folder_ / "poses_unscaled.txt").back().translation().z(), 120);
  EXPECT_EQ(readKittiPoses(folder_ / "ground_truth.txt").back().translation().z(), 240);
  const Json json = Json::parse(readFile(folder_ / "metrics.json", 1 << 20));
  EXPECT_FALSE(json.at("height_bias_percent").is_null());
  EXPECT_EQ(json.at("camera_height_m"), 1.65);
}

TEST_F(RunReport, AMeasuredGroundTruthIsNotExact) {
  std::vector<Eigen::Isometry3d> ground_truth;
  const RunRecord record = biasedDrive(&ground_truth);
  const Json json = Json::parse(metricsJson(record, 1.65, ground_truth));
  const auto expected = computeCovarianceMetrics(record, ground_truth, kGpsImuAccuracy).by_length;
  ASSERT_EQ(json.at("covariance_by_length").size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Json& entry = json.at("covariance_by_length")[i];
    EXPECT_NEAR(entry.at("nees_per_dof"), expected[i].nees_per_dof, 1e-6);
    EXPECT_LT(entry.at("nees_per_dof"), entry.at("nees_per_dof_exact_ground_truth"));
  }
}

TEST_F(RunReport, WritesTheFilesOfARun) {
  const test::CommaLocale locale;
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
