// Renders a SyntheticDrive as a KITTI odometry folder with ground truth.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iomanip>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "simulation/scenarios.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/tools/distortion.hpp"
#include "simulation/tools/kitti_folder.hpp"
#include "tools/support/command_line.hpp"
#include "tools/support/parallel_for.hpp"

namespace fs = std::filesystem;
namespace po = boost::program_options;

namespace {

struct Settings {
  std::string folder, scenario, path;  ///< scenario and path: empty for the default drive
  gsv::SyntheticDrive::Options drive;
  /// Lens of the images minus that of calib.txt; empty: none.
  std::optional<gsv::LensVector> lens_error;
  /// Changes requested by the given options; applied to the scenario or to the defaults.
  std::vector<std::function<void()>> changes;
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  bool list = false;  ///< print the catalogue instead of rendering a drive
};

/// text: WxH. The focal lengths and cx scale with the width, cy scales with the height.
void setSize(gsv::PinholeCamera& camera, const std::string& text) {
  int width = 0, height = 0;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%5dx%5d%c", &width, &height, &rest) != 2) {
    throw gsv::OptionError("--size is '" + text + "', not WxH");
  }
  const double scale = static_cast<double>(width) / camera.width;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = (camera.cx + 0.5) * scale - 0.5;
  camera.cy = (camera.cy + 0.5) * height / camera.height - 0.5;
  camera.width = width;
  camera.height = height;
}

/// text: K1,K2,CX,CY.
gsv::LensVector parseLensError(const std::string& text) {
  constexpr double kMaxError = 20;
  gsv::LensVector error = gsv::LensVector::Zero();  // focal length, centre, k1, k2
  char rest = 0;
  const int read = std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf%c", &error[3], &error[4], &error[1],
                               &error[2], &rest);
  if (read != 4 || !(error.array().abs() < kMaxError).all()) {
    throw gsv::OptionError("--lens-error is '" + text + "', not four numbers K1,K2,CX,CY");
  }
  return error;
}

/// Adds the options that change a drive.
void addDriveOptions(Settings* settings, po::options_description* options) {
  gsv::SyntheticDrive::Options& drive = settings->drive;
  // Appends `set` with the value to the changes when the option is given.
  const auto add = [&](const char* name, auto* value, const std::string& help, const auto& set) {
    const auto change = [changes = &settings->changes, set](const auto& given) {
      changes->push_back([set, given] { set(given); });
    };
    options->add_options()(name, value->notifier(change), help.c_str());
  };
  const auto addNumber = [&](const char* name, const char* unit, const char* help, double* field) {
    std::ostringstream text;
    text << help << " (default without --scenario: " << std::setprecision(3) << *field << ")";
    add(name, po::value<double>()->value_name(unit), text.str(),
        [field](double value) { *field = value; });
  };
  add("frames", po::value<int>()->value_name("N"),
      "number of frames (default without --scenario: " + std::to_string(drive.frames) + ")",
      [&drive](int frames) { drive.frames = frames; });
  add("size", po::value<std::string>()->value_name("WxH"),
      "image size at a constant horizontal field of view (default without --scenario: " +
          std::to_string(drive.camera.width) + "x" + std::to_string(drive.camera.height) + ")",
      [&drive](const std::string& text) { setSize(drive.camera, text); });
  addNumber("camera-height", "M", "camera height above the road [m]", &drive.camera_height);
  addNumber("pitch", "RAD", "pitch of the camera mounting [rad], positive: looks down",
            &drive.pitch_rad);
  addNumber("roll", "RAD",
            "roll of the camera mounting [rad], positive: the camera's x axis points down",
            &drive.roll_rad);
  addNumber("yaw", "RAD", "yaw of the camera mounting [rad], positive: looks to the left",
            &drive.yaw_rad);
  addNumber("speed", "MPS", "cruise speed [m/s]", &drive.speed);
  addNumber("rate", "HZ", "frame rate [Hz]", &drive.frame_rate_hz);
  addNumber("curvature", "PER_M", "maximum curvature [1/m], 0: straight road", &drive.curvature);
  addNumber("slope", "RATIO", "maximum slope [m/m], 0: flat road", &drive.slope);
  addNumber("stop", "S", "duration of the standstill [s], 0: no stop", &drive.stop_s);
  addNumber("suspension", "FACTOR", "factor on suspension pitch, roll and heave",
            &drive.suspension);
}

