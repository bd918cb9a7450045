#pragma once

#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/Marker.h>

#include <Eigen/Core>
#include <vector>

#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

// Messages for visualisation only.
namespace gsv {

/// Draws the feature tracks of a frame over its image, which is drawn darker, with its masked
/// pixels tinted. Coloured by age: filled dots have a map point, hollow ones do not yet; lines lead
/// to the positions in the previous frame, if that is not null. Red crosses are outliers, pink ones
/// features that were not found.
sensor_msgs::Image::Ptr paintTracks(const CameraImage& image, const VoFrame& frame,
                                    const VoFrame* previous,
                                    const std::vector<RejectedFeature>& rejected,
                                    const std_msgs::Header& header);

/// Draws the estimated ground plane over the image of the frame: a grid of 1 m (green: scale
/// measured, amber: held, none while unknown), ground points (green), other points (hollow grey),
/// and the scale with its status. A correct plane puts the grid on the road.
sensor_msgs::Image::Ptr paintRoad(const CameraImage& image, const VoFrame& frame,
                                  const ScaleRecovery::Output& output,
                                  const std_msgs::Header& header);

/// x, y, z [float32] in the header's frame: the points times the scale.
sensor_msgs::PointCloud2::Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points,
                                           const std_msgs::Header& header, double scale);
/// The same with the map points of a frame in its camera frame.
sensor_msgs::PointCloud2::Ptr toPointCloud(const VoFrame& frame, const std_msgs::Header& header,
                                           double scale);

/// The filtered plane is known: not before the scale, nor while this is from speeds alone.
bool hasGroundPlane(const ScaleEstimate& scale);
/// The ground plane ahead of the camera as a translucent quad, whose z axis is the normal. In
/// metres, in the camera frame. Precondition: hasGroundPlane().
visualization_msgs::Marker::Ptr toPlaneMarker(const ScaleEstimate& scale,
                                              const std_msgs::Header& header);

}  // namespace gsv
