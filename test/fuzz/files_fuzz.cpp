// The files of a KITTI folder, a TUM trajectory, and the option --set of the tools. The first byte
// of an input selects what the others are.

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo::fuzz {
namespace {

namespace fs = std::filesystem;

/// A folder with a sequence of two images, removed at exit.
const fs::path& folder() {
  static const fs::path kFolder = [] {
    const fs::path memory = "/dev/shm";
    std::string pattern =
        (fs::is_directory(memory) ? memory : fs::temp_directory_path()) / "gsv_fuzz_XXXXXX";
    require(mkdtemp(pattern.data()) != nullptr, "the folder can be created");
    std::atexit([] { fs::remove_all(folder()); });
    const fs::path images = fs::path(pattern) / "image_0";
    fs::create_directories(images);
    const cv::Mat image(12, 16, CV_8UC1, cv::Scalar(100));
    for (const char* name : {"0.png", "1.png"}) cv::imwrite(images / name, image);
    return fs::path(pattern);
  }();
  return kFolder;
}

void replaceFile(const std::string& name, const std::string& content) {
  std::ofstream(folder() / name, std::ios::binary) << content;
}

/// Replaces one file of the sequence and reads the sequence: either its data are valid, or one
/// sentence says what is wrong.
void readSequenceWith(const std::string& file, const std::string& content) {
  static std::string replaced;
  if (file != replaced) {
    replaceFile("calib.txt", "P0: 10 0 8 0 0 10 6 0 0 0 1 0\n");
    replaceFile("times.txt", "0\n0.1\n");
    fs::remove(folder() / "poses.txt");
    replaced = file;
  }
  replaceFile(file, content);
  try {
    const KittiSequence sequence(folder());
    sequence.camera().validate();
    require(sequence.stampNs(0) < sequence.stampNs(1), "stamps increase");
    for (const Eigen::Isometry3d& pose : sequence.groundTruth()) {
      require(pose.matrix().allFinite(), "ground truth poses are finite");
    }
  } catch (const DataError& error) {
    const std::string text = error.what();
    require(text.find(file) != std::string::npos, "the error names the file");
    require(text.find('\n') == std::string::npos, "the error is one line");
  }
}

void readTrajectories(const fs::path& file) {
  try {
    const auto poses = readKittiPoses(file);
    if (poses.size() >= 2) {
      const OdometryMetrics metrics = computeOdometryMetrics(poses, poses);
      require(std::isfinite(metrics.length_m) && std::isfinite(metrics.ate_rmse_m),
              "metrics are finite");
      for (const auto& error : metrics.by_short_length) {
        require(std::isfinite(error.t_err_percent), "segment errors are finite");
      }
    }
  } catch (const DataError&) {
  }
  try {
    for (const StampedPose& pose : readTumTrajectory(file)) {
      require(pose.T_a_b.matrix().allFinite(), "poses are finite");
    }
  } catch (const DataError&) {
  }
}

/// An option within its range may still contradict another one.
void set(const std::string& assignment) {
  try {
    OfflineRun::Options options;
    setOption(options, assignment);
    options.validate();
  } catch (const OptionError&) {
  }
}

}  // namespace

Plan plan() {
  return {60000,
          {"0P0: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 0.000000000000e+00 "
           "0.000000000000e+00 7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 "
           "0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 0.000000000000e+00\n",
           "0P1: 1 2 3\nP0: 10 0 8 0 0 10 6 0 0 0 1 0\r\nTr: x\n",
           "11317042145.964389445\n1317042146.06\r\n", "1-3\n4e2\n\n",
           "21 0 0 0 0 1 0 0 0 0 1 0\n0.8 0 0.6 1.5 0 1 0 -0.1 -0.6 0 0.8 12\n",
           "21.000000e+00 9.043680e-12 2.326809e-11 5.551115e-17 9.043683e-12 1.000000e+00 "
           "2.392370e-10 3.330669e-16 2.326810e-11 2.392370e-10 9.999999e-01 -4.440892e-16\n"
           "1 0 0 0 0 1 0 0 0 0 1 1\r\n",
           "2# stamp tx ty tz qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.1 1 2 3 0.6 0 0 0.8\n",
           "3tracker/cell_size=0.03", "3refine=false", "3random_seed=7", "3direct/patch_size = 1",
           "3bundle_adjustment/window=5"}};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ground_scale_vo::fuzz;
  if (size == 0) return 0;
  const std::string content(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0] % 4) {
    case 0:
      readSequenceWith("calib.txt", content);
      break;
    case 1:
      readSequenceWith("times.txt", content);
      break;
    case 2:
      readSequenceWith("poses.txt", content);
      readTrajectories(folder() / "poses.txt");
      break;
    default:
      set(content);
  }
  return 0;
}
