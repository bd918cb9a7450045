// Evaluates the nodelets over a bag: poses, scale and metrics from the bag that bag.launch
// recorded.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <limits>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/run_failure.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros_tools/bag_topics.hpp"
#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"
#include "ros/odometry_output.hpp"
#include "support/command_line.hpp"

namespace {

/// Longest part of the images after the end of the ground truth that is left out.
const ros::Duration kMaxMissingEnd(0.5);

using Names = std::vector<std::string>;
using Bags = std::vector<const rosbag::Bag*>;

struct Arguments {
  Names played;
  std::string recorded, out, image;
  std::vector<std::size_t> images;
  double camera_height = 0;

  void check() const {
    if (recorded.empty() && images.empty()) throw gsv::OptionError("--recorded BAG is missing");
  }
};

std::string joined(const Names& names, const char* separator) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : separator) + name;
  return text;
}

/// Calls read(rosbag::MessageInstance) for each message of the bags on topics_of(bags), in the
/// order of their time. Throws DataError.
template <typename TopicsOf, typename Read>
void forEachMessage(const Names& files, const TopicsOf& topics_of, const Read& read) {
  std::string reading;
  try {
    std::list<rosbag::Bag> opened;
    Bags bags;
    for (const std::string& file : files) {
      reading = file;
      gsv::openBag(file, &opened.emplace_back());
      bags.push_back(&opened.back());
    }
    reading = joined(files, " ");
    const rosbag::TopicQuery query(topics_of(bags));
    rosbag::View view;
    for (const rosbag::Bag* bag : bags) view.addQuery(*bag, query);
    for (const rosbag::MessageInstance& instance : view) read(instance);
  } catch (const gsv::DataError&) {  // from read()
    throw;
  } catch (const std::exception& error) {  // from rosbag, or for an invalid or truncated message
    throw gsv::DataError(gsv::unreadableBag(reading, error));
  }
}

/// A stamp, and how often the clock has jumped back before it, as in a looped bag.
using PassStamp = std::pair<int, ros::Time>;

/// The pass of the messages of one topic, in their order.
class PassCounter {
 public:
  PassStamp add(const ros::Time& stamp) {
    if ((last_ - stamp).toSec() > gsv::StampFilter::kDefaultClockJump) ++pass_;
    last_ = stamp;
    return {pass_, stamp};
  }

 private:
  int pass_ = 0;
  ros::Time last_;
};

/// The frames and the ground truth of the played bag.
struct Played {
  std::vector<std_msgs::Header> images;
  std::vector<PassStamp> stamps;  ///< of the images
  gsv::GroundTruthTf ground_truth;
};

using GreyOf = std::function<cv::Mat()>;  ///< throws DataError

/// on_image: is called with each image, after it is appended to played->images.
void readPlayed(
    const Arguments& arguments, Played& played,
    const std::function<void(const GreyOf& grey)>& on_image = [](const GreyOf&) {}) {
  const Names wanted = arguments.image.empty() ? gsv::kKittiImageTopics : Names{arguments.image};
  const auto topics_of = [&](const Bags& bags) {
    Names topics;
    const auto append = [&](const Names& names) {
      topics.insert(topics.end(), names.begin(), names.end());
    };
    for (const std::string& name : wanted) append(gsv::imageTopics(bags, name));
    for (const char* name : {"/tf", "/tf_static"}) append(gsv::spellingsOf(name));
    return topics;
  };
  const std::string bag = "the bag " + joined(arguments.played, " ");
  std::string found;
  gsv::GreyConverter converter;
  forEachMessage(arguments.played, topics_of, [&](const rosbag::MessageInstance& instance) {
    const std::string topic = gsv::spellingsOf(instance.getTopic())[0];
    if (const auto tf = instance.instantiate<tf2_msgs::TFMessage>()) {
      return played.ground_truth.add(*tf, topic == "/tf_static");
    }
    if (const auto image = instance.instantiate<sensor_msgs::Image>()) {
      played.images.push_back(image->header);
      on_image([&] { return converter.convert(gsv::fromMsg(*image)); });
    } else if (const auto compressed = instance.instantiate<sensor_msgs::CompressedImage>()) {
      played.images.push_back(compressed->header);
      on_image([&] {
        return converter.convert(gsv::decode(*compressed), gsv::bayerPatternOf(compressed->format));
      });
    } else {
      return;
    }
    if (found.empty()) found = topic;
    if (found != topic) {
      throw gsv::DataError(bag + " has images on " + found + " and " + topic +
                           ": choose one with --image");
    }
  });
  if (played.images.empty()) {
    throw gsv::DataError(bag + " has no image on " + joined(wanted, " or "));
  }
  PassCounter pass;
  for (const std_msgs::Header& image : played.images) {
    played.stamps.push_back(pass.add(image.stamp));
  }
}

