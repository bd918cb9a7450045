#include "ground_scale_vo/evaluation/drive_run.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <system_error>

#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/common/write_file.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/input/camera_file.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

/// Of the frames with a metric pose.
struct Shares {
  std::size_t metric = 0, held = 0;
  const RunFrame* first_metric = nullptr;
  const RunFrame* last_metric = nullptr;
};

Shares sharesOf(const RunRecord& record) {
  Shares shares;
  for (const RunFrame& frame : record.frames()) {
    if (!frame.has_metric_pose) continue;
    ++shares.metric;
    if (frame.scale.status == ScaleStatus::kHeld) ++shares.held;
    if (!shares.first_metric) shares.first_metric = &frame;
    shares.last_metric = &frame;
  }
  return shares;
}

/// Of the frames without a metric pose.
std::string mostFrequentReason(const RunRecord& record) {
  std::map<std::string, std::size_t> counts;
  for (const RunFrame& frame : record.frames()) {
    if (frame.has_metric_pose) continue;
    ++counts[frame.vo_status == VoStatus::kTracking
                 ? std::string("the scale is not known (") + toString(frame.scale.measurement) + ")"
                 : std::string("the odometry is ") + toString(frame.vo_status)];
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == counts.end() ? "there is no image" : most->first;
}

/// The first-order length error: that of the displacement, which the covariance holds, along the
/// whole path in proportion.
double lengthSigma(const RunRecord& record, const RunFrame& last, double length) {
  const Eigen::Vector3d displacement =
      last.T_o_c.translation() - record.frames().front().T_o_c.translation();
  const double distance = displacement.norm();
  if (!(distance > 0)) return std::sqrt(last.covariance.topLeftCorner<3, 3>().trace());
  const Eigen::Vector3d along = displacement / distance;
  const double sigma = std::sqrt(along.dot(last.covariance.topLeftCorner<3, 3>() * along));
  return sigma * std::max(1.0, length / distance);
}

}  // namespace

std::string DriveRun::summary() const {
  const std::vector<RunFrame>& frames = record.frames();
  std::string text = std::to_string(images) + " images, " + std::to_string(used) + " used, " +
                     std::to_string(images - used) + " lost, " +
                     std::to_string(record.trackedFrames()) + " tracked; ";
  const Shares shares = sharesOf(record);
  if (!shares.first_metric) return text + "no metric pose";
  const double length = pathLength(record.metricPoses());
  const Eigen::Vector3d first =
      shares.first_metric->T_o_c.translation() - frames.front().T_o_c.translation();
  return text +
         format("first metric pose after %.1f s and %.1f m, scale held in %.0f %%; ",
                secondsBetween(*first_stamp_ns, shares.first_metric->stamp_ns), first.norm(),
                100.0 * static_cast<double>(shares.held) / static_cast<double>(shares.metric)) +
         format("length %.1f m, standard deviation %.1f m", length,
                lengthSigma(record, *shares.last_metric, length));
}

DriveRun runDrive(DriveReader* drive, const DriveRun::Options& options,
                  const DriveRun::OnFrame& on_frame) {
  MetricOdometry::Options odometry_options = options.odometry;
  const CalibratedCamera& camera = drive->camera();
  odometry_options.odometry.vo.readout_time = camera.calibration().readout_time;
  for (const std::string& setting : options.settings) setOption(odometry_options, setting);
  odometry_options.validate();
  MetricOdometry odometry(lensOf(camera.givenCalibration()), odometry_options, drive->givenMask());

  DriveRun run;
  std::optional<std::int64_t> first_ns;
  std::size_t unused_in_part = 0;
  while (const auto image = drive->next()) {
    run.stamps_ns.push_back(image->stamp_ns);
    const bool is_used = !image->given.empty();
    if (is_used && !first_ns) first_ns = image->stamp_ns;
    const double since_s = first_ns ? secondsBetween(*first_ns, image->stamp_ns) : 0;
    if (since_s < options.from_s || since_s > options.to_s) continue;
    if (is_used) {
      if (!run.first_stamp_ns) run.first_stamp_ns = image->stamp_ns;
      const MetricOdometry::Output output = odometry.process(image->given, image->stamp_ns);
      run.record.append(output.vo, output.scale, image->decode_ms);
    } else {
      ++unused_in_part;
      run.record.appendUnused(image->stamp_ns);
    }
    on_frame(run.record.frames().back());
  }
  run.lens = odometry.lens();
  run.images = drive->read();
  run.used = drive->used();
  run.warnings = drive->warnings();
  const DriveRun::Options whole;
  const bool is_part = options.from_s > whole.from_s || options.to_s < whole.to_s;
  if (!is_part || unused_in_part > 0) run.failure = drive->failure();
  const Shares shares = sharesOf(run.record);
  if (run.failure.empty() && !shares.first_metric) {
    run.failure = "no metric pose: " + mostFrequentReason(run.record);
  }
  const std::size_t tracked = run.record.trackedFrames(), frames = run.record.frames().size();
  if (run.failure.empty() && 2 * tracked < frames) {
    run.failure = "the odometry tracked in only " + std::to_string(tracked) + " of " +
                  std::to_string(frames) + " images: are they in order, and of one drive?";
  }
  if (2 * shares.held > shares.metric) {
    run.warnings.push_back(
        "the scale is held in more than half of the images: is the road in front "
        "of the camera visible, and the camera upright?");
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
  if (!run.lens.isEstimate()) return;
  writeFile(folder / "camera.yaml",
            cameraYaml(calibrationOf(run.lens.lens), "Refined while driving."));
}

}  // namespace ground_scale_vo
