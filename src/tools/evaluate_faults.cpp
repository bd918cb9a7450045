// Renders drives with faults in random order and of random duration and evaluates the pipeline on
// each.

#include <cstdio>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/simulation/fault_drives.hpp"
#include "ground_scale_vo/simulation/fault_evaluation.hpp"
#include "support/command_line.hpp"
#include "support/parallel_for.hpp"
#include "support/progress_line.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kDetails =
    R"(Without a NAME: the ten drives with two faults each. A line for each fault and each segment without
one. hides: the ground is not visible. detected: seconds from the first faulty frame until HELD or
LOST, nan: never; ok: faulty frames 3 s or more after the first one with the scale reported as
measured; tracking, metric: frames after the fault until there is a pose, and a metric pose with a
measured scale, again, -1: never. From the last frame before the fault to the beginning of the next
segment: excess path: estimated minus true path length, if positive; error and sigma: the error of the
position, and the growth of its standard deviation. A segment begins 3 s and 20 m after a fault; error:
of the relative position over it, relative to its length.

Exit status: 0 all thresholds are met, 1 one is violated, 2 the arguments cannot be used.)";

struct Arguments {
  std::vector<std::string> names;
  int seed = 20;
  int threads = 1;
};

void print(const gsv::FaultDrive& drive, const gsv::FaultDriveMetrics& metrics) {
  const gsv::SyntheticDrive::Options& o = drive.options;
  std::printf(
      "%s: %zu frames at %.0f Hz, %dx%d, camera %.2f m high, %.1f m/s; %zu tracked, %zu not "
      "finite\n",
      drive.name.c_str(), metrics.frames, o.frame_rate_hz, o.camera.width, o.camera.height,
      o.camera_height, o.speed, metrics.tracked_frames, metrics.non_finite_frames);
  for (const gsv::FaultFreeSegment& s : metrics.segments) {
    std::printf("  frames %3zu to %3zu: %5.1f m, error %.2f %%\n", s.first, s.last, s.length_m,
                s.error_percent);
  }
  for (std::size_t i = 0; i < metrics.faults.size(); ++i) {
    const gsv::FaultMetrics& f = metrics.faults[i];
    std::printf(
        "  frames %3zu to %3zu: %-13s %4.1f s%s: detected %.1f s, ok %zu, tracking %d, "
        "metric %d, excess path %.2f m, error %.1f m, sigma %.1f m\n",
        drive.faults[i].first, drive.faults[i].last, f.name.c_str(), f.duration_s,
        f.hides_ground ? ", hides" : "", f.detection_delay_s, f.ok_frames,
        f.tracking_recovery_frames, f.metric_recovery_frames, f.excess_path_m, f.position_error_m,
        f.sigma_m);
  }
  const std::string violated = gsv::violatedThreshold(metrics);
  if (!violated.empty()) std::printf("  VIOLATED: %s\n", violated.c_str());
}

std::vector<gsv::FaultDrive> selectDrives(const Arguments& arguments) {
  const auto seed = static_cast<std::uint64_t>(arguments.seed);
  std::vector<gsv::FaultDrive> drives;
  for (const std::string& name : arguments.names) drives.push_back(gsv::faultDrive(name, seed));
  for (std::size_t i = 0; arguments.names.empty() && i < gsv::kFaultDriveCount; ++i) {
    drives.push_back(gsv::faultDrive(i, seed));
  }
  return drives;
}

/// Returns the number of drives that violate a threshold.
int run(const std::vector<gsv::FaultDrive>& drives, int threads) {
  cv::setNumThreads(1);
  std::size_t frames = 0;
  for (const gsv::FaultDrive& drive : drives) {
    frames += static_cast<std::size_t>(drive.options.frames);
  }
  int violations = 0;
  gsv::ProgressLine progress("evaluate_faults", frames);
  gsv::parallelFor(drives.size(), threads, [&](std::size_t i) {
    const gsv::FaultDriveMetrics metrics = gsv::runFaultDrive(
        drives[i],
        [&](std::size_t, const cv::Mat&, const gsv::OfflineRun&) { progress.step("frames"); });
    progress.pause([&] {
      print(drives[i], metrics);
      violations += !gsv::violatedThreshold(metrics).empty();
    });
  });
  std::printf("%zu drives, %d with a violated threshold\n", drives.size(), violations);
  return violations;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  std::vector<gsv::FaultDrive> drives;
  gsv::CommandLine command_line("evaluate_faults",
                                "Renders drives with faults of the camera and of the scene in "
                                "random (seeded) order, runs the\n"
                                "odometry over them and prints how it reacts.",
                                kDetails);
  command_line.addPositionals(
      "NAME",
      "a fault, alone in a drive: lorry, wall, black, white, frozen, covered,\n"
      "      rain ... (a wrong name lists them all)",
      &arguments.names);
  command_line.options().add_options()  //
      ("seed", gsv::numberInRange("--seed", &arguments.seed, "N", 0, 1000000),
       "of all random choices")  //
      ("threads", gsv::numberInRange("--threads", &arguments.threads, "N", 1, 256),
       "drives rendered and run in parallel");
  return command_line.run(
      argc, argv, [&] { drives = selectDrives(arguments); },
      [&] { return run(drives, arguments.threads) > 0 ? 1 : 0; });
}
