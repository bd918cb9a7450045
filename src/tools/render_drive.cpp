// A SyntheticDrive as a KITTI odometry folder with ground truth.

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

#include "for_all.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/simulation/scenarios.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "progress_line.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;
namespace fs = std::filesystem;

namespace {

constexpr const char* kPurpose =
    R"(usage: render_drive [options] FOLDER
       render_drive --list

Renders a drive along a street as a KITTI odometry folder: image_0/NNNNNN.png, calib.txt,
times.txt, the exact poses.txt, and ground.txt with the exact height and road normal of
every frame. FOLDER must not exist yet. kitti_to_bag makes a bag of it.

)";

/// What the command line sets.
struct Settings {
  fs::path folder;
  gsv::SyntheticDrive::Options drive;
  double threads = std::max(1u, std::thread::hardware_concurrency());
  bool list = false;  ///< the catalogue instead of a drive
};

int wholeNumber(const std::string& option, const std::string& text) {
  return gsv::parseWholeNumber(option, text, 0, 1000000);
}

/// WxH; the focal length and the centre follow in proportion to the width.
void setSize(gsv::PinholeCamera& camera, const std::string& option, const std::string& text) {
  const std::size_t x = text.find('x');
  if (x == std::string::npos) throw gsv::OptionError(option + " is '" + text + "', not WxH");
  const int width = wholeNumber(option, text.substr(0, x));
  const int height = wholeNumber(option, text.substr(x + 1));
  const double scale = static_cast<double>(width) / camera.width;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = (camera.cx + 0.5) * scale - 0.5;
  camera.cy = (camera.cy + 0.5) * height / camera.height - 0.5;
  camera.width = width;
  camera.height = height;
}

struct Option {
  const char *name, *value;  ///< value: nullptr for a switch
  std::string help;
  std::function<void(const std::string& option, const std::string& value)> set;
};

std::vector<Option> optionTable(Settings& settings) {
  gsv::SyntheticDrive::Options& drive = settings.drive;
  const auto real = [](const char* name, const char* value, const char* help, double& target) {
    std::ostringstream text;
    text << help << " (" << std::setprecision(3) << target << ")";
    return Option{name, value, text.str(), [&target](const auto& option, const auto& given) {
                    target = gsv::parseNumber(option, given);
                  }};
  };
  const auto whole = [](const char* name, const char* help, int& target) {
    return Option{
        name, "N", help + (" (" + std::to_string(target)) + ")",
        [&target](const auto& option, const auto& given) { target = wholeNumber(option, given); }};
  };
  const auto off = [](const char* name, const char* help, bool& target) {
    return Option{name, nullptr, help, [&target](const auto&, const auto&) { target = false; }};
  };
  const gsv::PinholeCamera& camera = drive.camera;
  return {
      {"--list", nullptr, "prints the catalogue of drives that are hard for a camera",
       [&settings](const auto&, const auto&) { settings.list = true; }},
      {"--scenario", "NAME", "a drive of the catalogue (--list); options after it change it",
       [&drive](const auto&, const auto& given) { drive = gsv::findScenario(given).options; }},
      whole("--frames", "frames", drive.frames),
      {"--size", "WxH",
       "of the image, at one field of view (" + std::to_string(camera.width) + "x" +
           std::to_string(camera.height) + ")",
       [&drive](const auto& option, const auto& given) { setSize(drive.camera, option, given); }},
      real("--camera-height", "M", "over the road [m]", drive.camera_height),
      real("--pitch", "RAD", "of the mounted camera, positive looks down [rad]", drive.pitch_rad),
      real("--speed", "MPS", "cruise [m/s]", drive.speed),
      real("--rate", "HZ", "frame rate [Hz]", drive.frame_rate_hz),
      {"--seed", "N", "of the street and of the noise (1)",
       [&drive](const auto& option, const auto& given) {
         drive.random_seed = static_cast<std::uint64_t>(wholeNumber(option, given));
       }},
      real("--curvature", "PER_M", "largest, 0 for a straight road [1/m]", drive.curvature),
      real("--slope", "RATIO", "largest, 0 for a flat road", drive.slope),
      real("--stop", "S", "time at standstill, 0 for no stop [s]", drive.stop_s),
      real("--stop-at", "M", "along the road [m]", drive.stop_at_m),
      real("--suspension", "FACTOR", "on pitch, roll and bounce", drive.suspension),
      real("--road-texture", "FACTOR", "on the asphalt's contrast", drive.road_texture),
      real("--noise", "SIGMA", "of the sensor [grey levels]", drive.noise_sigma),
      whole("--black-first", "first black frame", drive.black_first),
      whole("--black-frames", "number of black frames", drive.black_frames),
      off("--no-moving-cars", "nobody else drives", drive.moving_cars),
      off("--no-lane-markings", "bare asphalt", drive.lane_markings),
      off("--no-shadows", "an overcast sky's road", drive.shadows),
      real("--threads", "N", "that render", settings.threads),
  };
}

