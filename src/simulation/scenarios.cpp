#include "ground_scale_vo/simulation/scenarios.hpp"

#include <functional>
#include <limits>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/scale_metrics.hpp"

namespace ground_scale_vo {
namespace {

using Options = SyntheticDrive::Options;

constexpr double kDegree = 0.017453292519943295;

/// A drive without a stop, changed by one scenario.
Scenario drive(const char* name, const char* what, int frames,
               const std::function<void(Options&)>& change, const ScenarioAblation& remedy = {},
               std::optional<Scenario::Frames> road_hidden = {}, const DriveThresholds& bars = {}) {
  Scenario result{name, what, {}, road_hidden, remedy, bars};
  result.options.frames = frames;
  result.options.stop_s = 0;
  change(result.options);
  return result;
}

/// Until the cars ahead drive off there is hardly any road.
DriveThresholds waitsForTheRoad() {
  DriveThresholds bars;
  bars.metric_share = 0.3;
  return bars;
}

/// OPEN: now and then a frame of bare road still finds something to measure.
DriveThresholds seesALineEnd() {
  DriveThresholds bars;
  bars.ok_while_hidden = 0.1;
  return bars;
}

/// OPEN: the strip takes in some of the pavement, which makes the height 1 % too low, and sigma
/// does not say so.
DriveThresholds doesNotKnowOfThePavement() {
  DriveThresholds bars;
  bars.within_2_sigma = 0.65;
  return bars;
}

void setCamera(Options& o, int width, int height, double focal) {
  o.camera.width = width;
  o.camera.height = height;
  o.camera.fx = o.camera.fy = focal;
  o.camera.cx = (width - 1) / 2.0;
  o.camera.cy = (height - 1) / 2.0;
}

/// KITTI's field of view in 480x150: a third of the time.
void setSmallCamera(Options& o) { setCamera(o, 480, 150, 278); }

void setNight(Options& o) {
  o.headlamps = true;
  o.shadows = o.moving_cars = false;
}

}  // namespace

std::vector<Scenario> allScenarios() {
  return {
      drive("car_close_ahead", "a car 5 to 6 m before the camera", 60,
            [](Options& o) { o.lead_gap = 5.2, o.lead_time = 0.05; },
            {"points: the lane shows no road to the pixels", {}, {kDirectOnly}}),
      drive("van_close_ahead", "a van 6 m ahead that fills the lane", 60,
            [](Options& o) { o.lead_van = true, o.lead_gap = 5.5, o.lead_time = 0.05; },
            {"points: the van hides the lane from the pixels", {}, {kDirectOnly}}),
      drive("cars_beside", "two cars keep pace in the next lane, one drives ahead", 60,
            [](Options& o) { o.cars_beside = 2, o.lead_time = 0.6; },
            {"a strip no wider than the lane", {kDirectOnly}, {"refinement/half_width_h=4"}}),
      drive(
          "crawl_start", "the drive begins at walking pace, close behind and beside others", 110,
          [](Options& o) {
            o.speeds = {{0, 1.4}, {4, 1.4}, {7.5, 8}};
            o.cars_beside = 3;
            o.lead_gap = 5;
            o.lead_time = 0.4;
          },
          {"ground on one side alone tells little", {}, {"fit/camber_sigma_rad=1e-9"}}, {},
          waitsForTheRoad()),
      drive("own_shadow", "low sun from behind: the own shadow lies on the road ahead", 60,
            [](Options& o) {
              o.own_shadow = true;
              o.road_texture = 0.6;
              o.sun = {-0.96, 0.12, 0.15};
              o.curvature = 0.01;
              o.moving_cars = false;
            },
            {"what stands still in the image is learnt and masked",
             {kDirectOnly},
             {"refinement/static_memory_h=1000000"}}),
      drive("tree_shadows", "shadows of trees, houses and parked cars across the lane", 60,
            [](Options& o) {
              o.sun = {0.2, -0.78, 0.6};
            }),
      drive("puddles", "half of the road is a mirror of sky, trees and houses", 60,
            [](Options& o) { o.puddles = 0.5, o.slope = 0, o.shadows = false; }),
      drive(
          "lines_only", "47 m of straight asphalt that shows nothing but lines along the road", 90,
          [](Options& o) {
            o.solid_lines = true;
            o.bare_from_m = 28;
            o.bare_to_m = 75;
            o.shadows = o.moving_cars = false;
            o.curvature = o.slope = 0;  // a bend would show how far off the lines are
          },
          {"a patch whose gradients have one direction is no corner",
           {},
           {"tracker/min_corner_ratio=0"}},
          Scenario::Frames{33, 60}, seesALineEnd()),
      drive("arrows_and_lines", "bare asphalt with lines along the road and an arrow every 12 m",
            60,
            [](Options& o) {
              o.solid_lines = true;
              o.arrow_spacing = 12;
              o.road_texture = 0;
              o.shadows = o.moving_cars = false;
            },
            {"points beside the pixels, and tiles must correlate",
             {},
             {kDirectOnly, "refinement/min_correlation=0"}}),
      drive("speed_bumps", "bumps of 12 cm at 15 km/h", 100,
            [](Options& o) { o.bump_height = 0.12, o.speed = 4.2, o.slope = 0; },
            {"the road may bend up and down", {kDirectOnly}, {"refinement/bend_sigma=1e-9"}}),
      drive("cobbles", "cobbles that shake the car", 60,
            [](Options& o) { o.cobbles = true, o.suspension = 2, o.lane_markings = false; }),
      drive(
          "kerb_side", "the camera 1 m beside the kerb", 60,
          [](Options& o) { o.lane_offset = -3.3, o.parked_cars = o.moving_cars = false; },
          {"only the lane is looked at, by points and by pixels",
           {},
           {"gpe/lane_h=4", "refinement/half_width_h=3"}},
          {}, doesNotKnowOfThePavement()),
      drive("tight_bends", "bends of 12.5 m radius", 90,
            [](Options& o) {
              o.curvature = 0.08;
              o.speed = 5;
              o.slope = 0;
              o.moving_cars = false;
            }),
      drive("slope_edges", "foot and crest of a ramp of 8 %", 75,
            [](Options& o) {
              o.slope = 0;
              o.ramp_slope = 0.08;
              o.ramp_from_m = 22;
              o.ramp_to_m = 46;
            },
            {"the points of the last metres only", {kFeatureBasedOnly}, {"gpa/window_h=30"}}),
      drive("hill", "up a hill of 10 % and over its top (200 m radius)", 85,
            [](Options& o) { o.slope = 0.1, o.curvature = 0.01; },
            {"the road may bend up and down", {kDirectOnly}, {"refinement/bend_sigma=1e-9"}}),
      drive("weak_texture", "asphalt of a seventh of the contrast, without markings, overcast", 60,
            [](Options& o) {
              o.road_texture = 0.15;
              o.lane_markings = o.shadows = false;
            },
            {"weak corners are corners", {}, {"tracker/min_corner_strength=0.001"}}),
      drive("small_steps", "0.2 m between images", 110,
            [](Options& o) { o.speed = 4, o.frame_rate_hz = 20; },
            {"pixels are compared over a fixed way, not with the image before",
             {kDirectOnly},
             {"refinement/baseline_h=0.06"}}),
      drive("large_steps", "3.1 m between images", 45,
            [](Options& o) {
              o.speed = 25;
              o.frame_rate_hz = 8;
              o.curvature = 0.003;
              o.lead_time = 1;
            },
            {"a start may rest on fewer than 60 % of the matches",
             {},
             {"two_view/min_inlier_share=0.6"}}),
      drive(
          "stop", "braking, a second of standstill, and on", 80,
          [](Options& o) {
            o.speeds = {{0, 7}, {2, 7}, {4, 0}, {5, 0}, {7, 7}};
            o.speed = 7;
          },
          {"standstill is noticed", {}, {"min_step_h=0", "odometry/standstill_flow=0"}},
          Scenario::Frames{42, 50}),
      drive(
          "reversing", "forward, a stop, and 6 m back", 85,
          [](Options& o) {
            o.speeds = {{0, 6}, {3, 6}, {4.5, 0}, {5, 0}, {6.5, -3}};
            o.speed = 6;
            o.moving_cars = false;
          },
          {"standstill is noticed", {}, {"min_step_h=0", "odometry/standstill_flow=0"}},
          Scenario::Frames{47, 49}),
      drive(
          "traffic_passes", "standing for 5 s in a row of oncoming cars", 100,
          [](Options& o) {
            setSmallCamera(o);
            o.speeds = {{0, 7}, {2, 7}, {3.5, 0}, {8.5, 0}, {9.5, 6}};
            o.speed = 7;
            o.oncoming_spacing = 11;
            o.lead_time = 0;
          },
          {}, Scenario::Frames{37, 84}),
      drive("off_road", "a bumpy gravel track without markings", 90,
            [](Options& o) {
              setSmallCamera(o);
              o.off_road = true;
              o.suspension = 2;
              o.speed = 6;
              o.moving_cars = o.parked_cars = o.shadows = false;
            }),
      drive("bridge", "over a bridge: parapets, and the ground beside it lies 9 m below", 90,
            [](Options& o) {
              setSmallCamera(o);
              o.bridge_from_m = 20;
              o.bridge_to_m = 75;
              o.parked_cars = false;
            }),
      drive("underpass", "through an underpass: suddenly dark, and light again", 90,
            [](Options& o) {
              setSmallCamera(o);
              o.underpass_from_m = 30;
              o.underpass_to_m = 55;
              o.parked_cars = o.moving_cars = false;
            }),
      drive("crawl_bends", "bends of 12.5 m radius at 9 km/h", 150,
            [](Options& o) {
              setSmallCamera(o);
              o.curvature = 0.08;
              o.speed = 2.5;
              o.slope = 0;
              o.moving_cars = false;
            }),
      drive("night", "headlamps light the road near the car, hardly anything else is seen", 60,
            [](Options& o) { o.daylight = 0.01, o.noise_sigma = 2, setNight(o); }),
      drive("night_noisy", "the same, darker, with a sensor at its limits", 30,
            [](Options& o) { o.daylight = 0.004, o.noise_sigma = 3, setNight(o); },
            {"a start may rest on fewer than 60 % of the matches",
             {},
             {"two_view/min_inlier_share=0.6"}}),
      drive(
          "jpeg", "compressed at quality 15", 60, [](Options& o) { o.jpeg_quality = 15; },
          {"points: the blocks of the compression leave the pixels no texture", {}, {kDirectOnly}}),
      drive("camera_low", "a small robot's camera, 0.5 m high", 70,
            [](Options& o) { o.camera_height = 0.5, o.speed = 4, o.grain = 0.12; }),
      drive("camera_high", "a lorry's camera, 2.5 m high", 60,
            [](Options& o) { o.camera_height = 2.5; }),
      drive("pitched", "mounted 6 degrees down", 60, [](Options& o) { o.pitch_rad = 6 * kDegree; },
            {"the mounting's pitch is not taken for known",
             {kDirectOnly},
             {"mounting/start_pitch_sigma=1e-4"}}),
      drive("rolled", "mounted 3 degrees askew", 60, [](Options& o) { o.roll_rad = 3 * kDegree; }),
      drive("hood", "the own hood covers the lower edge", 60, [](Options& o) { o.hood = 0.2; },
            {"points: the lane shows hardly any road to the pixels", {}, {kDirectOnly}}),
      drive("wide_angle", "640x480 with 90 degrees of view", 50,
            [](Options& o) { setCamera(o, 640, 480, 320), o.grain = 0.12; }),
      drive("tele", "38 degrees of view: the nearest road is 16 m off", 60,
            [](Options& o) { setCamera(o, 800, 248, 1160); },
            {"points as far off as the road is seen", {}, {"gpe/max_ahead_h=10"}}),
      drive("large_image", "960x540, half of a 1920x1080 camera of 69 degrees", 45,
            [](Options& o) { setCamera(o, 960, 540, 700), o.grain = 0.12; }),
  };
}

Scenario findScenario(const std::string& name) {
  std::string names;
  for (Scenario& scenario : allScenarios()) {
    if (scenario.name == name) return std::move(scenario);
    names += (names.empty() ? "" : ", ") + scenario.name;
  }
  throw OptionError("'" + name + "' is no scenario, these are: " + names);
}

std::vector<cv::Mat> renderDrive(const SyntheticDrive& drive, const std::function<void()>& each) {
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    images.push_back(drive.image(i));
    if (each) each();
  }
  return images;
}

