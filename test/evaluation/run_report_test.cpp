#include "ground_scale_vo/evaluation/run_report.hpp"

#include <locale>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/files.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "scripted_run.hpp"
#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using RunReport = TemporaryFolder;

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
  s.measurement = MeasurementStatus::kStandstill;
  s.raw_scale = 1.25;
  s.scale = 1234.56789;
  s.sigma = 0.125;
  s.height = 1.75;
  s.n_c = {0.5, -0.25, 0.75};
  s.triangles = 5;
  s.ground_triangles = 4;
  s.ground_points = 3;
  s.window_points = 2;
  s.plane_inliers = 1;
  s.source = ScaleSource::kSpeed;
  s.camera_height = 1.625;
  s.camera_height_sigma = 0.03125;
  RunRecord record;
  record.append(vo, scale, 9);
  EXPECT_EQ(scaleCsv(record),
            "frame,stamp,status,reason,raw_scale,scale,sigma,height,nx,ny,nz,triangles,"
            "ground_triangles,ground_points,window_points,plane_inliers,backfilled,map_id,"
            "vo_status,source,camera_height,camera_height_sigma\n0,1.500000000,held," +
                std::string(toString(s.measurement)) +
                ",1.25,1234.56789,0.125,1.75,0.5,-0.25,0.75,5,4,3,2,1,0,7,tracking,speed,1.625,0."
                "03125\n");
  EXPECT_EQ(timingCsv(record),
            "frame,decode,vo_pyramid,vo_track,vo_adjustment_wait,vo_align,vo_pose,vo_detect,"
            "vo_triangulate,vo_bundle_adjustment,vo_total,scale_delaunay,scale_gpe,scale_gpa,"
            "scale_direct,scale_filter,scale_total,total\n"
            "0,9,1,2,8,3,5,4,6,7,40,11,12,13,14,15,70,110\n");
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
                   {"smoothed", false},
                   {"length_m", 12},
                   {"length_sigma_m", 0},
                   {"ms_vo_median", 40},
                   {"ms_vo_p95", 67},
                   {"ms_scale_median", 0},
                   {"ms_scale_p95", 0},
                   {"ms_total_median", 40},
                   {"ms_total_p95", 67},
                   {"peak_rss_mb", json.at("peak_rss_mb")}};
  for (const char* member :
       {"gt_length_m", "rle_percent", "t_err_percent", "r_err_deg_per_m", "t_err_short_percent",
        "t_err_true_length_percent", "t_err_sim3_percent", "ate_rmse_m", "scale_nees",
        "scale_within_2_sigma", "scale_held_share", "scale_error_median_percent",
        "height_bias_percent", "first_scale_error_sigmas", "first_metric_pose_m",
        "covariance_by_length"}) {
    expected[member] = nullptr;
  }
  EXPECT_EQ(json, expected);
}

/// A drive of 240 m with a scale that is 4 % too large; in every fourth frame it is held. The
/// covariance makes the error along the motion one standard deviation over the whole drive.
RunRecord biasedDrive(std::vector<Eigen::Isometry3d>* ground_truth) {
  RunRecord record;
  for (int i = 0; i <= 240; ++i) {
    ScaleEstimate scale;
    scale.status = i % 4 == 3 ? ScaleStatus::kHeld : ScaleStatus::kOk;
    scale.scale = 2.08;
    scale.sigma = 0.05;
    scale.height = 1.65 / 2.08;
    appendFrame(&record, ahead(0.5 * i), i < 5 ? std::nullopt : std::optional(ahead(1.04 * i)),
                1e-3 * i * Matrix6d::Identity(), scale);
    ground_truth->push_back(ahead(i));
  }
  return record;
}

