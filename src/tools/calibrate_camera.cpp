// Estimates the lens of a camera from drives.

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "support/command_line.hpp"
#include "support/progress_line.hpp"
#include "support/sequence_arguments.hpp"

namespace gsv = ground_scale_vo;
namespace po = boost::program_options;

namespace {

/// Of a field of view without a calibration.
constexpr double kFovFocalSigma = 0.2;
constexpr double kFovCentreSigma = 0.016;  // [image widths]

struct Arguments {
  std::vector<std::string> drives, settings;
  std::string camera, out;
  double fov_deg = 0;
  bool force = false;
  gsv::LensCalibration::Options options;
};

/// The calibration with which the estimation starts. Throws DataError.
gsv::Lens startOf(const Arguments& arguments, const gsv::KittiSequence& drive) {
  if (!arguments.camera.empty()) return gsv::lensOf(gsv::readCameraFile(arguments.camera));
  gsv::PinholeCamera camera = drive.camera();
  if (arguments.fov_deg > 0) {
    camera.fx = camera.fy =
        0.5 * camera.width / std::tan(0.5 * arguments.fov_deg / gsv::kDegreesPerRadian);
    camera.cx = 0.5 * (camera.width - 1);
    camera.cy = 0.5 * (camera.height - 1);
  }
  return gsv::Lens{camera};
}

int run(Arguments arguments) {
  gsv::requireNewFile(arguments.out, arguments.force);
  cv::setNumThreads(1);
  std::vector<std::unique_ptr<const gsv::KittiSequence>> sequences;
  std::vector<const gsv::KittiSequence*> drives;
  for (const std::string& folder : arguments.drives) {
    sequences.push_back(std::make_unique<const gsv::KittiSequence>(folder));
    drives.push_back(sequences.back().get());
  }
  const gsv::Lens start = startOf(arguments, *drives.front());
  if (arguments.fov_deg > 0) {
    arguments.options.estimator.prior_focal_sigma = kFovFocalSigma;
    arguments.options.estimator.prior_centre_sigma_px = kFovCentreSigma * start.camera.width;
    arguments.options.max_runs *= 2;
  }
  std::unique_ptr<gsv::ProgressLine> line;
  const gsv::LensCalibration calibration(arguments.options);
  const auto result =
      calibration.calibrate(drives, start, [&](int number, std::size_t drive, std::size_t image) {
        if (image == 0) {
          line = std::make_unique<gsv::ProgressLine>(
              drives[drive]->name() + ", run " + std::to_string(number), drives[drive]->size());
        }
        line->step("frames");
      });
  line.reset();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const gsv::LensEstimator::Result& drive = result.drives[i];
    std::printf("%s: %s, %zu keyframes, %zu tracks, residual rms %.3f -> %.3f px\n",
                drives[i]->name().c_str(),
                drive.reason.empty() ? toString(drive.status) : drive.reason.c_str(),
                drive.keyframes, drive.tracks, drive.rms_before_px, drive.rms_after_px);
  }
  if (result.status != gsv::LensEstimator::Status::kOk) {
    throw gsv::DataError("the lens is not observable: " + result.reason);
  }
  const std::string table = gsv::lensTable(result);
  std::printf("%s", table.c_str());
  if (!result.converged) {
    std::fprintf(stderr, "the estimate still changed in run %d; run again with --camera %s\n",
                 result.runs, arguments.out.c_str());
  }
  gsv::CameraCalibration camera = gsv::calibrationOf(result.estimate.lens);
  camera.estimated = true;
  gsv::writeFile(arguments.out,
                 gsv::cameraYaml(camera, "Estimated by calibrate_camera.\n" + table));
  const std::string plot = std::filesystem::path(arguments.out).replace_extension(".png").string();
  for (const gsv::LensEstimator::Result& drive : result.drives) {
    if (drive.status != gsv::LensEstimator::Status::kOk) continue;
    cv::imwrite(plot, gsv::drawResiduals(drive, start.camera));
    break;
  }
  std::printf("written to %s and %s\n", arguments.out.c_str(), plot.c_str());
  return 0;
}

/// Applies and checks the arguments. Throws OptionError.
void check(Arguments* target) {
  Arguments& arguments = *target;
  if (!arguments.camera.empty() && arguments.fov_deg > 0) {
    throw gsv::OptionError("--camera and --fov exclude each other");
  }
  if (arguments.fov_deg != 0) gsv::requireInRange("--fov", arguments.fov_deg, 10, 150);
  for (const std::string& setting : arguments.settings) {
    gsv::setOption(arguments.options, setting);
  }
  arguments.options.validate();
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "calibrate_camera",
      "Estimates focal length, principal point and radial distortion of a camera from drives with\n"
      "turns, and prints them with their standard deviations. For images that are rectified "
      "already\n"
      "this is what the rectification has left.",
      "Exit status: 0 done, 1 the data cannot be used or do not determine the lens, 2 the "
      "arguments\n"
      "cannot be used. FILE is written only with status 0.");
  command_line.addPositionals(
      "DRIVE...", "KITTI odometry folders or KITTI raw synced drives, all of one camera",
      &arguments.drives);
  command_line.options().add_options()  //
      ("camera", gsv::optionalValue(&arguments.camera, "FILE"),
       "calibration of the images (YAML of camera_calibration); without it that of the folder")  //
      ("fov", gsv::optionalValue(&arguments.fov_deg, "DEG"),
       "horizontal field of view, when there is no calibration; may be wrong by 15 %")  //
      ("out", gsv::requiredValue(&arguments.out, "FILE"),
       "YAML of camera_calibration; beside it FILE.png with the mean residuals over the image")  //
      ("force", po::bool_switch(&arguments.force), "replace FILE when it exists")                //
      ("set", gsv::settingsValue(&arguments.settings), gsv::kSettingsHelp);
  return command_line.run(
      argc, argv, [&] { check(&arguments); }, [&] { return run(arguments); });
}
