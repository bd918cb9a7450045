// The camera's height and mounting from a drive of known length: a KITTI folder or a bag.

#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/NavSatFix.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "ground_scale_vo/calibration/height_calibration.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/set_option.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/ros/camera_stream.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "run_progress.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;
namespace fs = std::filesystem;

namespace {

constexpr const char* kUsage =
    R"(usage: height_from_drive SEQ|--bag FILE (--length M --length-sigma M | --gps TOPIC | --trajectory FILE)
                        --out FILE [options]

Runs the odometry over a drive whose length is known and tells the camera's height above the road,
how it is mounted, and how certain both are. Without a ROS master.

The drive:
  SEQ                  KITTI odometry folder or KITTI raw synced drive
  --bag FILE           a bag, with
  --image TOPIC        its images (default /camera/image_raw; TOPIC/compressed where it has that)
  --camera-info TOPIC  their calibration (default: camera_info beside the images)
  --rectified          the images have no distortion and P of camera_info belongs to them
  --from S, --to S     only the images this many seconds after the first one

Its length, one of
  --length M           an odometer's reading between the first image and the last [m], and
  --length-sigma M     how far it may be off [m], one standard deviation
  --gps TOPIC          fixes in the bag (sensor_msgs/NavSatFix)
  --trajectory FILE    positions of anything fixed to the vehicle: TUM (stamp x y z qx qy qz qw), or
                       KITTI poses, a line for each image. Their axes do not matter

The result:
  --out FILE           YAML, for height_file:= of the launch files
  --force              even when FILE exists already
  --set GROUP/NAME=VALUE
                       an option other than its default (docs/parameters.md); as often as needed

Exit status: 0 done, 1 the data cannot be used or leave the height too uncertain, 2 the arguments
cannot be used. There is no FILE unless it is 0.
)";

/// The height that the run is told. Any would do: the scale is linear in it.
constexpr double kNominalHeight = 1;
/// Of a fix against its neighbours, where the receiver does not say [m].
constexpr double kFixSigma = 2.5;
constexpr double kDeg = 180 / 3.14159265358979323846;

struct Arguments {
  std::string sequence, bag, image = "/camera/image_raw", camera_info, gps, trajectory, out;
  std::optional<double> length, length_sigma;
  double from_s = 0, to_s = 1e9;
  bool rectified = false, force = false;
  gsv::OfflineRun::Options options;
};

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  arguments.options.scale.camera_height = kNominalHeight;
  const std::map<std::string, std::string*> texts = {{"--bag", &arguments.bag},
                                                     {"--image", &arguments.image},
                                                     {"--camera-info", &arguments.camera_info},
                                                     {"--gps", &arguments.gps},
                                                     {"--trajectory", &arguments.trajectory},
                                                     {"--out", &arguments.out}};
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] {
      if (++i == argc || !*argv[i]) throw gsv::OptionError(argument + " needs a value");
      return std::string(argv[i]);
    };
    const auto number = [&](double min, double max) {
      const double read = gsv::parseNumber(argument, value());
      gsv::requireInRange(argument.c_str(), read, min, max);
      return read;
    };
    if (const auto text = texts.find(argument); text != texts.end()) {
      *text->second = value();
    } else if (argument == "--length") {
      arguments.length = number(1, 1e7);
    } else if (argument == "--length-sigma") {
      arguments.length_sigma = number(0, 1e7);
    } else if (argument == "--from") {
      arguments.from_s = number(0, 1e9);
    } else if (argument == "--to") {
      arguments.to_s = number(0, 1e9);
    } else if (argument == "--rectified") {
      arguments.rectified = true;
    } else if (argument == "--force") {
      arguments.force = true;
    } else if (argument == "--set") {
      gsv::setOption(arguments.options, value());
    } else if (argument.size() > 1 && argument.front() == '-') {
      throw gsv::OptionError(argument + " is not an option, see --help");
    } else if (!arguments.sequence.empty()) {
      throw gsv::OptionError("one sequence at a time, not " + arguments.sequence + " and " +
                             argument);
    } else {
      arguments.sequence = argument;
    }
  }
  if (arguments.sequence.empty() == arguments.bag.empty()) {
    throw gsv::OptionError("one drive is needed: SEQ or --bag FILE, see --help");
  }
  if (arguments.length.has_value() + !arguments.gps.empty() + !arguments.trajectory.empty() != 1) {
    throw gsv::OptionError("one of --length, --gps and --trajectory is needed, see --help");
  }
  if (arguments.length.has_value() != arguments.length_sigma.has_value()) {
    throw gsv::OptionError("--length and --length-sigma go together, see --help");
  }
  if (!arguments.gps.empty() && arguments.bag.empty()) {
    throw gsv::OptionError("--gps needs --bag: a KITTI folder has no fixes");
  }
  if (arguments.to_s <= arguments.from_s) throw gsv::OptionError("--to lies before --from");
  if (arguments.out.empty()) throw gsv::OptionError("--out is missing, see --help");
  if (arguments.camera_info.empty()) {
    arguments.camera_info =
        arguments.image.substr(0, arguments.image.rfind('/') + 1) + "camera_info";
  }
  arguments.options.validate();
  return arguments;
}

