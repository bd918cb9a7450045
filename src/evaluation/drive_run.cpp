#include "ground_scale_vo/evaluation/drive_run.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "common/files.hpp"
#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/clock_offset.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/run_failure.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/input/camera_file.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

/// Relative standard deviation of the focal length above which it is stated: more than that of a
/// calibration.
constexpr double kStatedFocalSigma = 0.004;

/// The frames with a metric pose.
struct MetricFrames {
  std::size_t count = 0, held = 0;
  const RunFrame* first = nullptr;
  const RunFrame* last = nullptr;
};

MetricFrames metricFramesOf(const RunRecord& record) {
  MetricFrames metric;
  for (const RunFrame& frame : record.frames()) {
    if (!frame.has_metric_pose) continue;
    if (metric.count++ == 0) metric.first = &frame;
    if (frame.scale.status == ScaleStatus::kHeld) ++metric.held;
    metric.last = &frame;
  }
  return metric;
}

/// Every kind of sentence about the speeds that holds for a second or more, with its first wording.
void addSpeedWarnings(const RunRecord& record, std::vector<std::string>* warnings) {
  constexpr std::size_t kMinFrames = 10, kKindLength = 14;
  struct Kind {
    std::string sentence;
    std::size_t frames = 0;
  };
  std::map<std::string, Kind> kinds;
  for (const RunFrame& frame : record.frames()) {
    if (frame.speed_warning.empty()) continue;
    Kind& kind = kinds[frame.speed_warning.substr(0, kKindLength)];
    if (kind.frames++ == 0) kind.sentence = frame.speed_warning;
  }
  for (const auto& [key, kind] : kinds) {
    if (kind.frames < kMinFrames) continue;
    warnings->push_back(format("%s (%zu images)", kind.sentence.c_str(), kind.frames));
  }
}

/// Its five parameters that a drive determines, to six digits.
Json lensJson(const Lens& lens) {
  Json json;
  const auto add = [&json](const char* name, double value) {
    json[name] = Json::parse(format("%.6g", value));
  };
  add("f", lens.camera.fx);
  add("cx", lens.camera.cx);
  add("cy", lens.camera.cy);
  add("k1", lens.k1);
  add("k2", lens.k2);
  return json;
}

