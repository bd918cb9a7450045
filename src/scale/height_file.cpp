#include "scale/height_file.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "common/text.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "scale/road.hpp"

namespace ground_scale_vo {

std::string heightYaml(const std::string& source, const Interval95& height) {
  return "# From " + source + ".\n" +
         format("camera_height: %.4f  # [m] ± %.4f (95 %%), %.2f %%\n", height.value, height.error,
                100 * height.error / height.value) +
         "# The mounting of the camera, for tf; the scale does not need it.\n";
}

std::string mountingComments(double height, const Interval95& pitch, const Interval95& roll) {
  const auto degrees = [](const Interval95& angle) {
    return format("%.2f ± %.2f (95 %%) deg", kDegreesPerRadian * angle.value,
                  kDegreesPerRadian * angle.error);
  };
  const Eigen::Matrix3d R_b_c = roadAxes(roadNormal(pitch.value, roll.value)).transpose();
  return "# pitch: " + degrees(pitch) + ", positive looks down\n# roll: " + degrees(roll) +
         ", positive: the right of the camera is lower\n# A base_link on the road below the camera "
         "that faces as the camera does, with yaw, pitch and roll:\n" +
         format(
             "# rosrun tf2_ros static_transform_publisher 0 0 %.3f %.5f %.5f %.5f base_link "
             "CAMERA_FRAME\n",
             height, std::atan2(R_b_c(1, 0), R_b_c(0, 0)), -std::asin(R_b_c(2, 0)),
             std::atan2(R_b_c(2, 1), R_b_c(2, 2)));
}

}  // namespace ground_scale_vo
