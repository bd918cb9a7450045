#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <atomic>
#include <boost/make_shared.hpp>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "ground_scale_vo/ros/conversions.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {

/// The camera messages of a rendered drive; each image is rendered once. change: applied to each
/// image, may be empty.
class RenderedDrive {
 public:
  explicit RenderedDrive(const SyntheticDrive::Options& options,
                         const std::string& frame_id = "camera",
                         const std::function<cv::Mat(const cv::Mat&)>& change = {})
      : drive_(options), frame_id_(frame_id) {
    for (std::size_t i = 0; i < drive_.size(); ++i) {
      images_.push_back(change ? change(drive_.image(i)) : drive_.image(i));
    }
  }

  std::size_t size() const { return drive_.size(); }
  const SyntheticDrive& drive() const { return drive_; }
  const SyntheticDrive::Frame& frame(std::size_t i) const { return drive_.frame(i); }
  const cv::Mat& grey(std::size_t i) const { return images_[i]; }

  sensor_msgs::Image::Ptr image(std::size_t i, const ros::Time& stamp) const {
    return toMsg(images_[i], sensor_msgs::image_encodings::MONO8, header(stamp));
  }
  sensor_msgs::CameraInfo::Ptr info(const ros::Time& stamp) const {
    auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(drive_.camera()));
    info->header = header(stamp);
    return info;
  }

 private:
  std_msgs::Header header(const ros::Time& stamp) const {
    std_msgs::Header header;
    header.stamp = stamp;
    header.frame_id = frame_id_;
    return header;
  }

  SyntheticDrive drive_;
  const std::string frame_id_;
  std::vector<cv::Mat> images_;
};

/// A drive with images of 400 x 124, which take a quarter of the time of the default size.
inline SyntheticDrive::Options smallDrive(int frames, double camera_height = 1.65) {
  SyntheticDrive::Options options;
  options.frames = frames;
  options.camera_height = camera_height;
  options.camera = halved(options.camera);
  return options;
}

/// Publishes the drive again and again on `image` and `camera_info`, at about 100 images per
/// second.
class RepeatingCamera {
 public:
  explicit RepeatingCamera(const RenderedDrive& drive)
      : images_(handle_.advertise<sensor_msgs::Image>("image", 10)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 10)),
        thread_([this, &drive] {
          for (std::size_t n = 0; !stop_; ++n) {
            const ros::Time stamp(1000 + 0.1 * static_cast<double>(n));
            infos_.publish(drive.info(stamp));
            images_.publish(drive.image(n % drive.size(), stamp));
            ros::WallDuration(0.01).sleep();  // the camera's rate
          }
        }) {}
  ~RepeatingCamera() {
    stop_ = true;
    thread_.join();
  }

 private:
  ros::NodeHandle handle_;
  ros::Publisher images_, infos_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace ground_scale_vo
