#include "ground_scale_vo/evaluation/run_record.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

Eigen::Isometry3d ahead(double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().z() = z;
  return T;
}

/// Plays both stages' words, frame by frame.
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

std::vector<double> forward(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> z;
  for (const auto& pose : poses) z.push_back(pose.translation().z());
  return z;
}

std::vector<int> backfilled(const RunRecord& record) {
  std::vector<int> flags;
  for (const RunFrame& frame : record.frames()) flags.push_back(frame.backfilled);
  return flags;
}

constexpr VoStatus kInitialising = VoStatus::kInitialising;
constexpr VoStatus kLost = VoStatus::kLost;

/// Map from frame 1 on, found in frame 3; scale 2 m per unit from frame 5 on.
Script started() {
  Script script;
  script.no(kInitialising).no(kInitialising).no(kInitialising);
  script.tracks(3, 0, {{1, 0}, {2, 1.5}, {3, 3}}).tracks(4).metric(5, 2, 10).metric(6, 2, 12);
  return script;
}

TEST(RunRecord, FillsTheStartBackwardsWithoutAStep) {
  const Script script = started();
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 3, 6, 8, 10, 12}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0}));
  EXPECT_EQ(forward(script.record().unscaledPoses()), (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6}));
  EXPECT_EQ(script.record().trackedFrames(), 6u);
  EXPECT_EQ(script.record().lostEvents(), 0u);
}

TEST(RunRecord, HoldsTheLastPoseWhileLostAndUntilALaterMapHasItsScale) {
  Script script = started();
  script.no(kLost).no(kInitialising, 1);                      // frames 7, 8
  script.tracks(7, 1, {{8, 0}, {9, 7}}).metric(9, 3, 12, 1);  // frames 9, 10
  script.metric(11, 3, 18, 1);
  EXPECT_EQ(forward(script.record().metricPoses()),
            (std::vector<double>{0, 0, 3, 6, 8, 10, 12, 12, 12, 12, 12, 18}));
  // Up to scale, the later map goes on where the first one ended.
  EXPECT_EQ(forward(script.record().unscaledPoses()),
            (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6, 6, 6, 13, 15, 17}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(script.record().trackedFrames(), 10u);
  EXPECT_EQ(script.record().lostEvents(), 1u);
}

TEST(RunRecord, TheFirstScaleMayComeWithALaterMap) {
  Script script;
  script.no(kInitialising).tracks(1, 0, {{0, 0}, {1, 1}}).no(kLost);  // frames 0, 1, 2
  script.no(kInitialising, 1).tracks(2, 1, {{3, 0}, {4, 2}}).metric(3, 4, 12, 1);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 0, 0, 8, 12}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0}));
}

TEST(RunRecord, AFrameWithoutAPoseInTheFilledStartHoldsTheOneBefore) {
  Script script;
  script.tracks(0).tracks(1).no(kLost).tracks(3).metric(4, 2, 8);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 2, 2, 6, 8}));
  EXPECT_EQ(script.record().lostEvents(), 1u);
  EXPECT_EQ(script.record().trackedFrames(), 4u);
}

TEST(RunRecord, StandsAtTheOriginWhenThereIsNeverAScale) {
  Script script;
  script.no(kInitialising).tracks(1, 0, {{0, 0}, {1, 1}}).tracks(2);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(forward(script.record().unscaledPoses()), (std::vector<double>{0, 1, 2}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{0, 0, 0}));
}

TEST(RunRecord, RefusesFramesThatAreNotInOrder) {
  RunRecord record;
  VisualOdometry::Output vo;
  vo.frame.sequence = 1;
  EXPECT_THROW(record.append(vo, {}), std::logic_error);
}

using RunReport = TemporaryFolder;

TEST_F(RunReport, HasALineForEveryFrame) {
  const Script script = started();
  for (const std::string& table : {scaleCsv(script.record()), timingCsv(script.record())}) {
    EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 1 + 7);
    std::istringstream lines(table);
    std::string line;
    std::getline(lines, line);
    const auto columns = std::count(line.begin(), line.end(), ',');
    while (std::getline(lines, line)) {
      EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns);
    }
  }
  EXPECT_NE(scaleCsv(script.record()).find("\n3,0.300000000,"), std::string::npos);
}