/// The output of the nodelets, by stamp.
struct Recorded {
  /// Times of a frame [ms] in the nodelets; diagnostics report that of about one frame per second.
  struct Times {
    double vo = std::numeric_limits<double>::quiet_NaN(), scale = vo;
  };
  std::map<PassStamp, gsv::ScaleEstimateMsg::ConstPtr> scales;
  std::map<PassStamp, nav_msgs::OdometryConstPtr> metric, unscaled;
  std::map<PassStamp, Times> times;
  std::string wrong_input;  ///< the last sentence of the nodelets about it; empty: none
};

/// True when the message has the time of the scale stage.
bool readDiagnostics(const diagnostic_msgs::DiagnosticArray& diagnostics, Recorded::Times* times,
                     std::string* wrong_input) {
  bool has_scale = false;
  const auto endsWith = [](const std::string& text, const std::string& end) {
    return text.size() >= end.size() &&
           text.compare(text.size() - end.size(), end.size(), end) == 0;
  };
  for (const diagnostic_msgs::DiagnosticStatus& status : diagnostics.status) {
    if (endsWith(status.name, ": odometry")) wrong_input->clear();
    for (const diagnostic_msgs::KeyValue& value : status.values) {
      if (value.key == "wrong input") *wrong_input = value.value;
      if (value.key != "time of the last frame [ms]") continue;
      const auto ms = gsv::parseNumber<double>(value.value);
      if (!ms) continue;
      if (endsWith(status.name, ": odometry")) times->vo = *ms;
      if (endsWith(status.name, ": scale")) {
        times->scale = *ms;
        has_scale = true;
      }
    }
  }
  return has_scale;
}

void readRecorded(const Arguments& arguments, Recorded& recorded) {
  Recorded::Times times;  // of both nodelets, which report them at different moments
  PassCounter of_scales, of_metric, of_unscaled;
  const auto all = [](const Bags& bags) {
    Names topics;
    for (const auto* connection : rosbag::View(*bags[0]).getConnections()) {
      topics.push_back(connection->topic);
    }
    return topics;
  };
  forEachMessage({arguments.recorded}, all, [&](const rosbag::MessageInstance& instance) {
    if (const auto scale = instance.instantiate<gsv::ScaleEstimateMsg>()) {
      gsv::fromMsg(*scale);  // throws on invalid values
      recorded.scales[of_scales.add(scale->header.stamp)] = scale;
    } else if (const auto diagnostics = instance.instantiate<diagnostic_msgs::DiagnosticArray>()) {
      if (readDiagnostics(*diagnostics, &times, &recorded.wrong_input) &&
          !recorded.scales.empty()) {
        recorded.times[recorded.scales.rbegin()->first] = times;
        times = {};
      }
    } else if (const auto odometry = instance.instantiate<nav_msgs::Odometry>()) {
      const std::string& topic = instance.getTopic();
      const bool is_unscaled =
          topic.size() >= 11 && topic.substr(topic.size() - 11) == "vo/odometry";
      gsv::fromMsg(odometry->pose.pose);
      const PassStamp stamp = (is_unscaled ? of_unscaled : of_metric).add(odometry->header.stamp);
      (is_unscaled ? recorded.unscaled : recorded.metric)[stamp] = odometry;
    }
  });
}

