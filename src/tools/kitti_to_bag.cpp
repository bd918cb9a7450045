// A KITTI folder (odometry layout or raw synced drive) as a bag.

#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"
#include "progress_line.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: kitti_to_bag SEQ --out FILE [--start N] [--end N] [--style native|kitti2bag]

Writes the grey images of a KITTI folder, their camera_info and, where there is one, the ground
truth to a bag. Topics are those of kitti2bag: /kitti/camera_gray_left/image and /camera_info.

  SEQ            KITTI odometry folder (image_0/, calib.txt, times.txt, and ground truth poses.txt
                 or ../../poses/NN.txt) or KITTI raw synced drive (image_00/, and oxts/)
  --out FILE     the bag; there is nothing under this name until it is complete
  --start N      first frame (default 0)
  --end N        last frame (default: the sequence's last)
  --style S      native: K and P filled, ground truth on /tf as
                 ground_truth -> ground_truth/camera_gray_left (default);
                 kitti2bag: as kitti2bag writes an odometry sequence: K zero, P filled,
                 ground truth on /tf as camera_init -> camera_gray_left

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.
)";

constexpr const char* kImageTopic = "/kitti/camera_gray_left/image";
constexpr const char* kCameraInfoTopic = "/kitti/camera_gray_left/camera_info";
constexpr const char* kTfTopic = "/tf";

// KITTI's odometry stamps start at 0, which ROS takes for "no stamp": the bag starts later.
constexpr std::int64_t kFirstStampNs = 1000000000;

enum class Style { kNative, kKitti2bag };

struct Arguments {
  std::filesystem::path sequence, out;
  std::size_t start = 0;
  std::size_t end = static_cast<std::size_t>(-1);  ///< included
  Style style = Style::kNative;
};

/// Throws OptionError.
std::size_t parseFrame(const std::string& option, const std::string& text) {
  if (text.empty() || text.size() > 9 || text.find_first_not_of("0123456789") != text.npos) {
    throw gsv::OptionError(option + " is '" + text + "', it must be a frame number");
  }
  return static_cast<std::size_t>(std::stoul(text));
}

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] {
      if (++i == argc) throw gsv::OptionError(argument + " needs a value");
      return std::string(argv[i]);
    };
    if (argument == "--out") {
      arguments.out = value();
    } else if (argument == "--start") {
      arguments.start = parseFrame(argument, value());
    } else if (argument == "--end") {
      arguments.end = parseFrame(argument, value());
    } else if (argument == "--style") {
      const std::string style = value();
      if (style != "native" && style != "kitti2bag") {
        throw gsv::OptionError("--style is '" + style + "', it must be native or kitti2bag");
      }
      arguments.style = style == "native" ? Style::kNative : Style::kKitti2bag;
    } else if (argument.size() > 1 && argument.front() == '-') {
      throw gsv::OptionError(argument + " is not an option, see --help");
    } else if (!arguments.sequence.empty()) {
      throw gsv::OptionError("one sequence at a time, not " + arguments.sequence.string() +
                             " and " + argument);
    } else {
      arguments.sequence = argument;
    }
  }
  if (arguments.sequence.empty()) throw gsv::OptionError("SEQ is missing, see --help");
  if (arguments.out.empty()) throw gsv::OptionError("--out is missing, see --help");
  if (arguments.end < arguments.start) throw gsv::OptionError("--end lies before --start");
  return arguments;
}

/// The bag under a temporary name beside the final one. Unless commit() is called nothing stays.
class PendingBag {
 public:
  explicit PendingBag(std::filesystem::path final_name)
      : final_(std::move(final_name)),
        temporary_(final_.string() + ".tmp"),
        bag_(std::make_unique<rosbag::Bag>()) {
    bag_->open(temporary_.string(), rosbag::bagmode::Write);
  }
  ~PendingBag() {
    if (committed_) return;
    try {
      bag_->close();
    } catch (const std::exception&) {
      // On a full disk. Its destructor would try again, throw again and so end the process: the
      // bag is left to the end of the process, and what it has written is removed all the same.
      static rosbag::Bag* left = nullptr;
      left = bag_.release();
      static_cast<void>(left);
    }
    std::error_code ignored;
    std::filesystem::remove(temporary_, ignored);
  }
  PendingBag(const PendingBag&) = delete;
  PendingBag& operator=(const PendingBag&) = delete;