TEST_F(RunReport, FiguresAreNullWithoutGroundTruth) {
  const std::string json = metricsJson(started().record(), 1.65, {});
  for (const char* member : {"\"frames\": 7,",
                             "\"tracked_frames\": 6,",
                             "\"lost_events\": 0,",
                             "\"backfilled_frames\": 5,",
                             "\"camera_height_m\": 1.65,",
                             "\"length_m\": 12,",
                             "\"gt_length_m\": null,",
                             "\"rle_percent\": null,",
                             "\"t_err_percent\": null,",
                             "\"r_err_deg_per_m\": null,",
                             "\"t_err_short_percent\": null,",
                             "\"t_err_true_length_percent\": null,",
                             "\"t_err_sim3_percent\": null,",
                             "\"direction_median_deg\": null,",
                             "\"ate_rmse_m\": null,",
                             "\"scale_within_2_sigma\": null,",
                             "\"scale_held_share\": null,",
                             "\"scale_error_median_percent\": null,",
                             "\"scale_error_spread_percent\": null,",
                             "\"height_bias_percent\": null,",
                             "\"ms_vo_median\": 40,",
                             "\"ms_vo_p95\": 67,",
                             "\"ms_scale_median\": 0,",
                             "\"ms_scale_p95\": 0,",
                             "\"ms_total_median\": 40,",
                             "\"peak_rss_mb\": ",
                             "\"by_length\": null"}) {
    EXPECT_NE(json.find(member), std::string::npos) << member << " in\n" << json;
  }
}

TEST_F(RunReport, FiguresWithGroundTruth) {
  std::vector<Eigen::Isometry3d> truth;
  for (const double z : {0, 0, 3, 6, 8, 10, 15}) truth.push_back(ahead(z));
  const std::string json = metricsJson(started().record(), 1.65, truth);
  for (const char* member :
       {"\"gt_length_m\": 15,", "\"rle_percent\": 20,", "\"t_err_percent\": null,",
        "\"t_err_short_percent\": 30,", "\"direction_median_deg\": 0,", "\"by_length\": []",
        "\"by_short_length\": [{\"length_m\": 10, \"segments\": 1, "}) {
    EXPECT_NE(json.find(member), std::string::npos) << member << " in\n" << json;
  }
  // Nowhere are there the 16 m that a true scale asks for.
  EXPECT_NE(json.find("\"scale_error_median_percent\": null,"), std::string::npos) << json;
  EXPECT_NE(json.find("\"height_bias_percent\": null,"), std::string::npos) << json;
  truth.pop_back();
  EXPECT_THROW(metricsJson(started().record(), 1.65, truth), OptionError);
}

TEST_F(RunReport, ErrorOfTheScale) {
  std::vector<Eigen::Isometry3d> truth;
  for (const double z : {0, 0, 6, 12, 16, 20, 30}) truth.push_back(ahead(z));
  const std::string json = metricsJson(started().record(), 1.65, truth);
  // Around frames 5 and 6 lie 18 m of 3 units: 6 m per unit instead of 2.
  EXPECT_NE(json.find("\"scale_error_median_percent\": -66.66666667,"), std::string::npos) << json;
}

// The truth is exact, so 2 m are enough: 7 m of 2 units around frame 5, 5 m of 1 before frame 6.
TEST_F(RunReport, FiguresWithTrueHeights) {
  std::vector<Eigen::Isometry3d> truth;
  for (const double z : {0, 0, 3, 6, 8, 10, 15}) truth.push_back(ahead(z));
  const std::string json =
      metricsJson(started().record(), 1.65, truth, std::vector<double>(7, 1.65));
  for (const char* member :
       {"\"scale_within_2_sigma\": 0,", "\"scale_held_share\": 0,",
        "\"scale_error_median_percent\": -51.42857143,", "\"scale_error_spread_percent\": null,",
        "\"height_bias_percent\": 112.5,"}) {
    EXPECT_NE(json.find(member), std::string::npos) << member << " in\n" << json;
  }
}

TEST_F(RunReport, WritesTheFilesOfARun) {
  const Script script = started();
  const auto folder = folder_ / "results" / "07";
  writeRun(folder, script.record(), 1.65, script.record().metricPoses());
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
  writeRun(folder, script.record(), 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "ground_truth.txt"));

  RunRecord without_times;
  VisualOdometry::Output vo;
  vo.times.total = std::numeric_limits<double>::quiet_NaN();
  without_times.append(vo, {});
  writeRun(folder, without_times, 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "timing.csv")) << "that of the run before";

  const auto file = write("file", "");
  EXPECT_NE(dataErrorOf([&] { writeRun(file / "07", script.record(), 1.65, {}); }, folder_),
            "no error");
}

}  // namespace
}  // namespace ground_scale_vo
