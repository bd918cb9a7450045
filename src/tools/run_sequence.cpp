// The offline pipeline over one KITTI folder: parses arguments, drives OfflineRun, writes its
// files.

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/dataset/kitti_sequence.hpp"
#include "ground_scale_vo/dataset/odometry_metrics.hpp"
#include "ground_scale_vo/dataset/offline_run.hpp"
#include "ground_scale_vo/dataset/run_report.hpp"
#include "ground_scale_vo/dataset/set_option.hpp"
#include "ground_scale_vo/dataset/text_file.hpp"
#include "ground_scale_vo/error.hpp"
#include "ground_scale_vo/parse_number.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: run_sequence SEQ --camera-height M --out DIR [options]

Metric odometry of one KITTI folder without ROS: every frame, causal, deterministic.

  SEQ                   KITTI odometry folder (image_0/, calib.txt, times.txt, and ground truth
                        poses.txt or ../../poses/NN.txt, and ground.txt as of render_drive) or
                        KITTI raw synced drive (image_00/data/, ../calib_cam_to_cam.txt, and ground
                        truth from oxts/)
  --camera-height M     height of the camera above the road [m]; required
  --out DIR             results go to DIR/<name of SEQ>/: poses.txt, poses_unscaled.txt,
                        trajectory_tum.txt, scale.csv, timing.csv, metrics.json, ground_truth.txt
  --set GROUP/NAME=VALUE
                        an option other than its default, by the name of its parameter
                        (docs/parameters.md); as often as needed
  --opencv-threads N    threads inside OpenCV (default 1: deterministic, and times are CPU times)

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.
)";

struct Arguments {
  std::string sequence, out;
  int opencv_threads = 1;
  gsv::OfflineRun::Options options;
};

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  bool has_height = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] {
      if (++i == argc) throw gsv::OptionError(argument + " needs a value");
      return std::string(argv[i]);
    };
    if (argument == "--camera-height") {
      arguments.options.scale.camera_height = gsv::parseNumber(argument, value());
      has_height = true;
    } else if (argument == "--out") {
      arguments.out = value();
    } else if (argument == "--opencv-threads") {
      arguments.opencv_threads = gsv::parseWholeNumber(argument, value(), 1, 256);
    } else if (argument == "--set") {
      gsv::setOption(arguments.options, value());
    } else if (argument.size() > 1 && argument.front() == '-') {
      throw gsv::OptionError(argument + " is not an option, see --help");
    } else if (!arguments.sequence.empty()) {
      throw gsv::OptionError("one sequence at a time, not " + arguments.sequence + " and " +
                             argument);
    } else {
      arguments.sequence = argument;
    }
  }
  if (arguments.sequence.empty()) throw gsv::OptionError("SEQ is missing, see --help");
  if (!has_height) throw gsv::OptionError("--camera-height is missing, there is no default");
  if (arguments.out.empty()) throw gsv::OptionError("--out is missing, see --help");
  arguments.options.validate();
  return arguments;
}

/// One line on a terminal, written again some times a second.
class Progress {
 public:
  Progress(const std::string& name, std::size_t frames) : name_(name), frames_(frames) {}
  ~Progress() {
    if (is_terminal_) std::fputc('\n', stderr);
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(std::size_t done, double metres, gsv::ScaleStatus status) {
    if (!is_terminal_) return;
    const auto now = Clock::now();
    if (now - shown_ < std::chrono::milliseconds(200) && done != frames_) return;
    shown_ = now;
    const double seconds = std::chrono::duration<double>(now - start_).count();
    std::fprintf(stderr, "\r%s: frame %zu/%zu, %.1f frames/s, %.1f m, scale %s \033[K",
                 name_.c_str(), done, frames_, static_cast<double>(done) / seconds, metres,
                 gsv::toString(status));
  }

 private:
  using Clock = std::chrono::steady_clock;
  const std::string name_;
  const std::size_t frames_;
  const bool is_terminal_ = isatty(STDERR_FILENO) != 0;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_{};
};

void run(const Arguments& arguments) {
  cv::setNumThreads(arguments.opencv_threads);
  const gsv::KittiSequence sequence(arguments.sequence);
  const auto folder = std::filesystem::path(arguments.out) / sequence.name();
  gsv::makeFolder(folder);  // fails now rather than after the run
  if (std::filesystem::equivalent(folder, arguments.sequence)) {
    throw gsv::OptionError("--out " + arguments.out +
                           " would put the results over the sequence, its poses.txt included");
  }
  gsv::OfflineRun run(sequence.camera(), arguments.options);
  Progress progress(sequence.name(), sequence.size());
  double metres = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const gsv::RunFrame& frame = run.process(sequence.image(i), sequence.stampNs(i));
    metres += (frame.T_o_c.translation() - position).norm();
    position = frame.T_o_c.translation();
    progress.show(i + 1, metres, frame.scale.status);
  }
  gsv::writeRun(folder, run.record(), arguments.options.scale.camera_height, sequence.groundTruth(),
                sequence.trueHeights());
  const auto& frames = run.record().frames();
  if (std::none_of(frames.begin(), frames.end(),
                   [](const gsv::RunFrame& frame) { return frame.has_metric_pose; })) {
    std::fprintf(stderr, "%s: no frame got a scale, so the metric trajectory stands still\n",
                 sequence.name().c_str());
  }
  std::printf("%s: %zu frames, %zu tracked, %.1f m, written to %s\n", sequence.name().c_str(),
              sequence.size(), run.record().trackedFrames(),
              gsv::pathLength(run.record().metricPoses()), folder.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("run_sequence", kUsage, argc, argv, parseArguments, run);
}
