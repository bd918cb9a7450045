// Writes a KITTI folder (odometry layout or raw synced drive) as a bag.

#include <rosbag/bag.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros_tools/bag_topics.hpp"
#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"
#include "support/command_line.hpp"
#include "support/complete_output.hpp"

namespace {

constexpr const char* kTfTopic = "/tf";

// KITTI's odometry stamps start at 0, which ROS takes for "no stamp": the bag starts later.
constexpr std::int64_t kFirstStampNs = 1000000000;

struct Arguments {
  std::string sequence, out;
  bool force = false;
};

/// Opens a bag, and closes it after write(bag).
template <typename Write>
void writeBag(const std::filesystem::path& file, const Write& write) {
  auto bag = std::make_unique<rosbag::Bag>(file.string(), rosbag::bagmode::Write);
  try {
    write(*bag);
    bag->close();
  } catch (...) {
    try {
      bag->close();
    } catch (const std::exception&) {
      // On a full disk close() throws, and the bag's destructor would call it again and terminate
      // the process: leak the bag.
      static rosbag::Bag* leaked = nullptr;
      leaked = bag.release();
      static_cast<void>(leaked);
    }
    throw;
  }
}

/// With the bits and channels of the file.
sensor_msgs::ImagePtr imageOf(const std::filesystem::path& file, const std_msgs::Header& header) {
  const cv::Mat pixels = gsv::readPixels(file);
  const std::string bits = pixels.depth() == CV_16U ? "16" : "8";
  const int channels = pixels.channels();
  return gsv::toMsg(pixels,
                    (channels == 1   ? "mono"
                     : channels == 3 ? "bgr"
                                     : "bgra") +
                        bits,
                    header);
}

/// shift: of the stamps [ns].
void writeMessages(const gsv::KittiSequence& sequence, std::int64_t shift, rosbag::Bag* bag) {
  sensor_msgs::CameraInfo info = gsv::toCameraInfo(sequence.camera());
  info.K.fill(0.0);
  info.D.clear();
  geometry_msgs::TransformStamped ground_truth;
  ground_truth.header.frame_id = "world";
  ground_truth.child_frame_id = "camera_left";

  gsv::ProgressLine progress(sequence.name(), sequence.size());
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    std_msgs::Header header;
    header.seq = static_cast<std::uint32_t>(i);
    header.stamp = gsv::fromNanoseconds(sequence.stampNs(i) + shift);
    header.frame_id = "camera_gray_left";

    if (!sequence.groundTruth().empty()) {
      ground_truth.header.stamp = header.stamp;
      const geometry_msgs::Pose pose = gsv::toMsg(sequence.groundTruth().at(i));
      ground_truth.transform.translation.x = pose.position.x;
      ground_truth.transform.translation.y = pose.position.y;
      ground_truth.transform.translation.z = pose.position.z;
      ground_truth.transform.rotation = pose.orientation;
      tf2_msgs::TFMessage message;
      message.transforms.push_back(ground_truth);
      bag->write(kTfTopic, header.stamp, message);
    }
    info.header = header;
    bag->write(gsv::kKittiCameraInfoTopic, header.stamp, info);
    bag->write(gsv::kKittiImageTopics.front(), header.stamp,
               *imageOf(sequence.files().at(i), header));
    progress.step("frames");
  }
}

void convert(const Arguments& arguments) {
  const gsv::KittiSequence sequence(arguments.sequence);
  const std::int64_t shift =
      sequence.stampNs(0) < kFirstStampNs ? kFirstStampNs - sequence.stampNs(0) : 0;
  if (static_cast<double>(sequence.stamps().back() + shift) > gsv::kLatestStamp * 1e9) {
    throw gsv::DataError(arguments.sequence + ": its stamps exceed those that a bag can hold");
  }
  gsv::writeCompletely(arguments.out, [&](const std::filesystem::path& partial) {
    writeBag(partial, [&](rosbag::Bag& bag) { writeMessages(sequence, shift, &bag); });
  });
  std::printf("%s: %zu frames written to %s%s\n", sequence.name().c_str(), sequence.size(),
              arguments.out.c_str(), sequence.groundTruth().empty() ? ", no ground truth" : "");
}

int run(const Arguments& arguments) {
  gsv::requireNewFile(arguments.out, arguments.force);
  try {
    convert(arguments);
  } catch (const rosbag::BagException& error) {
    throw gsv::DataError(arguments.out + " cannot be written: " + error.what());
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "kitti_to_bag",
      "Writes the images of a KITTI folder, their camera_info and, where there is one, the ground\n"
      "truth to a bag, as kitti2bag writes an odometry sequence: on\n"
      "/kitti/camera_gray_left/image_rect and /camera_info (K zero, P filled), and on /tf as\n"
      "world -> camera_left.",
      "Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.");
  command_line.addPositional("SEQ", "KITTI odometry folder or KITTI raw synced drive",
                             &arguments.sequence);
  command_line.options().add_options()  //
      ("out", gsv::requiredValue(&arguments.out, "FILE"),
       "the bag; no file has this name until it is complete")  //
      ("force", gsv::po::bool_switch(&arguments.force), "replace FILE when it exists");
  return command_line.run(
      argc, argv, [] {}, [&] { return run(arguments); });
}