std::string usage() {
  Settings defaults;
  std::ostringstream text;
  text << kPurpose;
  for (const Option& option : optionTable(defaults)) {
    const std::string name =
        option.name + (option.value ? " " + std::string(option.value) : std::string());
    text << "  " << std::left << std::setw(22) << name << ' ' << option.help << '\n';
  }
  text << "\nExit status: 0 done, 1 FOLDER cannot be written, 2 wrong options.\n";
  return text.str();
}

void printCatalogue() {
  for (const gsv::Scenario& scenario : gsv::allScenarios()) {
    std::printf("%-18s %s\n", scenario.name.c_str(), scenario.what.c_str());
  }
}

/// Throws OptionError.
Settings parse(int argc, char** argv) {
  Settings settings;
  const std::vector<Option> options = optionTable(settings);
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.empty() || argument.front() != '-') {
      if (!settings.folder.empty()) {
        throw gsv::OptionError("one FOLDER at a time, not also " + argument);
      }
      settings.folder = argument;
      continue;
    }
    const auto known = std::find_if(options.begin(), options.end(),
                                    [&](const Option& option) { return argument == option.name; });
    if (known == options.end()) throw gsv::OptionError(argument + " is no option, see --help");
    if (known->value && ++i == argc) {
      throw gsv::OptionError(argument + " needs a value, see --help");
    }
    known->set(argument, known->value ? argv[i] : "");
  }
  if (settings.list) return settings;
  if (settings.folder.empty()) throw gsv::OptionError("FOLDER is missing, see --help");
  gsv::requireInRange("--threads", settings.threads, 1, 256);
  settings.drive.validate();
  return settings;
}

void writeImages(const gsv::SyntheticDrive& drive, const fs::path& folder, int threads) {
  fs::create_directories(folder);
  gsv::ProgressLine progress("render_drive", drive.size());
  gsv::forAll(drive.size(), threads, [&](std::size_t i) {
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

/// Everything under a temporary name, so that a folder of that name is a whole one.
void render(const Settings& settings) {
  cv::setNumThreads(1);  // the frames are rendered side by side
  const fs::path& folder = settings.folder;
  if (fs::exists(folder)) throw gsv::DataError(folder.string() + " exists already");
  const gsv::SyntheticDrive drive(settings.drive);
  const fs::path clean = fs::absolute(folder).lexically_normal();
  const fs::path target = clean.has_filename() ? clean : clean.parent_path();
  const fs::path partial = target.string() + ".partial." + std::to_string(getpid());
  try {
    std::error_code error;
    fs::create_directories(partial, error);
    if (error) throw gsv::DataError(folder.string() + " cannot be made: " + error.message());
    writeImages(drive, partial / "image_0", static_cast<int>(settings.threads));
    writeTables(drive, partial);
    fs::rename(partial, target);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(partial, ignored);
    throw;
  }
  std::printf("%zu frames in %s\n", drive.size(), folder.c_str());
}

void run(const Settings& settings) {
  if (settings.list) {
    printCatalogue();
  } else {
    render(settings);
  }
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("render_drive", usage().c_str(), argc, argv, parse, run);
}
