// Derives more difficult drives from a KITTI folder: other mountings, rates, resolutions,
// qualities.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "common/files.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "simulation/tools/kitti_folder.hpp"
#include "tools/support/command_line.hpp"

namespace fs = std::filesystem;

namespace {

/// How a derived drive differs from the given one.
struct Changes {
  bool reversed = false;  ///< played backwards, as a camera that faces backwards sees it
  std::size_t step = 1;   ///< only every step-th image
  double scale = 1;       ///< of the image size
  int width = 0;          ///< central columns that are kept; 0: all
  /// Rotation of the camera about its x, y, z axis (pitch up, yaw, roll): x_new = R * x_old.
  Eigen::Vector3d rotation_deg = Eigen::Vector3d::Zero();
  int jpeg_quality = 0;  ///< 0: PNG
  bool dark = false;     ///< a quarter of the light, with the noise of photons and of the sensor
};

struct Variant {
  const char* name;
  void (*change)(Changes& changes);
};
constexpr Variant kVariants[] = {
    {"reverse", [](Changes& c) { c.reversed = true; }},
    {"every2", [](Changes& c) { c.step = 2; }},
    {"every3", [](Changes& c) { c.step = 3; }},
    {"half", [](Changes& c) { c.scale = 0.5; }},
    {"crop640", [](Changes& c) { c.width = 640; }},
    {"roll5", [](Changes& c) { c.rotation_deg.z() = 5; }},
    {"roll8", [](Changes& c) { c.rotation_deg.z() = 8; }},
    {"roll15", [](Changes& c) { c.rotation_deg.z() = 15; }},
    {"pitch6", [](Changes& c) { c.rotation_deg.x() = 6; }},
    {"pitch20", [](Changes& c) { c.rotation_deg.x() = 20; }},
    {"yaw8", [](Changes& c) { c.rotation_deg.y() = 8; }},
    {"jpeg20", [](Changes& c) { c.jpeg_quality = 20; }},
    {"dark", [](Changes& c) { c.dark = true; }},
};

/// The lowest of the largest rectangles (within 0.2 %) without a black pixel, in a mask whose white
/// pixels are a convex region.
cv::Rect largestRectangle(const cv::Mat& mask) {
  struct Interval {
    int first, end;
  };
  std::vector<Interval> rows;  // white columns
  for (int y = 0; y < mask.rows; ++y) {
    const auto* row = mask.ptr<unsigned char>(y);
    const auto* first = std::find(row, row + mask.cols, 255);
    rows.push_back({static_cast<int>(first - row),
                    static_cast<int>(std::find(first, row + mask.cols, 0) - row)});
  }
  // For each bottom row the largest rectangle. The region is convex, so its end rows decide.
  std::vector<cv::Rect> boxes(rows.size());
  int largest = 0;
  for (int bottom = 0; bottom < mask.rows; ++bottom) {
    for (int top = 0; top <= bottom; ++top) {
      const int left = std::max(rows[top].first, rows[bottom].first);
      const int right = std::min(rows[top].end, rows[bottom].end);
      const cv::Rect box(left, top, std::max(right - left, 0), bottom - top + 1);
      if (box.area() > boxes[bottom].area()) boxes[bottom] = box;
    }
    largest = std::max(largest, boxes[bottom].area());
  }
  return *std::find_if(boxes.rbegin(), boxes.rend(),
                       [&](const cv::Rect& box) { return box.area() >= 0.998 * largest; });
}

/// The images, camera and ground truth of a sequence after the changes.
class DerivedDrive {
 public:
  /// sequence: in the folder source.
  DerivedDrive(const gsv::KittiSequence& sequence, fs::path source, const Changes& changes)
      : sequence_(sequence),
        source_(std::move(source)),
        changes_(changes),
        camera_(sequence.camera()) {
    const double angle = changes.rotation_deg.norm() * gsv::kRadiansPerDegree;
    R_new_old_ = Eigen::AngleAxisd(angle, changes.rotation_deg.normalized()).toRotationMatrix();
    Eigen::Matrix3d K;
    K << camera_.fx, 0, camera_.cx, 0, camera_.fy, camera_.cy, 0, 0, 1;
    cv::eigen2cv(Eigen::Matrix3d(K * R_new_old_ * K.inverse()), homography_);

    box_ = {0, 0, camera_.width, camera_.height};
    if (angle > 0) {
      box_ =
          largestRectangle(warped(cv::Mat(box_.size(), CV_8U, cv::Scalar(255)), cv::INTER_NEAREST));
    }
    if (changes.width > 0) {
      box_.width = std::min(changes.width, camera_.width);
      box_.x = (camera_.width - box_.width) / 2;
    }
    camera_.width = cvFloor(box_.width * changes.scale);
    camera_.height = cvFloor(box_.height * changes.scale);
    box_.width = cvRound(camera_.width / changes.scale);  // resized by exactly this scale
    box_.height = cvRound(camera_.height / changes.scale);
    camera_.fx *= changes.scale;
    camera_.fy *= changes.scale;
    camera_.cx = (camera_.cx - box_.x + 0.5) * changes.scale - 0.5;
    camera_.cy = (camera_.cy - box_.y + 0.5) * changes.scale - 0.5;

    for (std::size_t i = 0; i < sequence.size(); i += changes.step) frames_.push_back(i);
    if (changes.reversed) std::reverse(frames_.begin(), frames_.end());
  }

