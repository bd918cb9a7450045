// Calibrates the camera's height and mounting from a drive of known length: a KITTI folder or a
// bag.

#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/calibration/height_calibration.hpp"
#include "ground_scale_vo/calibration/height_report.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/ros_tools/bag_drive.hpp"
#include "support/camera_argument.hpp"
#include "support/command_line.hpp"
#include "support/run_progress.hpp"
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
  std::string sequence, trajectory, out;
  gsv::BagDrive::Source bag;
  std::optional<double> length, length_sigma;
  bool force = false;
  gsv::OfflineRun::Options options;
  std::vector<std::string> settings;
};

/// Runs the pipeline over the chosen part of a KITTI folder; the result has no fixes.
gsv::BagDrive runSequence(const Arguments& arguments) {
  const gsv::KittiSequence sequence(arguments.sequence);
  std::vector<std::size_t> chosen;  // images between --from and --to
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const double s = gsv::secondsBetween(sequence.stampNs(0), sequence.stampNs(i));
    if (s >= arguments.bag.from_s && s <= arguments.bag.to_s) chosen.push_back(i);
  }
  if (chosen.empty()) {
    throw gsv::DataError(arguments.sequence + " has no image between --from and --to");
  }
  gsv::BagDrive drive;
  // A trajectory without stamps has a line for every image of the folder.
  for (std::size_t i = 0; i < sequence.size(); ++i) drive.stamps_ns.push_back(sequence.stampNs(i));
  const gsv::CameraCalibration camera =
      gsv::cameraFrom(arguments.bag.camera_file, sequence.camera());
  gsv::OfflineRun run(gsv::lensOf(camera), arguments.options);
  gsv::RunProgress progress(sequence.name(), chosen.size());
  gsv::ImageReader reader(chosen.size(), [&](std::size_t i) { return sequence.image(chosen[i]); });
  for (const std::size_t i : chosen) {
    progress.show(run.process(reader.next().image, sequence.stampNs(i)));
  }
  drive.record = run.record();
  return drive;
}

gsv::BagDrive runBag(const Arguments& arguments) {
  const std::string name = fs::path(arguments.bag.bag).stem();
  std::optional<gsv::RunProgress> progress;
  gsv::BagDrive drive = gsv::runBagDrive(arguments.bag, arguments.options,
                                         [&](const gsv::RunFrame& frame, std::size_t images) {
                                           if (!progress) progress.emplace(name, images);
                                           progress->show(frame);
                                         });
  progress.reset();
  if (!drive.rectification_warning.empty()) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), drive.rectification_warning.c_str());
  }
  if (drive.rejected_images > 0) {
    std::fprintf(stderr, "%s: %zu images were rejected, the first one because %s\n", name.c_str(),
                 drive.rejected_images, drive.first_rejection.c_str());
  }
  return drive;
}

void checkFiles(const Arguments& arguments) {
  gsv::requireNewFile(arguments.out, arguments.force);
  if (!arguments.trajectory.empty() && !fs::is_regular_file(arguments.trajectory)) {
    throw gsv::DataError(arguments.trajectory + ": no such file");
  }
}

void applySettings(Arguments* arguments) {
  for (const std::string& setting : arguments->settings) {
    gsv::setOption(arguments->options, setting);
  }
  arguments->options.validate();
}

void run(Arguments arguments) {
  checkFiles(arguments);
  if (const std::string& file = arguments.bag.camera_file; !file.empty()) {
    arguments.options.odometry.vo.readout_time = gsv::readCameraFile(file).readout_time;
    applySettings(&arguments);  // again: --set takes precedence
  }
  cv::setNumThreads(1);
  const gsv::BagDrive drive =
      arguments.bag.bag.empty() ? runSequence(arguments) : runBag(arguments);
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
  } else if (!arguments.bag.gps.empty()) {
    result = calibration.fromPositions(drive.record, kNominalHeight, drive.fixes, drive.fix_sigma);
    source = "From the fixes on " + arguments.bag.gps + ".";
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
  gsv::BagDrive::Source& bag = arguments->bag;
  if (arguments->sequence.empty() == bag.bag.empty()) {
    throw gsv::OptionError("one drive is needed: SEQ or --bag FILE, see --help");
  }
  const bool has_length = arguments->length.has_value();
  if (has_length + !bag.gps.empty() + !arguments->trajectory.empty() != 1) {
    throw gsv::OptionError("one of --length, --gps and --trajectory is needed, see --help");
  }
  if (has_length != arguments->length_sigma.has_value()) {
    throw gsv::OptionError("--length and --length-sigma go together, see --help");
  }
  if (!bag.gps.empty() && bag.bag.empty()) {
    throw gsv::OptionError("--gps needs --bag: a KITTI folder has no fixes");
  }
  if (bag.to_s <= bag.from_s) throw gsv::OptionError("--to must be greater than --from");
  if (bag.camera_info.empty()) {
    fs::path image = bag.image;  // a topic, .../image_raw or .../image_raw/compressed
    if (image.filename() == "compressed") image = image.parent_path();
    bag.camera_info = image.replace_filename("camera_info").string();
  }
  arguments->options.scale.camera_height = kNominalHeight;
  applySettings(arguments);
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
  gsv::BagDrive::Source& bag = arguments->bag;
  bag.image = "/camera/image_raw";
  options->add_options()                                                                     //
      ("bag", po::value(&bag.bag)->value_name("FILE"), "the drive is a bag instead of SEQ")  //
      ("image", gsv::topicValue(&bag.image)->default_value(bag.image),
       "images of the bag; TOPIC/compressed where it has only that")  //
      ("camera-info", gsv::topicValue(&bag.camera_info),
       "their calibration (default: camera_info beside the images)")  //
      ("camera", po::value(&bag.camera_file)->value_name("FILE"),
       gsv::kCameraHelp)  //
      ("rectified", po::bool_switch(&bag.rectified),
       "the images have no distortion, and P of camera_info belongs to them")  //
      ("from", gsv::numberInRange("--from", &bag.from_s, "S", 0, kMaxTime),
       "only images from this time after the first one on [s]")  //
      ("to", gsv::numberInRange("--to", &bag.to_s, "S", 0, kMaxTime),
       "only images up to this time after the first one [s]")  //
      ("length", numberOrNone("--length", &arguments->length, 1, kMaxLength),
       "odometer reading between the first image and the last [m], and")  //
      ("length-sigma", numberOrNone("--length-sigma", &arguments->length_sigma, 0, kMaxLength),
       "its standard deviation [m]")  //
      ("gps", gsv::topicValue(&bag.gps),
       "fixes in the bag (sensor_msgs/NavSatFix)")  //
      ("trajectory", po::value(&arguments->trajectory)->value_name("FILE"),
       "positions of a point fixed to the vehicle, in any frame: TUM (stamp x y z qx qy qz qw), or "
       "KITTI poses, a line for each image")  //
      ("out", gsv::requiredValue(&arguments->out, "FILE"),
       "YAML, for height_file:= of the launch files")                               //
      ("force", po::bool_switch(&arguments->force), "replace FILE when it exists")  //
      ("set", gsv::settingsValue(&arguments->settings), gsv::kSettingsHelp);
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
  command_line.addPositional("SEQ", "KITTI odometry folder or KITTI raw synced drive",
                             &arguments.sequence, false);
  addOptions(&arguments, &command_line.options());
  return command_line.run(
      argc, argv, [&] { check(&arguments); },
      [&] {
        run(arguments);
        return 0;
      });
}
