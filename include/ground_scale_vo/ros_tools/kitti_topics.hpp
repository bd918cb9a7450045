#pragma once

#include <string>
#include <vector>

namespace ground_scale_vo {

/// Images of the left grey camera in a bag of kitti2bag: of an odometry sequence (and of
/// kitti_to_bag), of a raw drive, and of either in bags of an older branch.
inline const std::vector<std::string> kKittiImageTopics = {"/kitti/camera_gray_left/image_rect",
                                                           "/kitti/camera_gray_left/image_raw",
                                                           "/kitti/camera_gray_left/image"};
inline constexpr const char* kKittiCameraInfoTopic = "/kitti/camera_gray_left/camera_info";

}  // namespace ground_scale_vo
