#include "ground_scale_vo/ros_tools/bag_source.hpp"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/NavSatFix.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/encoded_image.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/image_message.hpp"

namespace ground_scale_vo {
namespace {

/// Assumed standard deviation of a fix relative to its neighbours where the receiver reports none
/// [m].
constexpr double kDefaultFixSigma = 2.5;

std::string withoutSlash(const std::string& topic) {
  return topic.substr(std::min(topic.find_first_not_of('/'), topic.size()));
}

/// An open bag, whose errors are DataErrors that name it.
class BagFile {
 public:
  explicit BagFile(const std::string& file) : name_(file) {
    if (std::filesystem::path(file).extension() != ".bag") requireNoBag(file);
    if (!std::filesystem::is_regular_file(file)) throw DataError("there is no bag " + file);
    guard([&] { bag_.open(file, rosbag::bagmode::Read); });
  }

  template <typename Use>
  void guard(const Use& use) const {
    try {
      use();
    } catch (const rosbag::BagException& error) {
      throw DataError("the bag " + name_ + " cannot be read: " + error.what());
    }
  }

  const rosbag::Bag& bag() const { return bag_; }

  /// The name in the bag of the first of these topics that it has. Throws DataError.
  std::string find(const std::vector<std::string>& topics, const std::string& what) const {
    const std::set<std::string> all = names();
    for (const std::string& topic : topics) {
      for (const std::string& name : all) {
        if (withoutSlash(name) == withoutSlash(topic)) return name;
      }
    }
    std::string held;
    for (const std::string& name : all) held += (held.empty() ? "" : ", ") + name;
    throw DataError("the bag " + name_ + " has no " + what + " on " + topics.front() +
                    "; it holds " + (held.empty() ? "nothing" : held));
  }

 private:
  std::set<std::string> names() const {
    std::set<std::string> topics;  // each one has a connection for every publisher
    for (const auto* connection : rosbag::View(bag_).getConnections()) {
      topics.insert(connection->topic);
    }
    return topics;
  }

  const std::string name_;
  rosbag::Bag bag_;
};

class BagImages : public ImageSource {
 public:
  BagImages(std::shared_ptr<BagFile> bag, const std::string& topic)
      : bag_(std::move(bag)), topic_(topic), view_(bag_->bag(), rosbag::TopicQuery(topic)), count_(view_.size()) {
    at_ = view_.begin();
  }

  const std::string& name() const override { return topic_; }
  std::size_t count() const override { return count_; }
  bool zeroIsUnset() const override { return true; }

  std::optional<StoredImage> next() override {
    if (at_ == view_.end()) return std::nullopt;
    StoredImage stored;
    bag_->guard([&] { read(*at_, &stored); });
    ++at_;
    return stored;
  }

 private:
  static void read(const rosbag::MessageInstance& instance, StoredImage* stored) {
    try {
      if (const auto image = instance.instantiate<sensor_msgs::Image>()) {
        stored->stamp_ns = toNanoseconds(image->header.stamp);
        const RawImage raw = fromMsg(*image);
        stored->pixels = pixelsOf(raw).clone();  // the message ends here
        stored->encoding = raw.encoding;
      } else if (const auto compressed = instance.instantiate<sensor_msgs::CompressedImage>()) {
        stored->stamp_ns = toNanoseconds(compressed->header.stamp);
        stored->pixels =
            decodePixels({reinterpret_cast<const char*>(compressed->data.data()),
                          compressed->data.size()});
        stored->encoding = encodingOfFormat(compressed->format);
      } else {
        stored->error = "it is a message of the type " + instance.getDataType();
      }
    } catch (const DataError& error) {
      stored->error = error.what();
    }
  }

  const std::shared_ptr<BagFile> bag_;
  const std::string topic_;
  rosbag::View view_;
  const std::size_t count_;
  rosbag::View::iterator at_;
};

DriveReader::Calibration calibrationIn(const BagFile& bag, const BagInput& input,
                                       const std::string& image_topic, std::string* warning) {
  const std::string topic = bag.find(
      {input.camera_info.empty() ? cameraInfoTopicOf(image_topic) : input.camera_info},
      "camera_info");
  std::string reason = "no message on " + topic + " is a camera_info";
  for (const rosbag::MessageInstance& instance :
       rosbag::View(bag.bag(), rosbag::TopicQuery(topic))) {
    const auto info = instance.instantiate<sensor_msgs::CameraInfo>();
    if (!info) continue;
    try {
      const CameraCalibration calibration = calibrationOf(fromMsg(*info), topic, input.rectified);
      *warning = rectificationSentence(fromMsg(*info), input.rectified, image_topic);
      return {calibration, "camera_info on topic " + topic};
    } catch (const DataError& error) {
      reason = error.what();
    }
  }
  throw DataError(reason);
}

}  // namespace

std::unique_ptr<DriveReader> openBag(const BagInput& input) {
  const auto bag = std::make_shared<BagFile>(input.bag);
  const std::string topic = bag->find({input.image, input.image + "/compressed"}, "images");
  std::string warning;
  const DriveReader::Calibration calibration =
      input.camera_file.empty()
          ? calibrationIn(*bag, input, topic, &warning)
          : DriveReader::Calibration{readCameraFile(input.camera_file), input.camera_file};
  auto drive = std::make_unique<DriveReader>(std::make_unique<BagImages>(bag, topic), calibration,
                                             input.options);
  if (!warning.empty()) drive->warn(warning);
  return drive;
}

BagFixes readFixes(const std::string& file, const std::string& topic) {
  const BagFile bag(file);
  const std::string name = bag.find({topic}, "fixes");
  BagFixes result;
  std::vector<Eigen::Vector3d> positions;
  std::vector<double> sigmas;
  std::size_t messages = 0;
  for (const rosbag::MessageInstance& instance :
       rosbag::View(bag.bag(), rosbag::TopicQuery(name))) {
    const auto fix = instance.instantiate<sensor_msgs::NavSatFix>();
    if (!fix) continue;
    ++messages;
    const Eigen::Vector3d position(fix->latitude, fix->longitude,
                                   std::isfinite(fix->altitude) ? fix->altitude : 0);
    const std::int64_t stamp_ns = toNanoseconds(fix->header.stamp);
    const bool is_later = result.fixes.empty() || stamp_ns > result.fixes.back().stamp_ns;
    if (fix->status.status < sensor_msgs::NavSatStatus::STATUS_FIX || !position.allFinite() ||
        !is_later) {
      continue;
    }
    positions.push_back(position);
    result.fixes.push_back({stamp_ns, Eigen::Vector3d::Zero()});
    const double variance = (fix->position_covariance[0] + fix->position_covariance[4]) / 2;
    const bool is_known =
        fix->position_covariance_type != sensor_msgs::NavSatFix::COVARIANCE_TYPE_UNKNOWN;
    sigmas.push_back(is_known && variance > 0 ? std::sqrt(variance) : kDefaultFixSigma);
  }
  if (positions.empty()) {
    throw DataError("none of the " + std::to_string(messages) + " fixes on " + topic +
                    " has a position");
  }
  const std::vector<Eigen::Vector3d> metres = eastNorthUp(positions);
  for (std::size_t i = 0; i < metres.size(); ++i) result.fixes[i].p = metres[i];
  std::nth_element(sigmas.begin(), sigmas.begin() + static_cast<long>(sigmas.size() / 2),
                   sigmas.end());
  result.sigma = sigmas[sigmas.size() / 2];
  return result;
}

}  // namespace ground_scale_vo