std::string runJson(const DriveRun& run) {
  Json json = {{"failure", run.failure}, {"warnings", run.warnings}};
  json["given_lens"] = lensJson(run.given_lens);
  if (run.lens.isEstimate()) {
    const LensVector sigmas = run.lens.sigmas();
    json["lens"] = lensJson(run.lens.lens);
    json["lens_sigma"] =
        lensJson(Lens({0, 0, run.lens.lens.camera.fx * sigmas[0], 0, sigmas[1], sigmas[2]},
                      sigmas[3], sigmas[4]));
  }
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// Of the odometry, in the units of its maps.
std::vector<SpeedSample> unscaledSpeeds(const RunRecord& record) {
  std::vector<SpeedSample> speeds;
  const RunFrame* last = nullptr;
  for (const RunFrame& frame : record.frames()) {
    if (!frame.has_vo_pose) continue;
    if (last && last->map_id == frame.map_id) {
      const std::int64_t middle_ns = last->stamp_ns + (frame.stamp_ns - last->stamp_ns) / 2;
      const double step = (frame.T_w_c.translation() - last->T_w_c.translation()).norm();
      speeds.push_back({middle_ns, step / secondsBetween(last->stamp_ns, frame.stamp_ns), 0});
    }
    last = &frame;
  }
  return speeds;
}

/// Without sign, and without the repetitions of a value that the sensor holds.
std::vector<SpeedSample> measuredMagnitudes(const std::vector<SpeedSample>& speeds) {
  std::vector<SpeedSample> result;
  for (SpeedSample speed : speeds) {
    speed.speed = std::abs(speed.speed);
    const bool is_held = !result.empty() && speed.speed == result.back().speed && speed.speed > 0;
    if (!is_held) result.push_back(speed);
  }
  return result;
}

/// The speeds by the clock of the images.
std::vector<SpeedSample> shifted(const DriveRun::Options& options) {
  std::vector<SpeedSample> speeds = options.speeds;
  for (SpeedSample& speed : speeds) speed.stamp_ns += std::llround(1e9 * options.speed_offset);
  return speeds;
}

/// That no speed is of the time of the images, up to a colon; else empty.
std::string missedBySpeeds(std::int64_t first_ns, std::int64_t last_ns,
                           const std::vector<SpeedSample>& speeds) {
  if (speeds.front().stamp_ns <= last_ns && speeds.back().stamp_ns >= first_ns) return "";
  return format("no speed is used: the images are from %s to %s s, the speeds from %s to %s s: ",
                formatSeconds(first_ns).c_str(), formatSeconds(last_ns).c_str(),
                formatSeconds(speeds.front().stamp_ns).c_str(),
                formatSeconds(speeds.back().stamp_ns).c_str());
}

/// Throws DataError, before the drive, where its stamps are known.
void requireSpeeds(const DriveReader& drive, const DriveRun::Options& options) {
  const auto span = options.speeds.empty() ? std::nullopt : drive.span();
  if (!span) return;
  const std::string missed = missedBySpeeds(span->first, span->second, shifted(options));
  if (missed.empty()) return;
  throw DataError(missed + format("--speed-offset %.2f lets both begin together",
                                  secondsBetween(options.speeds.front().stamp_ns, span->first)));
}

/// Why the speeds do not belong to the images, or empty: another clock, by the motion; another
/// unit.
std::string speedFailure(const RunRecord& record, const DriveRun::Options& options) {
  constexpr double kMaxOffset = 0.3, kOffsetSigmas = 4;
  if (options.speeds.empty() || record.frames().empty()) return "";
  const auto offset = clockOffset(unscaledSpeeds(record), measuredMagnitudes(options.speeds));
  const std::string remedy = offset ? format("the motion suggests --speed-offset %.2f",
                                             options.speed_offset + offset->offset_s)
                                    : std::string("--speed-offset S adds S to their stamps");
  const std::string missed = missedBySpeeds(record.frames().front().stamp_ns,
                                            record.frames().back().stamp_ns, options.speeds);
  if (!missed.empty()) return missed + remedy;
  if (offset &&
      std::abs(offset->offset_s) > std::max(kMaxOffset, kOffsetSigmas * offset->sigma_s)) {
    return format("the speeds are %.2f s %s than the motion in the images: ",
                  std::abs(offset->offset_s), offset->offset_s < 0 ? "later" : "earlier") +
           remedy;
  }
  return record.frames().back().speed_error;
}

MetricOdometry::Options optionsOf(const DriveRun::Options& options, const DriveReader& drive) {
  MetricOdometry::Options result = options.odometry;
  result.odometry.vo.readout_time = drive.camera().readout_time;
  for (const std::string& setting : options.settings) setOption(result, setting);
  if (!options.speeds.empty()) result.scale.use_speed = true;
  result.scale.record = options.smooth;
  result.validate();
  if (options.smooth) result.scale.requireSmoothable();
  return result;
}

}  // namespace

std::string DriveRun::summary() const {
  const std::vector<RunFrame>& frames = record.frames();
  const std::string text = format("%zu images, %zu used, %zu lost, %zu tracked; ", frames.size(),
                                  used, frames.size() - used, record.trackedFrames());
  const MetricFrames metric = metricFramesOf(record);
  if (metric.count == 0) return text + "no metric pose";
  const Eigen::Vector3d start = frames.front().T_o_c.translation();
  return text +
         format("first metric pose after %.1f s and %.1f m, scale held in %.0f %%; ",
                secondsBetween(frames.front().stamp_ns, metric.first->stamp_ns),
                (metric.first->T_o_c.translation() - start).norm(),
                100.0 * static_cast<double>(metric.held) / static_cast<double>(metric.count)) +
         format("length %.1f m, standard deviation %.1f m", pathLength(record.metricPoses()),
                record.lengthSigma()) +
         (lens.isEstimate() && lens.sigmas()[0] > kStatedFocalSigma
              ? format(" and %.1f %% for the focal length, a common factor of all lengths",
                       100 * lens.sigmas()[0])
              : "") +
         (record.usedSpeeds() && metric.last->scale.camera_height_sigma > 0
              ? format("; camera height %.3f m, standard deviation %.3f m",
                       metric.last->scale.camera_height, metric.last->scale.camera_height_sigma)
              : "");
}