/// A pose in camera axes (z forward, y down); T_a_b is in body axes (x forward, z up) unless
/// is_camera.
Eigen::Isometry3d inCameraAxes(const Eigen::Isometry3d& T_a_b, bool is_camera) {
  if (is_camera) return T_a_b;
  Eigen::Isometry3d T_body_optical = Eigen::Isometry3d::Identity();
  T_body_optical.linear() = gsv::bodyFromOptical();
  return T_body_optical.inverse() * T_a_b * T_body_optical;
}

/// The covariance of position and rotation, of a message, in other axes.
gsv::Matrix6d rotatedCovariance(const Eigen::Matrix3d& R,
                                const boost::array<double, 36>& row_major) {
  gsv::Matrix6d J = gsv::Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = R;
  return J * Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(row_major.data()) *
         J.transpose();
}

/// The outputs of both stages for the image with this stamp, as far as they were recorded. An image
/// without vo/odometry counts as LOST, also when the odometry was INITIALISING. An image without
/// scale has the map of the next image with one, or of the last.
void restoreOutputs(const Recorded& recorded, const PassStamp& stamp,
                    gsv::VisualOdometry::Output* vo, gsv::ScaleRecovery::Output* scale) {
  const auto times = recorded.times.find(stamp);
  const Recorded::Times measured =
      times != recorded.times.end() ? times->second : Recorded::Times();
  vo->times.total = measured.vo;
  scale->times.total = measured.scale;
  vo->frame.stamp_ns = gsv::toNanoseconds(stamp.second);
  vo->frame.status = gsv::VoStatus::kLost;
  if (!recorded.scales.empty()) {
    auto estimate = recorded.scales.lower_bound(stamp);
    if (estimate == recorded.scales.end()) --estimate;
    if (estimate->first == stamp) scale->scale = gsv::fromMsg(*estimate->second);
    vo->frame.map_id = estimate->second->map_id;
  }
  const auto unscaled = recorded.unscaled.find(stamp);
  if (unscaled != recorded.unscaled.end()) {
    vo->frame.status = gsv::VoStatus::kTracking;
    vo->frame.T_w_c = gsv::fromMsg(unscaled->second->pose.pose);
  }
}

/// Why no image has a metric pose. With a scale, the frame_id of the images is empty or the
/// transform of the mounting is missing.
std::string reasonForNoPose(const Arguments& arguments, const Recorded& recorded) {
  const gsv::ScaleEstimateMsg* known = nullptr;
  for (const auto& [stamp, scale] : recorded.scales) {
    if (scale->status != gsv::ScaleEstimateMsg::UNKNOWN) known = scale.get();
  }
  const std::string no_pose = "no image of " + joined(arguments.played, " ") +
                              " has a metric pose in " + arguments.recorded;
  if (known == nullptr) return no_pose + ": the scale was never known";
  if (known->header.frame_id.empty()) {
    return no_pose + ", although the scale is known: the frame_id of the images is empty";
  }
  return no_pose + ", although the scale is known: tf had no transform from the base frame to " +
         known->header.frame_id +
         " (/tf of a bag is used as ground truth only: the mounting must be on /tf_static)";
}

/// Prints how many images gave a result. Returns the index of the first image with a metric pose.
/// Throws DataError when there is none.
std::size_t firstMetricFrame(const Arguments& arguments, const Played& played,
                             const Recorded& recorded) {
  std::size_t first = 0, scales = 0;
  for (const PassStamp& stamp : played.stamps) scales += recorded.scales.count(stamp);
  while (first < played.stamps.size() && recorded.metric.count(played.stamps[first]) == 0) ++first;
  const bool any = first < played.images.size();
  std::printf(
      "%zu images in, %zu frames out of both nodelets, %zu lost on the way; %s\n",
      played.images.size(), scales, played.images.size() - scales,
      any ? ("first metric pose at frame " + std::to_string(first)).c_str() : "no metric pose");
  if (!any) throw gsv::DataError(reasonForNoPose(arguments, recorded));
  return first;
}

/// One past the last image to evaluate, of which the first one is given: the ground truth of a
/// recording may end a little earlier than its images.
std::size_t endOfEvaluation(const Played& played, const std::string& frame, std::size_t first) {
  const std::size_t images = played.images.size();
  std::size_t end = images;
  while (end > 0 && !played.ground_truth.pose(frame, played.images[end - 1].stamp)) --end;
  if (end == images || end <= first) return images;
  if (played.images.back().stamp - played.images[end - 1].stamp > kMaxMissingEnd) return images;
  std::printf("the ground truth ends before the last %zu images, which are not evaluated\n",
              images - end);
  return end;
}

