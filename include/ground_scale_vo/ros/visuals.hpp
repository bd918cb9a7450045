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
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

/// Messages that are only looked at.
namespace ground_scale_vo {

/// Draws the tracks of a frame, dots coloured by age (a legend tells it), and what the frame gave
/// up.
class TrackPainter {
 public:
  /// grey: the rectified image of the frame; it is darkened. A filled dot has a map point, a hollow
  /// one none yet; its tail is its way since the image before, if that was drawn. Crosses:
  /// rejected, red an outlier, pink not found.
  sensor_msgs::Image::Ptr paint(const cv::Mat& grey, const VoFrame& frame,
                                const std::vector<RejectedFeature>& rejected,
                                const std_msgs::Header& header);

 private:
  std::uint32_t last_sequence_ = 0;
  std::map<std::uint64_t, Eigen::Vector2f> last_;  ///< pixels of the frame drawn last
};

/// The road as it was measured, over the rectified image of the frame: a grid of metres on the
/// ground plane (green measured, amber held, none while the scale is not known), which lies on the
/// road when the plane is right; green dots are ground points, hollow grey ones other points; and
/// the scale with its status in words.
sensor_msgs::Image::Ptr paintRoad(const cv::Mat& grey, const VoFrame& frame,
                                  const ScaleRecovery::Output& output,
                                  const std_msgs::Header& header);

/// x, y, z [float32] in the header's frame.
sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header);

/// The map points that a frame sees, in its camera frame, in metres with the scale; 1: VO units.
sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header,
                                           double scale = 1);

/// The ground plane below and before the camera as a translucent quad (id 0) with its normal as an
/// arrow from the camera's foot up to the camera (id 1), in metres in the camera's frame.
/// Precondition: scale.status is not kUnknown.
std::vector<visualization_msgs::Marker::Ptr> toPlaneMarkers(const ScaleEstimate& scale,
                                                            const std_msgs::Header& header);

}  // namespace ground_scale_vo