/// What was run, and what is known of the way.
struct Drive {
  gsv::RunRecord record;
  std::vector<std::int64_t> stamps_ns;
  std::vector<gsv::TruePosition> fixes;
  double fix_sigma = 0;
};

Drive runSequence(const Arguments& arguments) {
  const gsv::KittiSequence sequence(arguments.sequence);
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const double s = 1e-9 * static_cast<double>(sequence.stampNs(i) - sequence.stampNs(0));
    if (s >= arguments.from_s && s <= arguments.to_s) chosen.push_back(i);
  }
  if (chosen.empty()) throw gsv::DataError(arguments.sequence + " has no image there");
  Drive drive;
  // A trajectory without stamps has a line for every image of the folder.
  for (std::size_t i = 0; i < sequence.size(); ++i) drive.stamps_ns.push_back(sequence.stampNs(i));
  gsv::OfflineRun run(sequence.camera(), arguments.options);
  gsv::RunProgress progress(sequence.name(), chosen.size());
  gsv::ImageReader reader(chosen.size(), [&](std::size_t i) { return sequence.image(chosen[i]); });
  for (const std::size_t i : chosen) {
    progress.show(run.process(reader.next().image, sequence.stampNs(i)));
  }
  drive.record = run.record();
  return drive;
}

class BagDrive {
 public:
  /// Throws DataError, also in one sentence for what rosbag throws.
  static Drive run(const Arguments& arguments) {
    if (!fs::is_regular_file(arguments.bag)) {
      throw gsv::DataError("there is no bag " + arguments.bag);
    }
    try {
      return BagDrive(arguments).run();
    } catch (const rosbag::BagException& error) {
      throw gsv::DataError("the bag " + arguments.bag + " cannot be read: " + error.what());
    }
  }

 private:
  explicit BagDrive(const Arguments& arguments)
      : arguments_(arguments), stream_(arguments.rectified) {
    bag_.open(arguments.bag, rosbag::bagmode::Read);
  }

  Drive run() {
    const std::string image = imageTopic();
    acceptCalibration();
    if (!arguments_.gps.empty()) readFixes();
    const std::string name = fs::path(arguments_.bag).stem();
    rosbag::View view(bag_, rosbag::TopicQuery(image));
    gsv::RunProgress progress(name, view.size());
    for (const rosbag::MessageInstance& instance : view) {
      if (const gsv::RunFrame* frame = process(instance)) progress.show(*frame);
    }
    if (!run_) {
      throw gsv::DataError("no image on " + image + " could be used" +
                           (refused_ > 0 ? ": " + first_refusal_ : std::string()));
    }
    if (refused_ > 0) {
      std::fprintf(stderr, "%s: %zu images were left out, the first one because %s\n", name.c_str(),
                   refused_, first_refusal_.c_str());
    }
    drive_.record = run_->record();
    return std::move(drive_);
  }

  std::string imageTopic() {
    for (const std::string& topic : {arguments_.image, arguments_.image + "/compressed"}) {
      if (rosbag::View(bag_, rosbag::TopicQuery(topic)).size() > 0) return topic;
    }
    throw gsv::DataError(missing(arguments_.image, "images"));
  }

  std::string missing(const std::string& topic, const std::string& what) {
    std::string held;
    for (const auto* connection : rosbag::View(bag_).getConnections()) {
      if (held.find(connection->topic) == std::string::npos) {
        held += (held.empty() ? "" : ", ") + connection->topic;
      }
    }
    return "the bag " + arguments_.bag + " has no " + what + " on " + topic + "; it holds " +
           (held.empty() ? "nothing" : held);
  }

  /// The first that can be used, as the nodelets wait for it.
  void acceptCalibration() {
    std::string refusal = missing(arguments_.camera_info, "camera_info");
    for (const rosbag::MessageInstance& instance :
         rosbag::View(bag_, rosbag::TopicQuery(arguments_.camera_info))) {
      const auto info = instance.instantiate<sensor_msgs::CameraInfo>();
      if (!info) continue;
      try {
        stream_.accept(*info, arguments_.camera_info);
        return;
      } catch (const gsv::MessageError& error) {
        refusal = error.what();
      }
    }
    throw gsv::DataError(refusal);
  }

