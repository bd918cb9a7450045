// Runs the offline pipeline over one drive and writes its result files.

#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "common/files.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/speed_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "support/drive_arguments.hpp"

namespace {

struct Arguments : gsv::DriveArguments {
  bool only_check = false, strict = false, smooth = false;
  std::vector<std::size_t> images;
};

/// The images with these numbers, as DIR/NUMBER.png.
int writeImages(const Arguments& arguments) {
  const auto images = gsv::openDrive(arguments.drive)->imagesAt(arguments.images);
  gsv::makeFolder(arguments.out);
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (images[i].empty()) continue;
    gsv::writeFile(
        std::filesystem::path(arguments.out) / (std::to_string(arguments.images[i]) + ".png"),
        gsv::encodePng(images[i]));
  }
  return 0;
}

int run(const Arguments& arguments) {
  cv::setNumThreads(1);
  gsv::GroundTruth truth;
  std::vector<gsv::SpeedSample> speeds;
  if (!arguments.speed_file.empty()) {
    speeds = gsv::readSpeeds(arguments.speed_file, arguments.speed_unit,
                             arguments.options.scale.camera_height > 0);
  }
  const auto drive = gsv::openDrive(arguments.drive, &truth);
  const std::string name = gsv::resultName(arguments.drive.path);
  const auto folder = std::filesystem::path(arguments.out) / name;
  gsv::makeFolder(folder);  // fails before the run, not after it
  if (std::filesystem::equivalent(folder, arguments.drive.path)) {
    throw gsv::OptionError("--out " + arguments.out +
                           " would write the results over the sequence and its poses.txt");
  }
  gsv::DriveRun::Options options{arguments.options,      arguments.settings, speeds,
                                 arguments.speed_offset, arguments.smooth,   {}};
  if (arguments.smooth) {
    const auto images = [&, pass = 0](const gsv::ImageVisitor& visit) mutable {
      const auto again = gsv::openDrive(arguments.drive);
      gsv::ProgressLine progress(name + ", lens " + std::to_string(++pass), again->count());
      while (const auto image = again->nextOfCamera()) {
        visit(image->grey, image->stamp_ns);
        progress.step(" images");
      }
    };
    options.lens = gsv::lensOfDrive(images, *drive, options);
  }
  gsv::DriveRun result;
  {
    gsv::RunProgress progress(name, drive->count());
    result = gsv::runDrive(drive.get(), options,
                           [&](const gsv::RunFrame& frame) { progress.show(frame); });
  }
  gsv::writeRun(folder, result, arguments.options.scale.camera_height, truth);
  for (const std::string& sentence : result.warnings) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), sentence.c_str());
  }
  std::printf("%s: %s; written to %s\n", name.c_str(), result.summary().c_str(), folder.c_str());
  std::fflush(stdout);  // the failure is the last line
  if (!result.failure.empty()) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), result.failure.c_str());
  }
  return result.exitStatus(arguments.strict);
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "run_sequence",
      "Metric odometry of a drive without ROS: every image, deterministic. Without --smooth a "
      "pose never uses later images, except that the frames before the first scale get that scale.",
      "Exit status: 0 done, 1 the data cannot be used or only in part (the reason is printed), 2 "
      "the "
      "arguments cannot be used.");
  arguments.addTo(
      &command_line,
      "results go to DIR/<name of SEQ>/: poses.txt, poses_unscaled.txt, "
      "trajectory_tum.txt, scale.csv, timing.csv, metrics.json, run.json, ground_truth.txt");
  command_line.options().add_options()  //
      ("speed", gsv::po::value(&arguments.speed_file)->value_name("FILE"),
       "speeds of the vehicle: CSV with the columns stamp and speed_mps, speed_kmh, speed_mph, "
       "speed_knots or speed_mmps, optionally sigma, or the folder oxts/ of a KITTI raw drive")  //
      ("speed-unit", gsv::po::value(&arguments.speed_unit)->value_name("UNIT"),
       "of a column speed: mps, kmh, mph, knots or mmps (required without --camera-height)")  //
      ("speed-offset", gsv::po::value(&arguments.speed_offset)->value_name("S"),
       "added to the stamps of the speeds [s], when they are of another clock")  //
      ("refine-camera",
       "the default: estimates the lens while driving and undistorts the images by it; the result "
       "goes to camera.yaml. --set refine_camera=false: the calibration is exact")  //
      ("smooth", gsv::po::bool_switch(&arguments.smooth),
       "the best trajectory after the drive: the lens is estimated from all images first, and each "
       "scale from all measurements of its map, also later ones")  //
      ("strict", gsv::po::bool_switch(&arguments.strict),
       "exit status 1 also after a warning")  //
      ("images", gsv::po::value(&arguments.images)->multitoken()->value_name("N..."),
       "only writes the images with these ascending numbers, from 0, to DIR/N.png")  //
      ("check", gsv::po::bool_switch(&arguments.only_check),
       "only checks the arguments; reads and writes nothing");
  return command_line.run(
      argc, argv, [&] { arguments.check(); },
      [&] {
        if (arguments.only_check) return 0;
        return arguments.images.empty() ? run(arguments) : writeImages(arguments);
      });
}