// With heights the ground truth counts as exact, otherwise as measured.
TEST_F(RunReport, HasTheMetricsOfScaleAndCovariance) {
  std::vector<Eigen::Isometry3d> ground_truth;
  const RunRecord record = biasedDrive(&ground_truth);
  const Json json =
      Json::parse(metricsJson(record, 1.65, ground_truth, std::vector<double>(241, 1.65)));
  EXPECT_EQ(json.at("scale_within_2_sigma"), 1);
  EXPECT_NEAR(json.at("first_scale_error_sigmas"), 1.6, 1e-6);
  EXPECT_NEAR(json.at("scale_held_share"), 59. / 236, 1e-6);
  EXPECT_NEAR(json.at("scale_error_median_percent"), 4, 1e-6);
  EXPECT_NEAR(json.at("height_bias_percent"), 100 * (1 / 1.04 - 1), 1e-6);
  EXPECT_EQ(json.at("first_metric_pose_m"), 5);
  EXPECT_NEAR(json.at("length_sigma_m"), std::sqrt(0.24), 1e-6);
  const Json measured = Json::parse(metricsJson(record, 1.65, ground_truth));
  for (const auto& [report, accuracy] :
       {std::pair(json, GroundTruthAccuracy()), std::pair(measured, kGpsImuAccuracy)}) {
    const auto expected = computeCovarianceMetrics(record, ground_truth, accuracy).by_length;
    ASSERT_EQ(report.at("covariance_by_length").size(), 3u);
    for (std::size_t i = 0; i < 3; ++i) {
      const Json& entry = report.at("covariance_by_length")[i];
      EXPECT_EQ(entry.at("length_m"), expected[i].length_m);
      EXPECT_EQ(entry.at("segments"), expected[i].segments);
      EXPECT_NEAR(entry.at("nees_per_dof"), expected[i].nees_per_dof, 1e-6);
      EXPECT_NEAR(entry.at("within_2_sigma"), expected[i].within_2_sigma, 1e-6);
    }
  }
  EXPECT_TRUE(measured.at("height_bias_percent").is_null());
  ground_truth.pop_back();
  EXPECT_THROW(metricsJson(record, 1.65, ground_truth), OptionError);
}

/// While it lives, streams write 1.234,5 by default, as in German.
class CommaLocale {
 public:
  ~CommaLocale() { std::locale::global(previous_); }

 private:
  struct Punctuation : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const std::locale previous_ = std::locale::global({std::locale::classic(), new Punctuation});
};

TEST_F(RunReport, WritesTheFilesOfARun) {
  const CommaLocale locale;
  std::vector<Eigen::Isometry3d> ground_truth;
  const RunRecord record = biasedDrive(&ground_truth);
  const auto folder = folder_ / "results" / "07";
  writeRun(folder, record, 1.65, ground_truth, std::vector<double>(241, 1.65));
  EXPECT_NEAR(readKittiPoses(folder / "poses.txt").back().translation().z(), 1.04 * 240, 1e-9);
  EXPECT_EQ(readKittiPoses(folder / "poses_unscaled.txt").back().translation().z(), 120);
  EXPECT_EQ(readKittiPoses(folder / "ground_truth.txt").back().translation().z(), 240);
  const TextFile stamped(folder / "trajectory_tum.txt");
  ASSERT_EQ(stamped.size(), 241u);
  EXPECT_EQ(stamped.line(6).substr(0, 11), "0.600000000");
  EXPECT_NEAR(stamped.numbers(6, 8)[3], 1.04 * 6, 1e-9);
  const Json json = Json::parse(readFile(folder / "metrics.json", 1 << 20));
  EXPECT_FALSE(json.at("height_bias_percent").is_null());
  for (const char* name : {"scale.csv", "timing.csv"}) {
    const std::string table = readFile(folder / name, 1 << 20);
    EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 1 + 241) << name;
  }
  writeRun(folder, record, 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "ground_truth.txt"));

  RunRecord without_times;
  VisualOdometry::Output vo;
  vo.times.total = std::numeric_limits<double>::quiet_NaN();
  without_times.append(vo, {});
  writeRun(folder, without_times, 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "timing.csv"))
      << "a file of the previous run is left";

  DriveRun run;
  run.record = record;
  run.readout_time = 0.01;
  writeRun(folder, run, 1.65, {});
  EXPECT_FALSE(std::filesystem::exists(folder / "camera.yaml")) << "the lens is not refined";
  run.lens = {Lens(PinholeCamera{640, 480, 410, 400, 322, 240}, 0.05, -0.02, 0.003, 0.001, -0.002),
              LensMatrix::Identity()};
  writeRun(folder, run, 1.65, {});
  const CameraCalibration refined = readCameraFile(folder / "camera.yaml");
  EXPECT_EQ(refined.readout_time, 0.01);
  EXPECT_EQ(lensOf(refined).project({0.3, 0.2}), run.lens.lens.project({0.3, 0.2}));

  const auto file = write("file", "");
  EXPECT_NE(dataErrorOf([&] { writeRun(file / "07", record, 1.65, {}); }, folder_), "no error");
}

}  // namespace
}  // namespace gsv