void check(Settings* settings) {
  if (settings->list) return;
  if (settings->folder.empty()) throw gsv::OptionError("FOLDER is missing, see --help");
  if (!settings->scenario.empty()) settings->drive = gsv::findScenario(settings->scenario).options;
  if (!settings->path.empty()) {
    if (!settings->scenario.empty()) {
      throw gsv::OptionError("--path and --scenario cannot be combined");
    }
    for (const Eigen::Isometry3d& T_c0_c : gsv::readKittiPoses(settings->path)) {
      settings->drive.path.emplace_back(T_c0_c.translation());
    }
    settings->drive.frames = static_cast<int>(settings->drive.path.size());
  }
  for (const auto& change : settings->changes) change();
  settings->drive.validate();
}

int printCatalogue() {
  for (const auto& scenarios : {gsv::allScenarios(), gsv::faultScenarios()}) {
    for (const gsv::Scenario& scenario : scenarios) {
      std::printf("%-18s %s\n", scenario.name.c_str(), scenario.description.c_str());
    }
  }
  return 0;
}

gsv::SyntheticDrive makeDrive(const Settings& settings) {
  if (settings.path.empty()) return gsv::SyntheticDrive(settings.drive);
  try {
    return gsv::SyntheticDrive(settings.drive);
  } catch (const gsv::OptionError& error) {  // the other options have been validated
    throw gsv::DataError(settings.path + ": " + error.what());
  }
}

int render(const Settings& settings) {
  cv::setNumThreads(1);  // frames are rendered in parallel
  const gsv::SyntheticDrive drive = makeDrive(settings);
  gsv::KittiTables tables;
  tables.camera = drive.camera();
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const gsv::SyntheticDrive::Frame& frame = drive.frame(i);
    tables.stamps_ns.push_back(frame.stamp_ns);
    tables.T_c0_c.push_back(frame.T_c0_c);
    tables.ground.emplace_back(frame.height, frame.n_c.x(), frame.n_c.y(), frame.n_c.z());
  }
  std::optional<gsv::Distortion> distortion;
  if (settings.lens_error) {
    distortion.emplace(drive.camera(),
                       gsv::boxplus(gsv::Lens(drive.camera()), *settings.lens_error));
  }
  gsv::writeKittiFolder(settings.folder, [&](const fs::path& folder) {
    gsv::ProgressLine progress("render_drive", drive.size());
    gsv::parallelFor(drive.size(), settings.threads, [&](std::size_t i) {
      const cv::Mat image = drive.image(i);
      gsv::writeKittiImage(folder, i, distortion ? distortion->image(image) : image);
      progress.step("frames");
    });
    gsv::writeKittiTables(folder, tables);
  });
  std::printf("%zu frames in %s\n", drive.size(), settings.folder.c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  gsv::CommandLine command_line(
      "render_drive",
      "Renders a drive along a generated street or a recorded path as a KITTI odometry folder: "
      "image_0/NNNNNN.png, calib.txt,\n"
      "times.txt, exact poses (poses.txt), and the exact camera height and road normal of every "
      "frame\n"
      "(ground.txt). kitti_to_bag converts it to a bag.",
      "Exit status: 0 success, 1 runtime error, 2 invalid arguments.");
  command_line.addPositional("FOLDER", "output folder; must not exist", &settings.folder, false);
  command_line.options().add_options()                                                   //
      ("list", po::bool_switch(&settings.list), "print the scenario catalogue instead")  //
      ("scenario", po::value(&settings.scenario)->value_name("NAME"),
       "a drive of the catalogue (--list), changed by the options below")  //
      ("path", po::value(&settings.path)->value_name("FILE"),
       "KITTI poses (poses/NN.txt): a street along the recorded positions, smoothed, with one "
       "frame "
       "for each line. --frames N: only the first N; --speed, --stop, --curvature and --slope have "
       "no effect")  //
      ("lens-error",
       po::value<std::string>()->value_name("K1,K2,CX,CY")->notifier([&](const std::string& text) {
         settings.lens_error = parseLensError(text);
       }),
       "the images have this radial distortion and shift of the principal point [px], which "
       "calib.txt does not contain")  //
      ("threads", gsv::numberInRange("--threads", &settings.threads, "N", 1, 256),
       "number of rendering threads");
  addDriveOptions(&settings, &command_line.options());
  return command_line.run(
      argc, argv, [&] { check(&settings); },
      [&] { return settings.list ? printCatalogue() : render(settings); });
}
