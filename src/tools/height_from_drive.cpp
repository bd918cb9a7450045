// Calibrates the camera's height and mounting from a drive of known length: a KITTI folder or a
// bag.

#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/calibration/height_calibration.hpp"
#include "ground_scale_vo/calibration/height_report.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/evaluation/run_progress.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"
#include "ground_scale_vo/ros_tools/bag_source.hpp"
#include "support/command_line.hpp"
#include "support/drive_arguments.hpp"
#include "support/sequence_arguments.hpp"

namespace gsv = ground_scale_vo;
namespace fs = std::filesystem;
namespace po = boost::program_options;

namespace {

/// The camera height [m] with which the odometry runs. Its value does not matter: the scale is
/// proportional to it.
constexpr double kNominalHeight = 1;

constexpr double kMaxLength = 1e7;  // [m]
constexpr double kMaxTime = 1e9;    // [s]

struct Arguments {
  std::string trajectory, out, gps;
  gsv::DriveInput drive;  ///< or bag
  gsv::BagInput bag;
  std::optional<double> length, length_sigma;
  bool force = false;
  gsv::DriveRun::Options run;
};

gsv::DriveRun runDrive(const Arguments& arguments) {
  const bool is_bag = !arguments.bag.bag.empty();
  const auto drive = is_bag ? gsv::openBag(arguments.bag) : gsv::openDrive(arguments.drive);
  const std::string name = gsv::resultName(is_bag ? arguments.bag.bag : arguments.drive.path);
  gsv::DriveRun run;
  {
    gsv::RunProgress progress(name, drive->count());
    run = gsv::runDrive(drive.get(), arguments.run,
                        [&](const gsv::RunFrame& frame) { progress.show(frame); });
  }
  if (run.record.frames().empty()) {
    throw gsv::DataError(drive->name() + " has no image between --from and --to");
  }
  // A failure is printed by CommandLine.
  const std::string failure = std::exchange(run.failure, "");
  gsv::report(name, run, "", false);
  if (!failure.empty()) throw gsv::DataError(failure);
  return run;
}

void checkFiles(const Arguments& arguments) {
  gsv::requireNewFile(arguments.out, arguments.force);
  if (!arguments.trajectory.empty() && !fs::is_regular_file(arguments.trajectory)) {
    throw gsv::DataError(arguments.trajectory + ": no such file");
  }
}

void run(const Arguments& arguments) {
  checkFiles(arguments);
  cv::setNumThreads(1);
  const gsv::DriveRun drive = runDrive(arguments);
  const gsv::HeightCalibration calibration({});
  gsv::HeightCalibration::Result result;
  std::string source;
  if (arguments.length) {
    result = calibration.fromLength(drive.record, kNominalHeight, *arguments.length,
                                    *arguments.length_sigma);
    char text[128];
    std::snprintf(text, sizeof text, "From a drive of %g m, known to %g m.", *arguments.length,
                  *arguments.length_sigma);
    source = text;
  } else if (!arguments.gps.empty()) {
    const gsv::BagFixes fixes = gsv::readFixes(arguments.bag.bag, arguments.gps);
    result = calibration.fromPositions(drive.record, kNominalHeight, fixes.fixes, fixes.sigma);
    source = "From the fixes on " + arguments.gps + ".";
  } else {
    result = calibration.fromPositions(
        drive.record, kNominalHeight,
        gsv::readStampedPositions(arguments.trajectory, drive.stamps_ns), 0);
    source = "From the trajectory " + arguments.trajectory + ".";
  }
  std::fputs(gsv::segmentTable(result).c_str(), stdout);
  if (result.status != gsv::HeightCalibration::Status::kOk) throw gsv::DataError(result.reason);
  const std::string text = gsv::heightYaml(result, source);
  gsv::writeFile(arguments.out, text);
  std::printf("%swritten to %s\n", text.c_str(), arguments.out.c_str());
}

void check(Arguments* arguments) {
  gsv::BagInput& bag = arguments->bag;
  if (arguments->drive.path.empty() == bag.bag.empty()) {
    throw gsv::OptionError("one drive is needed: SEQ or --bag FILE, see --help");
  }
  const bool has_length = arguments->length.has_value();
  if (has_length + !arguments->gps.empty() + !arguments->trajectory.empty() != 1) {
    throw gsv::OptionError("one of --length, --gps and --trajectory is needed, see --help");
  }
  if (has_length != arguments->length_sigma.has_value()) {
    throw gsv::OptionError("--length and --length-sigma go together, see --help");
  }
  if (!arguments->gps.empty() && bag.bag.empty()) {
    throw gsv::OptionError("--gps needs --bag: a KITTI folder has no fixes");
  }
  if (arguments->run.to_s <= arguments->run.from_s)
    throw gsv::OptionError("--to must be greater than --from");
  bag.camera_file = arguments->drive.camera_file;
  bag.options = arguments->drive.options;
  arguments->run.odometry.scale.camera_height = kNominalHeight;
  gsv::MetricOdometry::Options options = arguments->run.odometry;
  for (const std::string& setting : arguments->run.settings) gsv::setOption(options, setting);
  options.validate();
}

/// A number in [min, max]; without the option *target stays empty.
po::typed_value<double>* numberOrNone(const char* option, std::optional<double>* target, double min,
                                      double max) {
  return po::value<double>()->value_name("M")->notifier([=](double value) {
    gsv::requireInRange(option, value, min, max);
    *target = value;
  });
}

void addOptions(Arguments* arguments, po::options_description* options) {
  gsv::BagInput& bag = arguments->bag;
  bag.image = "/camera/image_raw";
  gsv::addDriveOptions(&arguments->drive, options);
  options->add_options()                                                                     //
      ("bag", po::value(&bag.bag)->value_name("FILE"), "the drive is a bag instead of SEQ")  //
      ("image", gsv::topicValue(&bag.image)->default_value(bag.image),
       "images of the bag; TOPIC/compressed where it has only that")  //
      ("camera-info", gsv::topicValue(&bag.camera_info),
       "their calibration (default: camera_info beside the images)")  //
      ("rectified", po::bool_switch(&bag.rectified),
       "the images have no distortion, and P of camera_info belongs to them")  //
      ("from", gsv::numberInRange("--from", &arguments->run.from_s, "S", 0, kMaxTime),
       "only images from this time after the first one on [s]")  //
      ("to", gsv::numberInRange("--to", &arguments->run.to_s, "S", 0, kMaxTime),
       "only images up to this time after the first one [s]")  //
      ("length", numberOrNone("--length", &arguments->length, 1, kMaxLength),
       "odometer reading between the first image and the last [m], and")  //
      ("length-sigma", numberOrNone("--length-sigma", &arguments->length_sigma, 0, kMaxLength),
       "its standard deviation [m]")  //
      ("gps", gsv::topicValue(&arguments->gps),
       "fixes in the bag (sensor_msgs/NavSatFix)")  //
      ("trajectory", po::value(&arguments->trajectory)->value_name("FILE"),
       "positions of a point fixed to the vehicle, in any frame: TUM (stamp x y z qx qy qz qw), or "
       "KITTI poses, a line for each image")  //
      ("out", gsv::requiredValue(&arguments->out, "FILE"),
       "YAML, for height_file:= of the launch files")                               //
      ("force", po::bool_switch(&arguments->force), "replace FILE when it exists")  //
      ("set", gsv::settingsValue(&arguments->run.settings), gsv::kSettingsHelp);
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "height_from_drive",
      "Runs the odometry over a drive (SEQ or --bag) of known length (--length with "
      "--length-sigma,\n"
      "--gps, or --trajectory) and prints the camera's height above the road and its mounting "
      "with\n"
      "their standard deviations. Needs no ROS master.",
      "Exit status: 0 done, 1 the data cannot be used or leave the height too uncertain, 2 the\n"
      "arguments cannot be used. FILE is written only with status 0.");
  command_line.addPositional("SEQ", "KITTI folder, folder of images with times.txt, or video",
                             &arguments.drive.path, false);
  addOptions(&arguments, &command_line.options());
  return command_line.run(
      argc, argv, [&] { check(&arguments); },
      [&] {
        run(arguments);
        return 0;
      });
}
