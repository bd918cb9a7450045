#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/input/camera.hpp"
#include "support/scene.hpp"
#include "vo/map.hpp"
#include "vo/motion.hpp"

namespace gsv::test {

constexpr double kWallDistance = 20;  // from the camera v [VO units]

/// Image of a wall with a random texture, orthogonal to the z axis of v at z = kWallDistance.
/// repetitions: of the texture over the width of the wall, which is 150 VO units.
inline cv::Mat wallFrom(const PinholeCamera& camera, const Eigen::Isometry3d& T_v_c,
                        std::uint64_t seed = 1, int repetitions = 1) {
  constexpr double kScale = 20;  // [px of the texture per VO unit]
  cv::Mat piece(1200, 3000 / repetitions, CV_8UC1), texture, image;
  cv::RNG(seed).fill(piece, cv::RNG::UNIFORM, 0, 256);
  cv::repeat(piece, 1, repetitions, texture);
  cv::GaussianBlur(texture, texture, {0, 0}, 4);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  const Eigen::Vector3d& t = T_v_c.translation();
  Eigen::Matrix3d M, K;
  M << kScale * (kWallDistance - t.z()), 0, kScale * t.x() + 1500, 0,
      kScale * (kWallDistance - t.z()), kScale * t.y() + 600, 0, 0, 1;
  K << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  const Eigen::Matrix3d H = M * T_v_c.linear() * K.inverse();
  const cv::Matx33d homography(H(0, 0), H(0, 1), H(0, 2), H(1, 0), H(1, 1), H(1, 2), H(2, 0),
                               H(2, 1), H(2, 2));
  cv::warpPerspective(texture, image, homography, {camera.width, camera.height},
                      cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  return image;
}

/// Gives all landmarks of a map that were first observed from v the depth of the wall.
inline void putOnWall(LocalMap* map) {
  for (Landmark& landmark : map->landmarks()) {
    landmark.depth = InverseDepth{1 / kWallDistance, 1e-4};
  }
}

// A camera that approaches the wall, and the time without images that follows.
constexpr std::int64_t kPeriod = 100'000'000;               // of the images [ns]
constexpr std::int64_t kAfterGap = kPeriod + 20 * kPeriod;  // stamp of the next image [ns]
const Eigen::Vector3d kStep(0, 0, 0.15);                    // in each period before it [VO units]

/// Reaches T_w_v with this step [VO units per period], at the stamp kPeriod.
inline MotionModel motionTo(const Eigen::Isometry3d& T_w_v, const Eigen::Vector3d& step = kStep) {
  MotionModel motion({0, T_w_v * pose({0, 0, 0}, -step)});
  motion.update({kPeriod, T_w_v});
  return motion;
}

}  // namespace gsv::test
