#pragma once

#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/Marker.h>

#include <Eigen/Core>
#include <map>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

/// Messages that are only looked at.
namespace ground_scale_vo {

/// Draws the corners of a frame and their way since the frames drawn before.
class TrackPainter {
 public:
  /// grey: the rectified image of the frame. Green: has a map point; yellow: none yet. The tail
  /// is the way since the frame drawn last.
  sensor_msgs::Image::Ptr paint(const cv::Mat& grey, const VoFrame& frame,
                                const std_msgs::Header& header);

 private:
  std::map<std::uint64_t, Eigen::Vector2f> last_;
};

/// x, y, z [float32] in the header's frame.
sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header);

/// The map points that a frame sees, in its camera frame, VO units.
sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header);

/// The ground plane below and before the camera as a translucent quad (id 0) with its normal as an
/// arrow from the camera's foot up to the camera (id 1), in metres in the camera's frame.
/// Precondition: scale.status is not kUnknown.
std::vector<visualization_msgs::Marker::Ptr> toPlaneMarkers(const ScaleEstimate& scale,
                                                            const std_msgs::Header& header);

}  // namespace ground_scale_vo