void reportInconsistentScale(const gsv::RunRecord& record,
                             const std::vector<Eigen::Isometry3d>& ground_truth) {
  const gsv::ScaleMetrics metrics =
      gsv::computeScaleMetrics(record, ground_truth, gsv::kMeasuredGroundTruthDistance);
  if (metrics.within_2_sigma != 0) return;  // also NaN: the drive is too short
  std::fprintf(
      stderr,
      "in no frame is the scale within two standard deviations of the ground truth, median "
      "error %+.1f %%: check camera_height, camera_info and image_is_rectified\n",
      metrics.error_median_percent);
}

/// The images from the first one with a metric pose on, and the ground truth of them all; else
/// none.
struct Restored {
  gsv::RunRecord record;
  std::vector<Eigen::Isometry3d> ground_truth;
};

Restored restore(const Played& played, const Recorded& recorded, std::size_t first) {
  const auto& first_odometry = *recorded.metric.at(played.stamps[first]);
  const bool is_camera =
      first_odometry.child_frame_id == gsv::withoutLeadingSlashes(played.images[first].frame_id);
  Eigen::Isometry3d T_b0_odom = gsv::fromMsg(first_odometry.pose.pose).inverse();
  Eigen::Isometry3d T_odom_start = Eigen::Isometry3d::Identity();  // of the base
  if (is_camera) T_odom_start.linear() = gsv::bodyFromOptical();
  Eigen::Isometry3d T_b0_b = Eigen::Isometry3d::Identity();
  std::optional<Eigen::Isometry3d> T_b0_root;
  double distance_sigma = 0;
  Eigen::Vector3d last_position = Eigen::Vector3d::Zero();
  Restored restored;
  const std::size_t end = endOfEvaluation(played, first_odometry.child_frame_id, first);
  for (std::size_t i = first; i < end; ++i) {
    const PassStamp& stamp = played.stamps[i];
    // The nodelets were reset: the path goes on with the first image of the new trajectory.
    if (i > first && stamp.first != played.stamps[i - 1].first) {
      T_b0_odom = T_b0_b * T_odom_start.inverse();
    }
    gsv::VisualOdometry::Output vo;
    gsv::ScaleRecovery::Output scale;
    vo.frame.sequence = static_cast<std::uint32_t>(i - first);
    restoreOutputs(recorded, stamp, &vo, &scale);
    const auto metric = recorded.metric.find(stamp);
    if (metric != recorded.metric.end()) {
      T_b0_b = T_b0_odom * gsv::fromMsg(metric->second->pose.pose);
      Eigen::Matrix3d R_o_odom = T_b0_odom.linear();
      if (!is_camera) R_o_odom = gsv::bodyFromOptical().transpose() * R_o_odom;
      scale.pose.emplace();
      scale.pose->T_o_c = inCameraAxes(T_b0_b, is_camera);
      scale.pose->covariance = rotatedCovariance(R_o_odom, metric->second->pose.covariance);
      // The message has none: an upper bound, as if the error of the scale were the same
      // throughout.
      const Eigen::Vector3d position = scale.pose->T_o_c.translation();
      if (scale.scale.scale > 0) {
        distance_sigma += (position - last_position).norm() * scale.scale.sigma / scale.scale.scale;
      }
      last_position = position;
      scale.pose->distance_sigma = distance_sigma;
    }
    restored.record.append(vo, scale);

    const auto T_root_b = played.ground_truth.pose(first_odometry.child_frame_id, stamp.second);
    if (!T_root_b) continue;
    if (!T_b0_root) T_b0_root = T_root_b->inverse();
    restored.ground_truth.push_back(inCameraAxes(*T_b0_root * *T_root_b, is_camera));
  }
  const std::size_t known = restored.ground_truth.size(), frames = restored.record.frames().size();
  if (known != frames) {
    if (known > 0) {
      std::printf("the ground truth covers only %zu of %zu frames and is ignored\n", known, frames);
    }
    restored.ground_truth.clear();
  }
  return restored;
}

