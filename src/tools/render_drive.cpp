// Renders a SyntheticDrive as a KITTI odometry folder with ground truth.

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iomanip>
#include <locale>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/files.hpp"
#include "ground_scale_vo/common/text.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/simulation/scenarios.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "support/command_line.hpp"
#include "support/parallel_for.hpp"

namespace gsv = ground_scale_vo;
namespace fs = std::filesystem;
namespace po = boost::program_options;

namespace {

constexpr int kMaxInteger = 1000000;

struct Settings {
  std::string folder, scenario, path;  ///< scenario and path: empty for the default drive
  gsv::SyntheticDrive::Options drive;
  /// Changes requested by the given options; applied to the scenario or to the defaults.
  std::vector<std::function<void()>> changes;
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  bool list = false;  ///< print the catalogue instead of rendering a drive
};

/// text: WxH. The focal lengths and cx scale with the width, cy scales with the height.
void setSize(gsv::PinholeCamera& camera, const std::string& text) {
  const std::size_t x = text.find('x');
  if (x == std::string::npos) throw gsv::OptionError("--size is '" + text + "', not WxH");
  const int width = gsv::parseInteger("--size", text.substr(0, x), 0, kMaxInteger);
  const int height = gsv::parseInteger("--size", text.substr(x + 1), 0, kMaxInteger);
  const double scale = static_cast<double>(width) / camera.width;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = (camera.cx + 0.5) * scale - 0.5;
  camera.cy = (camera.cy + 0.5) * height / camera.height - 0.5;
  camera.width = width;
  camera.height = height;
}

/// Adds the options that change a drive.
class DriveOptions {
 public:
  DriveOptions(Settings* settings, po::options_description* options)
      : settings_(*settings), options_(*options) {}

  void add() {
    gsv::SyntheticDrive::Options& drive = settings_.drive;
    addCount("frames", "number of frames", &drive.frames);
    const std::string size =
        std::to_string(drive.camera.width) + "x" + std::to_string(drive.camera.height);
    addOption<std::string>("size", "WxH", "image size at a constant horizontal field of view", size,
                           [&drive](const std::string& text) { setSize(drive.camera, text); });
    addReal("camera-height", "M", "camera height above the road [m]", &drive.camera_height);
    addReal("pitch", "RAD", "pitch of the camera mounting [rad], positive: looks down",
            &drive.pitch_rad);
    addReal("roll", "RAD",
            "roll of the camera mounting [rad], positive: the camera's x axis points down",
            &drive.roll_rad);
    addReal("yaw", "RAD", "yaw of the camera mounting [rad], positive: looks to the left",
            &drive.yaw_rad);
    addReal("speed", "MPS", "cruise speed [m/s]", &drive.speed);
    addReal("rate", "HZ", "frame rate [Hz]", &drive.frame_rate_hz);
    addReal("readout-time", "S",
            "readout time of a rolling shutter [s], 0: global shutter. Stamps and poses are those "
            "of the middle row",
            &drive.readout_time);
    addOption<int>("seed", "N", "random seed of street and noise",
                   std::to_string(drive.random_seed), [&drive](int seed) {
                     gsv::requireInRange("--seed", seed, 0, kMaxInteger);
                     drive.random_seed = static_cast<std::uint64_t>(seed);
                   });
    addReal("curvature", "PER_M", "maximum curvature [1/m], 0: straight road", &drive.curvature);
    addReal("slope", "RATIO", "maximum slope [m/m], 0: flat road", &drive.slope);
    addReal("stop", "S", "duration of the standstill [s], 0: no stop", &drive.stop_s);
    addReal("stop-at", "M", "distance at which the vehicle stops [m]", &drive.stop_at_m);
    addReal("suspension", "FACTOR", "factor on suspension pitch, roll and heave",
            &drive.suspension);
    addReal("road-texture", "FACTOR", "factor on the asphalt contrast", &drive.road_texture);
    addReal("noise", "SIGMA", "sensor noise sigma [grey levels]", &drive.noise_sigma);
    addCount("black-first", "index of the first black frame", &drive.black_first);
    addCount("black-frames", "number of black frames", &drive.black_frames);
    addSwitchOff("no-moving-cars", "without moving vehicles", &drive.moving_cars);
    addSwitchOff("no-lane-markings", "without lane markings", &drive.lane_markings);
    addSwitchOff("no-shadows", "without shadows on the road", &drive.shadows);
  }