RunRecord runDrive(const SyntheticDrive& drive, const std::vector<cv::Mat>& images,
                   const std::vector<std::string>& assignments, const std::function<void()>& each) {
  OfflineRun::Options options;
  options.scale.camera_height = drive.cameraHeight();
  for (const std::string& assignment : assignments) setOption(options, assignment);
  OfflineRun run(drive.camera(), options);
  for (std::size_t i = 0; i < images.size(); ++i) {
    run.process(images[i], drive.frame(i).stamp_ns);
    if (each) each();
  }
  return run.record();
}

std::string violatedThreshold(const DriveFigures& figures, const DriveThresholds& bars) {
  if (figures.tracked_frames != figures.frames || figures.lost_events > 0) return "lost";
  const auto frames = static_cast<double>(figures.frames);
  if (!(static_cast<double>(figures.metric_frames) > bars.metric_share * frames)) return "start";
  if (!(figures.rle_percent <= bars.rle_percent)) return "RLE";
  if (!(figures.within_2_sigma >= bars.within_2_sigma)) return "2 sigma";
  return figures.ok_while_hidden <= bars.ok_while_hidden ? "" : "ok hidden";
}

DriveFigures driveFigures(const Scenario& scenario, const SyntheticDrive& drive,
                          const RunRecord& record) {
  const std::vector<RunFrame>& frames = record.frames();
  if (frames.size() != drive.size()) {
    throw OptionError("the run has " + std::to_string(frames.size()) + " frames, the drive " +
                      std::to_string(drive.size()));
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  DriveFigures figures;
  figures.frames = frames.size();
  figures.tracked_frames = record.trackedFrames();
  figures.lost_events = record.lostEvents();
  figures.rle_percent = figures.t_err_short_percent = kNone;

  std::vector<Eigen::Isometry3d> all_truth, truth, estimate;
  std::size_t hidden_ok = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const RunFrame& frame = frames[i];
    all_truth.push_back(drive.frame(i).T_c0_c);
    if (scenario.road_hidden && i >= scenario.road_hidden->first &&
        i <= scenario.road_hidden->last) {
      hidden_ok += frame.scale.status == ScaleStatus::kOk;
    }
    if (truth.empty() && !frame.has_metric_pose) continue;
    truth.push_back(all_truth.back());
    estimate.push_back(frame.T_o_c);
  }
  figures.metric_frames = truth.size();
  if (truth.size() > 1) {
    const OdometryMetrics metrics = computeOdometryMetrics(truth, estimate);
    figures.rle_percent = metrics.rle_percent.value_or(kNone);
    figures.t_err_short_percent = metrics.t_err_short_percent.value_or(kNone);
  }
  const ScaleMetrics scale = computeScaleMetrics(record, all_truth, kExactGroundTruthDistance);
  figures.scale_error_percent = scale.error_abs_median_percent;
  figures.within_2_sigma = scale.within_2_sigma;
  figures.held = scale.held_share;
  if (scenario.road_hidden) {
    const std::size_t hidden = scenario.road_hidden->last - scenario.road_hidden->first + 1;
    figures.ok_while_hidden = static_cast<double>(hidden_ok) / static_cast<double>(hidden);
  }
  return figures;
}

}  // namespace ground_scale_vo
