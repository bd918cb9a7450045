#include "ground_scale_vo/ros_tools/bag_drive.hpp"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/NavSatFix.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/ros/compressed_image.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/image_rectifier.hpp"
#include "ground_scale_vo/ros/rectification_check.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/ros_tools/bag_topics.hpp"

namespace ground_scale_vo {
namespace {

/// Assumed standard deviation of a fix relative to its neighbours where the receiver reports none
/// [m].
constexpr double kDefaultFixSigma = 2.5;

/// [s] A longer step of the stamps is accepted when a second image confirms it.
constexpr double kMaxPause = 10;

class BagRunner {
 public:
  using OnFrame = std::function<void(const RunFrame&, std::size_t)>;

  BagRunner(const BagDrive::Source& source, const OfflineRun::Options& options)
      : source_(source), options_(options), rectifier_(source.rectified, "", source.camera_file) {
    openBag(source.bag, &bag_);
  }

  BagDrive run(const OnFrame& on_frame) {
    const std::vector<std::string> topics = imageTopics({&bag_}, source_.image);
    if (topics.empty()) throw DataError(missing(source_.image, "images"));
    const std::string& image = topics[0];
    if (source_.camera_file.empty()) acceptCalibration(image);
    if (!source_.gps.empty()) readFixes();
    rosbag::View view(bag_, rosbag::TopicQuery(topics));
    findFirst(view);
    for (const rosbag::MessageInstance& instance : view) {
      if (const RunFrame* frame = process(instance)) on_frame(*frame, view.size());
    }
    if (!run_) {
      throw DataError("no image on " + image + " could be used" +
                      (drive_.rejected_images > 0 ? ": " + drive_.first_rejection : std::string()));
    }
    drive_.record = run_->record();
    return std::move(drive_);
  }

 private:
  std::string missing(const std::string& topic, const std::string& what) {
    std::set<std::string> topics;  // each one has a connection for every publisher
    for (const auto* connection : rosbag::View(bag_).getConnections()) {
      topics.insert(connection->topic);
    }
    std::string held;
    for (const std::string& name : topics) held += (held.empty() ? "" : ", ") + name;
    return "the bag " + source_.bag + " has no " + what + " on " + topic + "; it holds " +
           (held.empty() ? "nothing" : held);
  }

  /// Uses the first valid calibration for the whole bag.
  void acceptCalibration(const std::string& image_topic) {
    std::string reason = missing(source_.camera_info, "camera_info");
    for (const rosbag::MessageInstance& instance :
         rosbag::View(bag_, rosbag::TopicQuery(spellingsOf(source_.camera_info)))) {
      const auto info = instance.instantiate<sensor_msgs::CameraInfo>();
      if (!info) continue;
      try {
        rectifier_.setCameraInfo(*info, source_.camera_info);
      } catch (const MessageError& error) {
        reason = error.what();
        continue;
      }
      return checkRectification(*info, image_topic);
    }
    throw DataError(reason);
  }

  void checkRectification(const sensor_msgs::CameraInfo& info, const std::string& image_topic) {
    const auto [reason, is_certain] =
        rectificationContradiction(info, source_.rectified, image_topic);
    if (reason.empty()) return;
    const std::string sentence = source_.rectified
                                     ? image_topic + " is used with --rectified, but " + reason +
                                           ": omit --rectified if the images are raw"
                                     : image_topic + " is used without --rectified, but " + reason +
                                           ": add --rectified if the images are rectified";
    if (is_certain) throw DataError(sentence);
    drive_.rectification_warning = sentence;
  }

  /// The first image is the first one whose stamp is not later than the next one: a single wrong
  /// stamp at the beginning must not put the drive before it.
  void findFirst(rosbag::View& view) {
    for (const rosbag::MessageInstance& instance : view) {
      const auto image = instance.instantiate<sensor_msgs::Image>();
      const auto compressed = instance.instantiate<sensor_msgs::CompressedImage>();
      if (!image && !compressed) continue;
      const ros::Time stamp = image ? image->header.stamp : compressed->header.stamp;
      if (stamp.isZero()) continue;
      if (!first_.isZero() && stamp >= first_) return;
      first_ = stamp;
    }
  }