DriveLens lensOfDrive(const RepeatableDrive& images, const DriveReader& drive,
                      const DriveRun::Options& options, bool is_rough) {
  constexpr int kRuns = 3;            // the first one has the tracks of the calibration
  constexpr int kTracksPerCell = 10;  // more take longer and gain nothing
  requireSpeeds(drive, options);
  LensCalibration::Options calibration;
  calibration.vo = optionsOf(options, drive).odometry.vo;
  calibration.max_runs = kRuns;
  calibration.is_rough = is_rough;
  calibration.estimator.tracks_per_cell = kTracksPerCell;
  const RepeatableDrive same_images = [&images](const ImageVisitor& visit) { images(visit); };
  const LensCalibration::Result result =
      LensCalibration(calibration).calibrate({same_images}, lensOf(drive.camera()), drive.mask());
  DriveLens lens{LensEstimate{lensOf(drive.camera())}, {}};
  if (is_rough && result.status != LensEstimator::Status::kOk) {
    throw DataError("the lens is not observable: " + result.reason);
  }
  if (result.status != LensEstimator::Status::kOk) {
    lens.contradiction = result.drives.front().contradiction;
  } else if (!result.confirmed) {
    lens.estimate = result.estimate;
    lens.estimate.lens.camera.lens_is_estimated = true;
    lens.estimate.lens.camera.k1_sigma = lens.estimate.sigmas()[3];
  }
  return lens;
}

DriveRun runDrive(DriveReader* drive, DriveRun::Options options,
                  const DriveRun::OnFrame& on_frame) {
  requireSpeeds(*drive, options);
  options.speeds = shifted(options);
  MetricOdometry::Options odometry_options = optionsOf(options, *drive);
  CameraCalibration camera = drive->camera();
  if (options.lens) {
    odometry_options.odometry.refine_camera = false;
    const LensEstimate& estimate = options.lens->estimate;
    if (estimate.isEstimate()) camera = calibrationOf(estimate.lens);
    camera.is_part = drive->camera().is_part;
  }
  OfflineRun offline(camera, odometry_options, drive->mask());
  offline.setSpeeds(options.speeds);
  const CameraCalibration* in_use = &drive->camera();
  while (const auto image = drive->next()) {
    if (image->grey.empty()) {
      offline.appendUnused(image->stamp_ns);
    } else {
      if (image->camera.get() != in_use) offline.changeCamera(camera = *image->camera);
      in_use = image->camera.get();
      offline.process(image->grey, image->stamp_ns, image->decode_ms);
    }
    on_frame(offline.record().frames().back());
  }
  if (options.smooth) offline.smooth();
  DriveRun run;
  run.record = offline.record();
  run.given_lens = lensOf(drive->camera());
  run.lens = options.lens ? options.lens->estimate : offline.lens();
  run.readout_time = odometry_options.odometry.vo.readout_time;
  run.used = drive->used();
  run.warnings = drive->warnings();
  run.failure = drive->failure();
  if (run.failure.empty()) run.failure = speedFailure(run.record, options);
  addSpeedWarnings(run.record, &run.warnings);
  if (run.failure.empty()) run.failure = failureOf(run.record);
  if (run.failure.empty()) {
    run.failure = options.lens ? options.lens->contradiction : offline.finalLensContradiction();
  }
  return run;
}

std::string resultName(const std::string& drive) {
  std::error_code ignored;
  fs::path path = fs::absolute(drive, ignored).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  return fs::is_directory(path, ignored) ? path.filename() : path.stem();
}

void writeRun(const fs::path& folder, const DriveRun& run, double camera_height,
              const GroundTruth& truth) {
  writeRun(folder, run.record, camera_height, truth.poses, truth.heights);
  writeFile(folder / "run.json", runJson(run));
  if (!run.lens.isEstimate()) return;
  CameraCalibration camera = calibrationOf(run.lens.lens);
  camera.readout_time = run.readout_time;
  writeFile(folder / "camera.yaml", cameraYaml(camera, "Estimated from the drive."));
}

}  // namespace gsv