/// The images with these numbers that can be decoded, as DIR/NUMBER.png.
int writeImages(const Arguments& arguments) {
  gsv::makeFolder(arguments.out);
  Played played;
  readPlayed(arguments, played, [&](const GreyOf& grey) {
    const std::size_t number = played.images.size() - 1;
    const auto& wanted = arguments.images;
    if (std::find(wanted.begin(), wanted.end(), number) == wanted.end()) return;
    try {
      gsv::writeFile(std::filesystem::path(arguments.out) / (std::to_string(number) + ".png"),
                     gsv::encodePng(grey()));
    } catch (const gsv::DataError& error) {
      std::fprintf(stderr, "image %zu: %s\n", number, error.what());
    }
  });
  return 0;
}

int evaluate(const Arguments& arguments) {
  Played played;
  readPlayed(arguments, played);
  Recorded recorded;
  readRecorded(arguments, recorded);
  const std::size_t first = firstMetricFrame(arguments, played, recorded);
  const Restored restored = restore(played, recorded, first);
  gsv::writeRun(arguments.out, restored.record, arguments.camera_height, restored.ground_truth);
  if (!restored.ground_truth.empty()) {
    reportInconsistentScale(restored.record, restored.ground_truth);
  }
  std::string failure = recorded.wrong_input;
  const std::size_t images = played.images.size(), processed = recorded.scales.size();
  if (failure.empty() &&
      static_cast<double>(processed) < (1 - gsv::kMaxLeftOut) * static_cast<double>(images)) {
    failure = gsv::format(
        "only %zu of %zu images could be used: warnings of the nodelets say which are refused, or "
        "the machine is too slow",
        processed, images);
  }
  if (failure.empty()) failure = gsv::failureOf(restored.record);
  const nlohmann::ordered_json json = {{"failure", failure}, {"first_image", first}};
  gsv::writeFile(std::filesystem::path(arguments.out) / "run.json", json.dump(2) + "\n");
  if (!failure.empty()) throw gsv::DataError(failure);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line(
      "evaluate_bag",
      "Compares the output of both nodelets over a bag with the bag's own ground truth.",
      "The nodelets publish no metric pose before the first scale, so the files begin at the "
      "first\n"
      "frame with a metric pose; its number is printed. Poses are those of the published frame, "
      "in\n"
      "camera axes (x right, y down, z forward).\n\n"
      "Exit status: 0 done, 1 the data cannot be used, or the files are written, but are no result "
      "(the reason is printed), 2 the arguments cannot be used.");
  command_line.options().add_options()  //
      ("played", gsv::requiredValue(&arguments.played, "BAG...")->multitoken(),
       "the bag that was played, or its parts: its images define the frames, its tf is the ground "
       "truth")  //
      ("recorded", gsv::po::value(&arguments.recorded)->value_name("BAG"),
       "the bag that bag.launch record:=BAG wrote: scale, odometry, vo/odometry, /diagnostics")  //
      ("out", gsv::requiredValue(&arguments.out, "DIR"),
       "gets the files of run_sequence: poses.txt, poses_unscaled.txt, trajectory_tum.txt, "
       "scale.csv, timing.csv, metrics.json, run.json, ground_truth.txt")  //
      ("camera-height",
       gsv::po::value(&arguments.camera_height)->value_name("M")->notifier([](double height) {
         gsv::requireInRange("--camera-height", height, gsv::kMinCameraHeight,
                             gsv::kMaxCameraHeight);
       }),
       "[m] as it was given to the launch file; without: none, but a speed")  //
      ("image", gsv::topicValue(&arguments.image),
       "image topic of the played bag (default: image_rect, image_raw or image of "
       "/kitti/camera_gray_left)")  //
      ("images", gsv::po::value(&arguments.images)->multitoken()->value_name("N..."),
       "only writes the images of the played bag with these numbers, from 0, to DIR/N.png");
  return command_line.run(
      argc, argv, [&] { arguments.check(); },
      [&] { return arguments.images.empty() ? evaluate(arguments) : writeImages(arguments); });
}