  /// Null for an image that is left out.
  const gsv::RunFrame* process(const rosbag::MessageInstance& instance) {
    sensor_msgs::ImageConstPtr image = instance.instantiate<sensor_msgs::Image>();
    const auto compressed = instance.instantiate<sensor_msgs::CompressedImage>();
    if (!image && !compressed) return nullptr;
    const std_msgs::Header& header = image ? image->header : compressed->header;
    // A trajectory without stamps has a line for every image, whether it can be used or not.
    drive_.stamps_ns.push_back(gsv::toNanoseconds(header.stamp));
    if (first_.isZero()) first_ = header.stamp;
    const double s =
        1e-9 * static_cast<double>(gsv::toNanoseconds(header.stamp) - gsv::toNanoseconds(first_));
    if (s < arguments_.from_s || s > arguments_.to_s) return nullptr;
    try {
      if (guard_.check(header.stamp) != gsv::StampGuard::Verdict::kNext) {
        throw gsv::MessageError(guard_.reason().empty() ? "its stamp jumps back" : guard_.reason());
      }
      if (!image) image = cv_bridge::toCvCopy(compressed)->toImageMsg();
      const auto camera = stream_.camera();
      const cv::Mat rectified = camera->rectified(*image, &grey_);
      if (!run_) run_ = std::make_unique<gsv::OfflineRun>(camera->camera(), arguments_.options);
      return &run_->process(rectified, gsv::toNanoseconds(header.stamp));
    } catch (const gsv::MessageError& error) {
      refuse(error.what());
    } catch (const cv::Exception&) {
      refuse("its compressed data cannot be decoded");
    } catch (const cv_bridge::Exception&) {
      refuse("its compressed data cannot be decoded");
    }
    return nullptr;
  }
  void refuse(const std::string& why) {
    if (refused_++ == 0) first_refusal_ = why;
  }

  void readFixes() {
    std::vector<Eigen::Vector3d> fixes;
    std::vector<double> sigmas;
    std::size_t messages = 0;
    for (const rosbag::MessageInstance& instance :
         rosbag::View(bag_, rosbag::TopicQuery(arguments_.gps))) {
      const auto fix = instance.instantiate<sensor_msgs::NavSatFix>();
      if (!fix) continue;
      ++messages;
      const Eigen::Vector3d place(fix->latitude, fix->longitude,
                                  std::isfinite(fix->altitude) ? fix->altitude : 0);
      const std::int64_t stamp_ns = gsv::toNanoseconds(fix->header.stamp);
      const bool is_later = drive_.fixes.empty() || stamp_ns > drive_.fixes.back().stamp_ns;
      if (fix->status.status < sensor_msgs::NavSatStatus::STATUS_FIX || !place.allFinite() ||
          !is_later) {
        continue;
      }
      fixes.push_back(place);
      drive_.fixes.push_back({stamp_ns, Eigen::Vector3d::Zero()});
      const double variance = (fix->position_covariance[0] + fix->position_covariance[4]) / 2;
      const bool is_known =
          fix->position_covariance_type != sensor_msgs::NavSatFix::COVARIANCE_TYPE_UNKNOWN;
      sigmas.push_back(is_known && variance > 0 ? std::sqrt(variance) : kFixSigma);
    }
    if (messages == 0) throw gsv::DataError(missing(arguments_.gps, "fixes"));
    if (fixes.empty()) {
      throw gsv::DataError("none of the " + std::to_string(messages) + " fixes on " +
                           arguments_.gps + " has a position");
    }
    const std::vector<Eigen::Vector3d> places = gsv::eastNorthUp(fixes);
    for (std::size_t i = 0; i < places.size(); ++i) drive_.fixes[i].p = places[i];
    std::nth_element(sigmas.begin(), sigmas.begin() + static_cast<long>(sigmas.size() / 2),
                     sigmas.end());
    drive_.fix_sigma = sigmas[sigmas.size() / 2];
  }

  const Arguments& arguments_;
  rosbag::Bag bag_;
  gsv::CameraStream stream_;
  gsv::GreyConverter grey_;
  gsv::StampGuard guard_{1e18};
  ros::Time first_;
  std::unique_ptr<gsv::OfflineRun> run_;
  std::size_t refused_ = 0;
  std::string first_refusal_;
  Drive drive_;
};

std::string format(const char* pattern, double a, double b) {
  char text[128];
  std::snprintf(text, sizeof text, pattern, a, b);
  return text;
}

std::string inDegrees(const std::optional<gsv::HeightCalibration::Estimate>& angle) {
  if (!angle) return "not known, the drive is too short";
  return format("%.2f deg ± %.2f (95 %%)", kDeg * angle->value, kDeg * angle->error95());
}

