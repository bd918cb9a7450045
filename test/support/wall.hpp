#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo::test {

/// Image of a wall with a random texture, orthogonal to the z axis of v at z = distance [VO units].
inline cv::Mat wallFrom(const PinholeCamera& camera, const Eigen::Isometry3d& T_v_c,
                        double distance, std::uint64_t seed) {
  constexpr double kScale = 20;  // [px of the texture per VO unit]
  cv::Mat texture(1200, 3000, CV_8UC1), image;
  cv::RNG(seed).fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {0, 0}, 4);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  const Eigen::Vector3d& t = T_v_c.translation();
  Eigen::Matrix3d M, K;
  M << kScale * (distance - t.z()), 0, kScale * t.x() + 1500, 0, kScale * (distance - t.z()),
      kScale * t.y() + 600, 0, 0, 1;
  K << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  const Eigen::Matrix3d H = M * T_v_c.linear() * K.inverse();
  const cv::Matx33d homography(H(0, 0), H(0, 1), H(0, 2), H(1, 0), H(1, 1), H(1, 2), H(2, 0),
                               H(2, 1), H(2, 2));
  cv::warpPerspective(texture, image, homography, {camera.width, camera.height},
                      cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  return image;
}

}  // namespace ground_scale_vo::test
