// The offline pipeline over one KITTI folder: parses arguments, drives OfflineRun, writes its
// files.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "run_progress.hpp"
#include "sequence_arguments.hpp"
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

struct Arguments : gsv::SequenceArguments {
  int opencv_threads = 1;
};

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  arguments.parse(argc, argv, [&](const std::string& argument, const Arguments::Value& value) {
    if (argument != "--opencv-threads") return false;
    arguments.opencv_threads = gsv::parseWholeNumber(argument, value(), 1, 256);
    return true;
  });
  return arguments;
}

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
  gsv::RunProgress progress(sequence.name(), sequence.size());
  gsv::ImageReader reader(sequence.size(), [&](std::size_t i) { return sequence.image(i); });
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const gsv::ImageReader::Image image = reader.next();
    progress.show(run.process(image.image, sequence.stampNs(i), image.decode_ms));
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
