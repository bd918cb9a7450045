#include "ground_scale_vo/ros_tools/bag_source.hpp"

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

namespace ground_scale_vo {
namespace {

/// Assumed standard deviation of a fix relative to its neighbours where the receiver reports none
/// [m].
constexpr double kDefaultFixSigma = 2.5;

/// An open bag, whose errors are DataErrors that name it.
class BagFile {
 public:
  explicit BagFile(const std::string& file) : name_(file) {
    guard([&] { openBag(file, &bag_); });
  }

  template <typename Use>
  void guard(const Use& use) const {
    try {
      use();
    } catch (const rosbag::BagException& error) {
      throw DataError(unreadableBag(name_, error));
    }
  }

  const rosbag::Bag& bag() const { return bag_; }

  /// The messages of a topic. Throws DataError when there is none.
  std::unique_ptr<rosbag::View> view(const std::vector<std::string>& spellings,
                                     const std::string& topic, const std::string& what) const {
    auto view = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(spellings));
    if (!spellings.empty() && view->size() > 0) return view;
    std::set<std::string> topics;  // each one has a connection for every publisher
    for (const auto* connection : rosbag::View(bag_).getConnections()) {
      topics.insert(connection->topic);
    }
    std::string held;
    for (const std::string& name : topics) held += (held.empty() ? "" : ", ") + name;
    throw DataError("the bag " + name_ + " has no " + what + " on " + topic + "; it holds " +
                    (held.empty() ? "nothing" : held));
  }

 private:
  const std::string name_;
  rosbag::Bag bag_;
};

class BagImages : public ImageSource {
 public:
  BagImages(std::shared_ptr<BagFile> bag, const std::vector<std::string>& spellings,
            const std::string& topic)
      : bag_(std::move(bag)),
        topic_(topic),
        view_(bag_->view(spellings, topic, "images")),
        count_(view_->size()) {
    at_ = view_->begin();
  }

  const std::string& name() const override { return topic_; }
  std::size_t count() const override { return count_; }
  bool zeroIsUnset() const override { return true; }

  std::optional<StoredImage> next() override {
    if (at_ == view_->end()) return std::nullopt;
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
        stored->pixels = decodePixels(
            {reinterpret_cast<const char*>(compressed->data.data()), compressed->data.size()});
        stored->encoding = bayerPatternOf(compressed->format);
      } else {
        stored->error = "it is a message of the type " + instance.getDataType();
      }
    } catch (const DataError& error) {
      stored->error = error.what();
    }
  }

  const std::shared_ptr<BagFile> bag_;
  const std::string topic_;
  const std::unique_ptr<rosbag::View> view_;
  const std::size_t count_;
  rosbag::View::iterator at_;
};

DriveReader::Calibration calibrationIn(const BagFile& bag, const BagInput& input,
                                       const std::string& image_topic, std::string* warning) {
  const std::string topic =
      input.camera_info.empty() ? cameraInfoTopicOf(image_topic) : input.camera_info;
  std::string reason = "no message on " + topic + " is a camera_info";
  const auto infos = bag.view(spellingsOf(topic), topic, "camera_info");
  for (const rosbag::MessageInstance& instance : *infos) {
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

std::vector<std::string> spellingsOf(const std::string& topic) {
  const std::string name = topic.substr(std::min(topic.find_first_not_of('/'), topic.size()));
  return {"/" + name, name};
}

std::vector<std::string> imageTopics(const std::vector<const rosbag::Bag*>& bags,
                                     const std::string& topic) {
  for (const std::string& name : {topic, topic + "/compressed"}) {
    std::vector<std::string> found;
    for (const rosbag::Bag* bag : bags) {
      rosbag::View view(*bag, rosbag::TopicQuery(spellingsOf(name)));
      for (const rosbag::ConnectionInfo* connection : view.getConnections()) {
        const std::string& type = connection->datatype;
        if (type == "sensor_msgs/Image" || type == "sensor_msgs/CompressedImage") {
          found.push_back(connection->topic);
        }
      }
    }
    if (!found.empty()) return found;
  }
  return {};
}

void openBag(const std::string& file, rosbag::Bag* bag) {
  if (!std::filesystem::is_regular_file(file)) throw DataError("there is no bag " + file);
  const std::string type = std::filesystem::path(file).extension();
  if (type == ".mcap" || type == ".db3") requireNoBag(file);
  bag->open(file, rosbag::bagmode::Read);
}

std::string unreadableBag(const std::string& file, const std::exception& error) {
  const std::string reason = error.what();
  if (dynamic_cast<const rosbag::BagUnindexedException*>(&error) != nullptr ||
      reason.rfind("Error reading from file", 0) == 0) {
    return "the bag " + file + " has no index, because its recording or copy was not completed: " +
           "run rosbag reindex '" + file + "'";
  }
  return "the bag " + file + " cannot be read: " + reason;
}

std::unique_ptr<DriveReader> openBag(const BagInput& input) {
  const auto bag = std::make_shared<BagFile>(input.bag);
  const std::vector<std::string> spellings = imageTopics({&bag->bag()}, input.image);
  const std::string topic = spellings.empty() ? input.image : spellings.front();
  auto images = std::make_unique<BagImages>(bag, spellings, topic);
  std::string warning;
  const DriveReader::Calibration calibration =
      input.camera_file.empty()
          ? calibrationIn(*bag, input, topic, &warning)
          : DriveReader::Calibration{readCameraFile(input.camera_file), input.camera_file};
  auto drive = std::make_unique<DriveReader>(std::move(images), calibration, input.options);
  if (!warning.empty()) drive->warn(warning);
  return drive;
}

BagFixes readFixes(const std::string& file, const std::string& topic) {
  const BagFile bag(file);
  BagFixes result;
  std::vector<Eigen::Vector3d> positions;
  std::vector<double> sigmas;
  std::size_t messages = 0;
  const auto messages_on_topic = bag.view(spellingsOf(topic), topic, "fixes");
  for (const rosbag::MessageInstance& instance : *messages_on_topic) {
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
