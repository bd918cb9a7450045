#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/input/camera_info.hpp"
#include "ground_scale_vo/input/grey_converter.hpp"

// Conversions between messages of cameras and the types of input/.
namespace ground_scale_vo {

/// Refers to the message's data.
RawImage fromMsg(const sensor_msgs::Image& image);
CameraInfo fromMsg(const sensor_msgs::CameraInfo& info);

/// Copies the pixels. Precondition: 8 or 16 bits, continuous.
sensor_msgs::ImagePtr toMsg(const cv::Mat& pixels, const std::string& encoding,
                            const std_msgs::Header& header);

/// Decodes a JPEG or PNG image without the plugin of image_transport, which Debian lacks. Encoding
/// of the result: the one that `format` names, if it can be that of the decoded pixels, else mono,
/// bgr or bgra of 8 or 16 bits. Throws DataError: decodePixels()'s reasons.
sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& image);

/// camera_info of images with plumb_bob or no distortion.
sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& calibration);
sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera);

}  // namespace ground_scale_vo