  rosbag::Bag& bag() { return *bag_; }
  void commit() {
    bag_->close();
    std::filesystem::rename(temporary_, final_);
    committed_ = true;
  }

 private:
  const std::filesystem::path final_, temporary_;
  std::unique_ptr<rosbag::Bag> bag_;
  bool committed_ = false;
};

void convert(const Arguments& arguments) {
  const gsv::KittiSequence sequence(arguments.sequence);
  const std::size_t last = std::min(arguments.end, sequence.size() - 1);
  if (arguments.start > last) {
    throw gsv::DataError(arguments.sequence.string() + " has frames 0 to " +
                         std::to_string(sequence.size() - 1) + ", --start is " +
                         std::to_string(arguments.start));
  }
  const bool native = arguments.style == Style::kNative;
  const std::string camera_frame = "camera_gray_left";
  const std::int64_t shift =
      sequence.stampNs(0) < kFirstStampNs ? kFirstStampNs - sequence.stampNs(0) : 0;

  if (static_cast<double>(sequence.stampNs(last) + shift) > gsv::kLatestStamp * 1e9) {
    throw gsv::DataError(arguments.sequence.string() +
                         ": its stamps reach beyond those that a bag knows");
  }

  sensor_msgs::CameraInfo info = gsv::toCameraInfo(sequence.camera());
  if (!native) info.K.fill(0.0);
  if (!native) info.D.clear();
  geometry_msgs::TransformStamped truth;
  truth.header.frame_id = native ? "ground_truth" : "camera_init";
  truth.child_frame_id = native ? gsv::GroundTruthTf::twinOf(camera_frame) : camera_frame;

  PendingBag pending(arguments.out);
  gsv::ProgressLine progress(sequence.name(), last - arguments.start + 1);
  for (std::size_t i = arguments.start; i <= last; ++i) {
    std_msgs::Header header;
    header.seq = static_cast<std::uint32_t>(i);
    header.stamp = gsv::fromNanoseconds(sequence.stampNs(i) + shift);
    header.frame_id = camera_frame;

    if (!sequence.groundTruth().empty()) {
      truth.header.stamp = header.stamp;
      const geometry_msgs::Pose pose = gsv::toMsg(sequence.groundTruth().at(i));
      truth.transform.translation.x = pose.position.x;
      truth.transform.translation.y = pose.position.y;
      truth.transform.translation.z = pose.position.z;
      truth.transform.rotation = pose.orientation;
      tf2_msgs::TFMessage message;
      message.transforms.push_back(truth);
      pending.bag().write(kTfTopic, header.stamp, message);
    }
    info.header = header;
    pending.bag().write(kCameraInfoTopic, header.stamp, info);
    sensor_msgs::Image image;
    cv_bridge::CvImage(header, sensor_msgs::image_encodings::MONO8, sequence.image(i))
        .toImageMsg(image);
    pending.bag().write(kImageTopic, header.stamp, image);
    progress.step("frames");
  }
  pending.commit();
  std::printf("%s: %zu frames written to %s%s\n", sequence.name().c_str(),
              last - arguments.start + 1, arguments.out.c_str(),
              sequence.groundTruth().empty() ? ", no ground truth" : "");
}

void convertOrSayWhere(const Arguments& arguments) {
  try {
    convert(arguments);
  } catch (const rosbag::BagException& error) {
    throw gsv::DataError(arguments.out.string() + " cannot be written: " + error.what());
  }
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("kitti_to_bag", kUsage, argc, argv, parseArguments, convertOrSayWhere);
}
