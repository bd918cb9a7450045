// Renders drives with faults in random order and of random duration and evaluates the pipeline on
// each.

#include <cstdint>
#include <cstdio>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/simulation/fault_drives.hpp"
#include "ground_scale_vo/simulation/fault_evaluation.hpp"
#include "support/command_line.hpp"
#include "support/fault_tables.hpp"
#include "support/parallel_for.hpp"

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

/// Returns the exit status.
int run(const std::vector<gsv::FaultDrive>& drives, int threads) {
  cv::setNumThreads(1);
  std::size_t frames = 0;
  for (const gsv::FaultDrive& drive : drives) {
    frames += static_cast<std::size_t>(drive.options.frames);
  }
  std::vector<gsv::FaultDriveMetrics> metrics(drives.size());
  std::vector<std::string> texts(drives.size());
  std::size_t printed = 0;
  gsv::ProgressLine progress("evaluate_faults", frames);
  gsv::parallelFor(drives.size(), threads, [&](std::size_t i) {
    metrics[i] = gsv::runFaultDrive(
        drives[i],
        [&](std::size_t, const cv::Mat&, const gsv::OfflineRun&) { progress.step("frames"); });
    progress.pause([&] {
      texts[i] = gsv::faultDriveText(drives[i], metrics[i]);
      // In the order of the drives, also when a later one ends first.
      for (; printed < texts.size() && !texts[printed].empty(); ++printed) {
        std::fputs(texts[printed].c_str(), stdout);
      }
    });
  });
  const gsv::FaultSummary summary = gsv::summarise(metrics);
  std::fputs(summary.text.c_str(), stdout);
  return summary.exit_status;
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
      argc, argv,
      [&] {
        drives =
            gsv::selectFaultDrives(arguments.names, static_cast<std::uint64_t>(arguments.seed));
      },
      [&] { return run(drives, arguments.threads); });
}
