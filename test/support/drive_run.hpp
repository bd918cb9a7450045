#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {

/// Default options except for the camera height [m].
inline OfflineRun::Options optionsFor(double camera_height) {
  OfflineRun::Options options;
  options.scale.camera_height = camera_height;
  return options;
}

/// The default drive in smaller images of the same field of view, which take a third of the time.
inline SyntheticDrive::Options smallImages() {
  SyntheticDrive::Options options;
  options.camera.width = 480;
  options.camera.height = 150;
  options.camera.fx = options.camera.fy = 278;
  options.camera.cx = 239.5;
  options.camera.cy = 74.5;
  return options;
}

/// The default drive in images of 640x198 and of the same field of view, which take two thirds of
/// the time.
inline SyntheticDrive::Options mediumImages() {
  SyntheticDrive::Options options;
  PinholeCamera& camera = options.camera;
  const double ratio = 640.0 / camera.width;
  camera.width = 640;
  camera.height = 198;
  camera.fx *= ratio;
  camera.fy *= ratio;
  camera.cx = (camera.width - 1) / 2.0;
  camera.cy = (camera.height - 1) / 2.0;
  return options;
}

/// Runs the pipeline over all images of the drive.
inline RunRecord runOffline(const SyntheticDrive& drive, const OfflineRun::Options& options) {
  OfflineRun offline(drive.camera(), options);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    offline.process(drive.image(i), drive.frame(i).stamp_ns);
  }
  return offline.record();
}

/// Ground truth T_c0_c of every frame [m].
inline std::vector<Eigen::Isometry3d> groundTruth(const SyntheticDrive& drive) {
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < drive.size(); ++i) poses.push_back(drive.frame(i).T_c0_c);
  return poses;
}

/// Height of the camera above the road in every frame [m].
inline std::vector<double> groundTruthHeights(const SyntheticDrive& drive) {
  std::vector<double> heights;
  for (std::size_t i = 0; i < drive.size(); ++i) heights.push_back(drive.frame(i).height);
  return heights;
}

/// Distance between the positions of two poses.
inline double distanceBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (b.translation() - a.translation()).norm();
}

}  // namespace ground_scale_vo