  void write(const fs::path& folder) const {
    cv::RNG random(3);
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      gsv::writeKittiImage(folder, k, image(frames_[k], random), changes_.jpeg_quality);
    }
    gsv::writeKittiTables(folder, tables());
  }

 private:
  cv::Mat warped(const cv::Mat& image, int interpolation) const {
    cv::Mat result;
    cv::warpPerspective(image, result, homography_, image.size(), interpolation);
    return result;
  }

  cv::Mat image(std::size_t i, cv::RNG& random) const {
    cv::Mat image = sequence_.image(i);
    if (!changes_.rotation_deg.isZero()) image = warped(image, cv::INTER_CUBIC);
    image = image(box_).clone();
    if (changes_.scale != 1) {
      cv::resize(image, image, {camera_.width, camera_.height}, 0, 0, cv::INTER_AREA);
    }
    if (!changes_.dark) return image;
    // Two photons a grey level, so their noise has half the variance of the signal; 3 grey levels
    // of the sensor. The sum of both is one normal distribution.
    cv::Mat signal, sigma, noise(image.size(), CV_32F);
    image.convertTo(signal, CV_32F, 0.25);
    cv::sqrt(signal / 2 + 9, sigma);
    random.fill(noise, cv::RNG::NORMAL, 0, 1);
    cv::Mat(signal + sigma.mul(noise)).convertTo(image, CV_8U);
    return image;
  }

  gsv::KittiTables tables() const {
    gsv::KittiTables tables;
    tables.camera = camera_;
    const std::vector<Eigen::Isometry3d>& truth = sequence_.groundTruth();
    const std::vector<Eigen::Vector4d> ground = givenGround();
    const Eigen::Isometry3d T_new_old(R_new_old_);
    for (const std::size_t i : frames_) {
      tables.stamps_ns.push_back(
          std::abs(sequence_.stampNs(i) - sequence_.stampNs(frames_.front())));
      if (!ground.empty()) {
        tables.ground.emplace_back();
        tables.ground.back() << ground.at(i)[0], R_new_old_ * ground.at(i).tail<3>();
      }
      if (truth.empty()) continue;
      const Eigen::Isometry3d T_first_i = truth[frames_.front()].inverse() * truth[i];
      tables.T_c0_c.push_back(T_new_old * T_first_i * T_new_old.inverse());
    }
    return tables;
  }

  /// The lines of ground.txt.
  std::vector<Eigen::Vector4d> givenGround() const {
    if (sequence_.groundTruthHeights().empty()) return {};
    const gsv::TextFile file(source_ / "ground.txt");
    std::vector<Eigen::Vector4d> lines;
    for (std::size_t i = 0; i < file.size(); ++i) {
      if (!file.isComment(i)) lines.emplace_back(file.numbers(i, 4).data());
    }
    return lines;
  }

  const gsv::KittiSequence& sequence_;
  const fs::path source_;
  const Changes changes_;
  gsv::PinholeCamera camera_;  ///< of the new images
  Eigen::Matrix3d R_new_old_;
  cv::Mat homography_;
  cv::Rect box_;                     ///< the part of the (warped) image that is kept
  std::vector<std::size_t> frames_;  ///< of the sequence, in the new order
};

struct Arguments {
  std::string sequence, out;
  std::vector<std::string> names;
  std::vector<Variant> variants;  ///< of these names
};

void check(Arguments* arguments) {
  for (const std::string& name : arguments->names) {
    const auto* variant = std::find_if(std::begin(kVariants), std::end(kVariants),
                                       [&](const Variant& v) { return v.name == name; });
    if (variant == std::end(kVariants)) {
      std::string known;
      for (const Variant& v : kVariants) known += std::string(known.empty() ? "" : ", ") + v.name;
      throw gsv::OptionError("unknown variant '" + name + "', there are " + known);
    }
    arguments->variants.push_back(*variant);
  }
  if (arguments->names.empty())
    arguments->variants.assign(std::begin(kVariants), std::end(kVariants));
}

int run(const Arguments& arguments) {
  cv::setNumThreads(1);
  const gsv::KittiSequence sequence(arguments.sequence);
  gsv::ProgressLine progress(sequence.name(), arguments.variants.size());
  for (const Variant& variant : arguments.variants) {
    Changes changes;
    variant.change(changes);
    const fs::path folder = fs::path(arguments.out) / (sequence.name() + "_" + variant.name);
    const DerivedDrive drive(sequence, arguments.sequence, changes);
    gsv::writeKittiFolder(folder, [&](const fs::path& partial) { drive.write(partial); });
    progress.step("variants");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "derive_drives",
      "Derives more difficult drives from a KITTI folder, with the ground truth changed "
      "accordingly.",
      R"(Without a VARIANT: all. reverse: played backwards. every2, every3: every second or third image.
half: half the resolution. crop640: the 640 central columns. roll5, roll8, roll15, pitch6, pitch20, yaw8:
the camera turned by so many degrees, the images cut to the largest rectangle without a border. jpeg20:
JPEG files of quality 20. dark: a quarter of the light, with noise.

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.)");
  command_line.addPositional("SEQ", "KITTI folder, as for run_sequence", &arguments.sequence);
  command_line.addPositionals("VARIANT", "the drives to derive", &arguments.names);
  command_line.options().add_options()  //
      ("out", gsv::requiredValue(&arguments.out, "DIR"),
       "the drives are DIR/<name of SEQ>_VARIANT/");
  return command_line.run(
      argc, argv, [&] { check(&arguments); }, [&] { return run(arguments); });
}
