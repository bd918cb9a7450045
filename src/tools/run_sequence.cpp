// Runs the offline pipeline over one KITTI folder and writes its result files.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/image_file.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "support/camera_argument.hpp"
#include "support/command_line.hpp"
#include "support/run_progress.hpp"
#include "support/sequence_arguments.hpp"

namespace gsv = ground_scale_vo;

namespace {

struct Arguments : gsv::SequenceArguments {
  int opencv_threads = 1;
  bool only_check = false;
  std::string mask, camera;
};

/// The mask of --mask FILE; empty without it. Throws DataError or OptionError.
cv::Mat readMask(const std::string& file, const gsv::PinholeCamera& camera) {
  if (file.empty()) return {};
  const cv::Mat mask = gsv::readGreyImage(file);
  gsv::requireMask(mask, camera, "--mask " + file);
  return mask;
}

void run(Arguments arguments) {
  cv::setNumThreads(arguments.opencv_threads);
  const gsv::KittiSequence sequence(arguments.sequence);
  const auto folder = std::filesystem::path(arguments.out) / sequence.name();
  gsv::makeFolder(folder);  // fails before the run, not after it
  if (std::filesystem::equivalent(folder, arguments.sequence)) {
    throw gsv::OptionError("--out " + arguments.out +
                           " would write the results over the sequence and its poses.txt");
  }
  const gsv::CameraCalibration camera = gsv::cameraFrom(arguments.camera, sequence.camera());
  arguments.options.odometry.vo.readout_time = camera.readout_time;
  arguments.check();  // again: --set takes precedence
  const gsv::Lens lens = gsv::lensOf(camera);
  gsv::OfflineRun run(lens, arguments.options, readMask(arguments.mask, lens.camera));
  gsv::RunProgress progress(sequence.name(), sequence.size());
  gsv::ImageReader reader(sequence.size(), [&](std::size_t i) { return sequence.image(i); });
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const gsv::ImageReader::Image image = reader.next();
    progress.show(run.process(image.image, sequence.stampNs(i), image.decode_ms));
  }
  gsv::writeRun(folder, run.record(), arguments.options.scale.camera_height, sequence.groundTruth(),
                sequence.groundTruthHeights());
  if (run.lens().isEstimate()) {
    gsv::CameraCalibration refined = gsv::calibrationOf(run.lens().lens);
    gsv::writeFile(folder / "camera.yaml",
                   gsv::cameraYaml(refined, "Refined by run_sequence --refine-camera."));
  }
  const auto& frames = run.record().frames();
  if (std::none_of(frames.begin(), frames.end(),
                   [](const gsv::RunFrame& frame) { return frame.has_metric_pose; })) {
    std::fprintf(stderr, "%s: no frame got a scale, so the metric trajectory does not move\n",
                 sequence.name().c_str());
  }
  std::printf("%s: %zu frames, %zu tracked, %.1f m, written to %s\n", sequence.name().c_str(),
              sequence.size(), run.record().trackedFrames(),
              gsv::pathLength(run.record().metricPoses()), folder.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "run_sequence",
      "Metric odometry of one KITTI folder without ROS: every frame, deterministic. A pose never "
      "uses later images, except that the frames before the first scale get that scale.",
      "Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.");
  arguments.addTo(&command_line,
                  "results go to DIR/<name of SEQ>/: poses.txt, poses_unscaled.txt, "
                  "trajectory_tum.txt, scale.csv, timing.csv, metrics.json, ground_truth.txt");
  command_line.options().add_options()  //
      ("mask", gsv::optionalValue(&arguments.mask, "FILE"),
       "image of the size of those in SEQ, black where they never show the scene (own vehicle, "
       "watermark); these regions are not used")  //
      ("camera", gsv::optionalValue(&arguments.camera, "FILE"),
       gsv::kCameraHelp)  //
      ("refine-camera", gsv::po::bool_switch(&arguments.options.odometry.refine_camera),
       "estimates the lens while driving and undistorts the images by it; the result goes to "
       "camera.yaml")  //
      ("opencv-threads",
       gsv::numberInRange("--opencv-threads", &arguments.opencv_threads, "N", 1, 256),
       "threads inside OpenCV; the published figures are those with 1")  //
      ("check", gsv::po::bool_switch(&arguments.only_check),
       "only checks the arguments; reads and writes nothing");
  return command_line.run(
      argc, argv, [&] { arguments.check(); },
      [&] {
        if (!arguments.only_check) run(arguments);
        return 0;
      });
}