  /// Returns null for an image that is not used.
  const RunFrame* process(const rosbag::MessageInstance& instance) {
    sensor_msgs::ImageConstPtr image = instance.instantiate<sensor_msgs::Image>();
    const auto compressed = instance.instantiate<sensor_msgs::CompressedImage>();
    if (!image && !compressed) return nullptr;
    const std_msgs::Header& header = image ? image->header : compressed->header;
    // Before any check: a trajectory file without stamps has a line for every image of the bag.
    drive_.stamps_ns.push_back(toNanoseconds(header.stamp));
    const double since_first_s = secondsBetween(toNanoseconds(first_), toNanoseconds(header.stamp));
    if (header.stamp == first_) has_begun_ = true;
    try {
      if (since_first_s < 0) {
        throw MessageError("its stamp is earlier than that of the first image");
      }
      if (!has_begun_) throw MessageError("its stamp is later than that of the next image");
      if (since_first_s < source_.from_s || since_first_s > source_.to_s) return nullptr;
      using Verdict = StampGuard::Verdict;
      const Verdict verdict = guard_.check(header.stamp);
      if (verdict == Verdict::kDrop || verdict == Verdict::kHold) {
        throw MessageError(guard_.reason());
      }
      if (!image) image = decode(*compressed);
      const cv::Mat rectified = rectifier_.rectify(*image);
      if (!run_) {
        run_ = std::make_unique<OfflineRun>(rectifier_.camera()->camera(), options_,
                                            rectifier_.mask());
      }
      return &run_->process(rectified, toNanoseconds(header.stamp));
    } catch (const MessageError& error) {
      reject(error.what());
    }
    return nullptr;
  }
  void reject(const std::string& reason) {
    if (drive_.rejected_images++ == 0) drive_.first_rejection = reason;
  }

  void readFixes() {
    std::vector<Eigen::Vector3d> fixes;
    std::vector<double> sigmas;
    std::size_t messages = 0;
    for (const rosbag::MessageInstance& instance :
         rosbag::View(bag_, rosbag::TopicQuery(spellingsOf(source_.gps)))) {
      const auto fix = instance.instantiate<sensor_msgs::NavSatFix>();
      if (!fix) continue;
      ++messages;
      const Eigen::Vector3d position(fix->latitude, fix->longitude,
                                     std::isfinite(fix->altitude) ? fix->altitude : 0);
      const std::int64_t stamp_ns = toNanoseconds(fix->header.stamp);
      const bool is_later = drive_.fixes.empty() || stamp_ns > drive_.fixes.back().stamp_ns;
      if (fix->status.status < sensor_msgs::NavSatStatus::STATUS_FIX || !position.allFinite() ||
          !is_later) {
        continue;
      }
      fixes.push_back(position);
      drive_.fixes.push_back({stamp_ns, Eigen::Vector3d::Zero()});
      const double variance = (fix->position_covariance[0] + fix->position_covariance[4]) / 2;
      const bool is_known =
          fix->position_covariance_type != sensor_msgs::NavSatFix::COVARIANCE_TYPE_UNKNOWN;
      sigmas.push_back(is_known && variance > 0 ? std::sqrt(variance) : kDefaultFixSigma);
    }
    if (messages == 0) throw DataError(missing(source_.gps, "fixes"));
    if (fixes.empty()) {
      throw DataError("none of the " + std::to_string(messages) + " fixes on " + source_.gps +
                      " has a position");
    }
    const std::vector<Eigen::Vector3d> positions = eastNorthUp(fixes);
    for (std::size_t i = 0; i < positions.size(); ++i) drive_.fixes[i].p = positions[i];
    std::nth_element(sigmas.begin(), sigmas.begin() + static_cast<long>(sigmas.size() / 2),
                     sigmas.end());
    drive_.fix_sigma = sigmas[sigmas.size() / 2];
  }

  const BagDrive::Source& source_;
  const OfflineRun::Options& options_;
  rosbag::Bag bag_;
  ImageRectifier rectifier_;
  StampGuard guard_{kMaxPause, false};  ///< drops every backward stamp
  ros::Time first_;                     ///< stamp of the first image
  bool has_begun_ = false;              ///< with that image
  std::unique_ptr<OfflineRun> run_;
  BagDrive drive_;
};

}  // namespace

BagDrive runBagDrive(
    const BagDrive::Source& source, const OfflineRun::Options& options,
    const std::function<void(const RunFrame& frame, std::size_t images)>& on_frame) {
  try {
    return BagRunner(source, options).run(on_frame);
  } catch (const rosbag::BagException& error) {
    throw DataError(unreadableBag(source.bag, error));
  }
}

}  // namespace ground_scale_vo
