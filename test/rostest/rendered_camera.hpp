#pragma once

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <functional>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/calibrated_camera.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {

/// The camera messages of a rendered drive; each image is rendered once. start_s: stamp of the
/// first image [s]. change: applied to each image, may be empty.
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

  std_msgs::Header header(std::size_t i, double start_s) const {
    std_msgs::Header header;
    header.stamp = ros::Time(start_s) + ros::Duration().fromNSec(drive_.frame(i).stamp_ns);
    header.frame_id = frame_id_;
    return header;
  }
  sensor_msgs::Image::Ptr image(std::size_t i, double start_s) const {
    return cv_bridge::CvImage(header(i, start_s), sensor_msgs::image_encodings::MONO8, images_[i])
        .toImageMsg();
  }
  sensor_msgs::CameraInfo::Ptr info(std::size_t i, double start_s) const {
    auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(drive_.camera()));
    info->header = header(i, start_s);
    return info;
  }

 private:
  SyntheticDrive drive_;
  const std::string frame_id_;
  std::vector<cv::Mat> images_;
};

/// A drive with images of 400 x 124, which take a quarter of the time of the default size.
inline SyntheticDrive::Options smallDrive(int frames, double camera_height = 1.65) {
  SyntheticDrive::Options options;
  options.frames = frames;
  options.camera_height = camera_height;
  options.camera.width /= 2;
  options.camera.height /= 2;
  options.camera.fx /= 2;
  options.camera.fy /= 2;
  options.camera.cx = (options.camera.cx - 0.5) / 2;
  options.camera.cy = (options.camera.cy - 0.5) / 2;
  return options;
}

}  // namespace ground_scale_vo