/// Where the camera is on a base_link that stands on the road below it, looking ahead.
std::string mounting(const gsv::HeightCalibration::Result& result) {
  if (!result.pitch) return {};
  // Columns are the base's axes in the camera: up is the road's normal, ahead the optical axis.
  const double p = result.pitch->value, r = result.roll->value;
  const Eigen::Vector3d up(-std::sin(r), -std::cos(r) * std::cos(p), -std::cos(r) * std::sin(p));
  const Eigen::Vector3d ahead =
      (Eigen::Vector3d::UnitZ() - up.dot(Eigen::Vector3d::UnitZ()) * up).normalized();
  Eigen::Matrix3d R_c_b;
  R_c_b << ahead, up.cross(ahead), up;
  Eigen::Quaterniond q(R_c_b.transpose());
  if (q.w() < 0) q.coeffs() *= -1;  // of the two that say the same
  char text[160];
  std::snprintf(text, sizeof text, "0 0 %.3f %.5f %.5f %.5f %.5f", result.height.value, q.x(),
                q.y(), q.z(), q.w());
  return text;
}

std::string yaml(const gsv::HeightCalibration::Result& result, const std::string& how) {
  std::ostringstream text;
  const auto& height = result.height;
  text << "# " << how << '\n'
       << format("camera_height: %.4f  # [m] ± %.4f (95 %%)", height.value, height.error95())
       << format(", %.2f %%", 100 * height.error95() / height.value, 0) << '\n'
       << "# How the camera is mounted; the odometry finds it by itself.\n"
       << "# pitch: " << inDegrees(result.pitch) << ", positive looks down\n"
       << "# roll: " << inDegrees(result.roll) << ", positive: the right of the camera is lower\n";
  if (const std::string place = mounting(result); !place.empty()) {
    text << "# base_link on the road below the camera, looking ahead as it does:\n"
         << "# rosrun tf2_ros static_transform_publisher " << place << " base_link CAMERA_FRAME\n";
  }
  return text.str();
}

void print(const gsv::HeightCalibration::Result& result) {
  std::size_t used = 0;
  if (!result.segments.empty()) {
    std::printf("%8s %8s %10s %10s\n", "from s", "to s", "way m", "height m");
    const std::int64_t start = result.segments.front().from_ns;
    for (const auto& segment : result.segments) {
      used += segment.used;
      std::printf("%8.1f %8.1f %10.1f %10.3f%s\n",
                  1e-9 * static_cast<double>(segment.from_ns - start),
                  1e-9 * static_cast<double>(segment.to_ns - start), segment.way_h * segment.height,
                  segment.height, segment.used ? "" : "  left out");
    }
    std::printf("%zu of %zu segments\n", used, result.segments.size());
  }
}

void run(const Arguments& arguments) {
  if (fs::exists(arguments.out) && !arguments.force) {
    throw gsv::DataError(arguments.out + " exists already; --force writes over it");
  }
  if (const fs::path folder = fs::path(arguments.out).parent_path();
      !folder.empty() && !fs::is_directory(folder)) {
    throw gsv::DataError(folder.string() + " is no folder");
  }
  if (!arguments.trajectory.empty() && !fs::is_regular_file(arguments.trajectory)) {
    throw gsv::DataError(arguments.trajectory + ": no such file");
  }
  cv::setNumThreads(1);
  const Drive drive = arguments.bag.empty() ? runSequence(arguments) : BagDrive::run(arguments);
  const gsv::HeightCalibration calibration({});
  gsv::HeightCalibration::Result result;
  std::string how;
  if (arguments.length) {
    result = calibration.fromLength(drive.record, kNominalHeight, *arguments.length,
                                    *arguments.length_sigma);
    how = format("From a drive of %g m, read to %g m.", *arguments.length, *arguments.length_sigma);
  } else if (!arguments.gps.empty()) {
    result = calibration.fromPositions(drive.record, kNominalHeight, drive.fixes, drive.fix_sigma);
    how = "From the fixes on " + arguments.gps + ".";
  } else {
    result =
        calibration.fromPositions(drive.record, kNominalHeight,
                                  gsv::readTruePositions(arguments.trajectory, drive.stamps_ns), 0);
    how = "From the trajectory " + arguments.trajectory + ".";
  }
  print(result);
  if (result.status != gsv::HeightCalibration::Status::kOk) throw gsv::DataError(result.reason);
  const std::string text = yaml(result, how);
  gsv::writeFile(arguments.out, text);
  std::printf("%swritten to %s\n", text.c_str(), arguments.out.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("height_from_drive", kUsage, argc, argv, parseArguments, run);
}
