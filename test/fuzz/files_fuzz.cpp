// The files of a KITTI folder, and the option --set of the tools. The first byte of an input
// selects what the others are.

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace gsv::fuzz {
namespace {

namespace fs = std::filesystem;

/// A folder with a sequence of two images, removed at exit.
const fs::path& folder() {
  const fs::path memory = "/dev/shm";
  static const fs::path kFolder = (fs::is_directory(memory) ? memory : fs::temp_directory_path()) /
                                  ("gsv_fuzz_" + std::to_string(getpid()));
  if (fs::create_directories(kFolder / "image_0")) {
    std::atexit([] { fs::remove_all(kFolder); });
    const cv::Mat image(12, 16, CV_8UC1, cv::Scalar(100));
    for (const char* name : {"0.png", "1.png"}) cv::imwrite(kFolder / "image_0" / name, image);
  }
  return kFolder;
}

/// Replaces one file of the sequence and reads the sequence: either its data are valid, or one
/// sentence says what is wrong.
void readSequenceWith(const std::string& file, const std::string& content) {
  std::map<std::string, std::string> files{{"calib.txt", "P0: 10 0 8 0 0 10 6 0 0 0 1 0\n"},
                                           {"times.txt", "0\n0.1\n"},
                                           {"poses.txt",
                                            "1 0 0 0 0 1 0 0 0 0 1 0\n"
                                            "1 0 0 0 0 1 0 0 0 0 1 1\n"}};
  files[file] = content;
  for (const auto& [name, text] : files) std::ofstream(folder() / name, std::ios::binary) << text;
  try {
    const KittiSequence sequence(folder());
    sequence.camera().validate();
    const auto& poses = sequence.groundTruth();
    for (const auto& pose : poses) require(pose.matrix().allFinite(), "poses are finite");
    if (poses.size() >= 2) {
      require(std::isfinite(computeOdometryMetrics(poses, poses).ate_rmse_m), "metrics are finite");
    }
  } catch (const DataError& error) {
    const std::string text = error.what();
    require(text.find(file) != std::string::npos, "the error names the file");
    require(text.find('\n') == std::string::npos, "the error is one line");
  }
}

/// The folder that readSequenceWith() has written.
void readDrive() {
  try {
    DriveInput input;
    input.path = folder();
    const auto drive = openDrive(input);
    std::optional<std::int64_t> last_ns;
    while (const auto image = drive->next()) {
      if (image->grey.empty()) continue;
      require(!last_ns || *last_ns < image->stamp_ns, "stamps increase");
      last_ns = image->stamp_ns;
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
          {"0P0: 7.188560000000e+02 0 6.071928e+02 0 0 7.18856e+02 1.852157e+02 0 0 0 1 0\n",
           "0P1: 1 2 3\nP0: 10 0 8 0 0 10 6 0 0 0 1 0\r\nTr: x\n",
           "11317042145.964389445\n1317042146.06\r\n", "1-3\n4e2\n\n",
           "21 0 0 0 0 1 0 0 0 0 1 0\n0.8 0 0.6 1.5 0 1 0 -0.1 -0.6 0 0.8 12\n",
           "3tracker/cell_size=0.03", "3refine=false", "3direct/patch_size = 1"}};
}

void run(const std::string& input) {
  if (input.empty()) return;
  const std::string content = input.substr(1);
  const char* const kFiles[] = {"calib.txt", "times.txt", "poses.txt"};
  const std::size_t kind = static_cast<unsigned char>(input[0]) % 4;
  if (kind < 3) {
    readSequenceWith(kFiles[kind], content);
    readDrive();
  }
  if (kind == 3) set(content);
}

}  // namespace gsv::fuzz
