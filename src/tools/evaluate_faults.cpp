// Renders drives with faults injected at random, runs the pipeline over each and tables how it took
// them.

#include <cstdio>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "for_all.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/simulation/fault_drives.hpp"
#include "progress_line.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: evaluate_faults [NAME...] [options]

Renders drives into which faults of the camera and of the scene are put at random (seeded), runs the
odometry over them and tables how it took them.

  NAME          a fault, alone in a drive: lorry, wall, black, white, frozen, covered, rain ...
                (a wrong name lists them all); default: the ten drives with two faults each
  --seed N      of all that is drawn (default 20)
  --threads N   drives at once (default 1)

A line for each fault and each stretch without one. said: seconds until HELD or LOST; ok: frames
more than 3 s later that are said to be measured; tracking, metric: frames after it until there is
a pose, and a scale, again; invented: metric way beyond the true one; missed and sigma: what the
position is wrong by after it, and what its standard deviation has grown by. A stretch begins 3 s
and 20 m after a fault; error: of the relative pose over it, as a share of its length.

Exit status: 0 every bar is kept, 1 one is broken, 2 the arguments cannot be used.
)";

struct Arguments {
  std::vector<gsv::FaultDrive> drives;
  int threads = 1;
};

Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  std::vector<std::string> names;
  std::uint64_t seed = 20;
  for (int i = 1; i < argc; ++i) {
    const std::string given = argv[i];
    if (given == "--threads" || given == "--seed") {
      if (++i == argc) throw gsv::OptionError(given + " needs a value");
      const bool threads = given == "--threads";
      const int number = gsv::parseWholeNumber(given, argv[i], threads, threads ? 256 : 1000000);
      if (threads) {
        arguments.threads = number;
      } else {
        seed = static_cast<std::uint64_t>(number);
      }
    } else if (given.size() > 1 && given.front() == '-') {
      throw gsv::OptionError(given + " is not an option, see --help");
    } else {
      names.push_back(given);
    }
  }
  for (const std::string& name : names) {
    arguments.drives.push_back(gsv::faultDrive(name, seed));
  }
  for (std::size_t i = 0; names.empty() && i < gsv::kFaultDrives; ++i) {
    arguments.drives.push_back(gsv::faultDrive(i, seed));
  }
  return arguments;
}

void print(const gsv::FaultDrive& drive, const gsv::FaultRunFigures& figures) {
  const gsv::SyntheticDrive::Options& o = drive.options;
  std::printf(
      "%s: %zu frames at %.0f Hz, %dx%d, camera %.2f m high, %.1f m/s; %zu tracked, %zu not "
      "finite\n",
      drive.name.c_str(), figures.frames, o.frame_rate_hz, o.camera.width, o.camera.height,
      o.camera_height, o.speed, figures.tracked_frames, figures.non_finite_frames);
  for (const gsv::StretchFigures& s : figures.stretches) {
    std::printf("  frames %3zu to %3zu: %5.1f m, error %.2f %%\n", s.first, s.last, s.true_m,
                s.error_percent);
  }
  for (std::size_t i = 0; i < figures.faults.size(); ++i) {
    const gsv::FaultFigures& f = figures.faults[i];
    std::printf(
        "  frames %3zu to %3zu: %-13s %4.1f s%s: said %.1f s, ok %zu, tracking %d, metric "
        "%d, invented %.2f m, missed %.1f m, sigma %.1f m\n",
        drive.faults[i].first, drive.faults[i].last, f.what.c_str(), f.duration_s,
        f.hides ? ", hides" : "", f.said_after_s, f.ok_frames, f.tracking_after, f.metric_after,
        f.invented_m, f.missed_m, f.sigma_m);
  }
  const std::string broken = gsv::violatedThreshold(figures);
  if (!broken.empty()) std::printf("  BROKEN: %s\n", broken.c_str());
}

int broken_drives = 0;

void run(const Arguments& arguments) {
  cv::setNumThreads(1);
  std::size_t frames = 0;
  for (const gsv::FaultDrive& drive : arguments.drives) {
    frames += static_cast<std::size_t>(drive.options.frames);
  }
  gsv::ProgressLine progress("evaluate_faults", frames);
  gsv::forAll(arguments.drives.size(), arguments.threads, [&](std::size_t i) {
    const gsv::FaultRunFigures figures = gsv::runFaultDrive(
        arguments.drives[i],
        [&](std::size_t, const cv::Mat&, const gsv::OfflineRun&) { progress.step("frames"); });
    progress.pause([&] {
      print(arguments.drives[i], figures);
      broken_drives += !gsv::violatedThreshold(figures).empty();
    });
  });
  std::printf("%zu drives, %d with a broken bar\n", arguments.drives.size(), broken_drives);
}

}  // namespace

int main(int argc, char** argv) {
  const int status = gsv::toolMain("evaluate_faults", kUsage, argc, argv, parseArguments, run);
  return status == 0 && broken_drives > 0 ? 1 : status;
}