 private:
  template <typename T>
  void addOption(const char* name, const char* value_name, const std::string& help,
                 const std::string& default_text, const std::function<void(const T&)>& set) {
    const auto change = [changes = &settings_.changes, set](const T& value) {
      changes->push_back([set, value] { set(value); });
    };
    options_.add_options()(name, po::value<T>()->value_name(value_name)->notifier(change),
                           (help + " (default without --scenario: " + default_text + ")").c_str());
  }
  void addReal(const char* name, const char* value_name, const char* help, double* field) {
    std::ostringstream text;
    text << std::setprecision(3) << *field;
    addOption<double>(name, value_name, help, text.str(),
                      [field](double value) { *field = value; });
  }
  void addCount(const char* name, const char* help, int* field) {
    addOption<int>(name, "N", help, std::to_string(*field),
                   [field, option = std::string("--") + name](int value) {
                     gsv::requireInRange(option.c_str(), value, 0, kMaxInteger);
                     *field = value;
                   });
  }
  void addSwitchOff(const char* name, const char* help, bool* field) {
    const auto change = [changes = &settings_.changes, field](bool given) {
      if (given) changes->push_back([field] { *field = false; });
    };
    options_.add_options()(name, po::bool_switch()->notifier(change), help);
  }

  Settings& settings_;
  po::options_description& options_;
};

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

void printCatalogue() {
  for (const gsv::Scenario& scenario : gsv::allScenarios()) {
    std::printf("%-18s %s\n", scenario.name.c_str(), scenario.description.c_str());
  }
}

void writeImages(const gsv::SyntheticDrive& drive, const fs::path& folder, int threads) {
  fs::create_directories(folder);
  gsv::ProgressLine progress("render_drive", drive.size());
  gsv::parallelFor(drive.size(), threads, [&](std::size_t i) {
    std::ostringstream name;
    name << std::setw(6) << std::setfill('0') << i << ".png";
    const std::string file = folder / name.str();
    std::vector<unsigned char> png;
    cv::imencode(".png", drive.image(i), png, {cv::IMWRITE_PNG_COMPRESSION, 1});
    gsv::writeFile(file, {png.begin(), png.end()});
    progress.step("frames");
  });
}

void writeTables(const gsv::SyntheticDrive& drive, const fs::path& folder) {
  const gsv::PinholeCamera& c = drive.camera();
  std::ostringstream calib, times, ground;
  calib << std::setprecision(17) << "P0: " << c.fx << " 0 " << c.cx << " 0 0 " << c.fy << ' '
        << c.cy << " 0 0 0 1 0\n";
  ground << std::setprecision(12)
         << "# camera height above the local road plane [m], its unit normal in camera axes "
            "(x right, y down, z forward), pointing up\n";
  times << std::fixed << std::setprecision(9);
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const gsv::SyntheticDrive::Frame& frame = drive.frame(i);
    times << static_cast<double>(frame.stamp_ns) * 1e-9 << '\n';
    ground << frame.height << ' ' << frame.n_c.x() << ' ' << frame.n_c.y() << ' ' << frame.n_c.z()
           << '\n';
    poses.push_back(frame.T_c0_c);
  }
  gsv::writeFile(folder / "calib.txt", calib.str());
  gsv::writeFile(folder / "times.txt", times.str());
  gsv::writeFile(folder / "ground.txt", ground.str());
  gsv::writeKittiPoses(folder / "poses.txt", poses);
}

gsv::SyntheticDrive makeDrive(const Settings& settings) {
  if (settings.path.empty()) return gsv::SyntheticDrive(settings.drive);
  try {
    return gsv::SyntheticDrive(settings.drive);
  } catch (const gsv::OptionError& error) {  // the other options have been validated
    throw gsv::DataError(settings.path + ": " + error.what());
  }
}

/// Writes under a temporary name and renames, so that FOLDER is complete or missing.
void render(const Settings& settings) {
  cv::setNumThreads(1);  // frames are rendered in parallel
  const fs::path folder = settings.folder;
  if (fs::exists(folder)) throw gsv::DataError(folder.string() + " already exists");
  const gsv::SyntheticDrive drive = makeDrive(settings);
  const fs::path normalised = fs::absolute(folder).lexically_normal();
  const fs::path target = normalised.has_filename() ? normalised : normalised.parent_path();
  const fs::path partial = target.string() + ".partial." + std::to_string(getpid());
  try {
    std::error_code error;
    fs::create_directories(partial, error);
    if (error) throw gsv::DataError(folder.string() + " cannot be created: " + error.message());
    writeImages(drive, partial / "image_0", settings.threads);
    writeTables(drive, partial);
    fs::rename(partial, target);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(partial, ignored);
    throw;
  }
  std::printf("%zu frames in %s\n", drive.size(), folder.c_str());
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
      ("threads", gsv::numberInRange("--threads", &settings.threads, "N", 1, 256),
       "number of rendering threads");
  DriveOptions(&settings, &command_line.options()).add();
  return command_line.run(
      argc, argv, [&] { check(&settings); },
      [&] {
        settings.list ? printCatalogue() : render(settings);
        return 0;
      });
}
