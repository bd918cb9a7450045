#pragma once

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/sanitizer.hpp"

namespace gsv {

/// Default options except for the camera height [m].
inline OfflineRun::Options optionsFor(double camera_height) {
  OfflineRun::Options options;
  options.scale.camera_height = camera_height;
  return options;
}
/// The same with an exact height: standard deviations without its share.
inline OfflineRun::Options withExactHeight(double camera_height) {
  OfflineRun::Options options = optionsFor(camera_height);
  options.scale.camera_height_sigma = 0;
  return options;
}

/// The default drive in images of this size. f: focal length [px].
inline SyntheticDrive::Options withImages(int width, int height, double f) {
  SyntheticDrive::Options options;
  options.camera = {width, height, f, f, (width - 1) / 2.0, (height - 1) / 2.0};
  return options;
}
/// The same field of view in a third of the time.
inline SyntheticDrive::Options smallImages() { return withImages(480, 150, 278); }
/// The same field of view in two thirds of the time.
inline SyntheticDrive::Options mediumImages() { return withImages(640, 198, 371.2); }

/// Wider images are reduced with a sanitizer [px].
constexpr int kMaxSanitizedWidth = 500;

/// With a sanitizer, the rule for drives with large images: all frames, in images of half the width
/// and height and of the same field of view. Memory errors and data races do not depend on the size
/// of the images, but accuracy does: tests check thresholds of accuracy only where this is false.
inline bool isReduced(const SyntheticDrive::Options& drive) {
  return kSanitized && drive.camera.width > kMaxSanitizedWidth;
}

/// The same field of view in half of the width and height.
inline PinholeCamera halved(PinholeCamera camera) {
  camera.width /= 2;
  camera.height /= 2;
  camera.fx /= 2;
  camera.fy /= 2;
  camera.cx = (camera.cx + 0.5) / 2 - 0.5;
  camera.cy = (camera.cy + 0.5) / 2 - 0.5;
  return camera;
}

/// The drive to run: see isReduced().
inline SyntheticDrive::Options reducedDrive(SyntheticDrive::Options drive) {
  if (isReduced(drive)) drive.camera = halved(drive.camera);
  return drive;
}

/// Runs the pipeline over all images of the drive.
inline RunRecord runOffline(const SyntheticDrive& drive, const OfflineRun::Options& options) {
  OfflineRun offline(drive.camera(), options);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    offline.process(drive.image(i), drive.frame(i).stamp_ns);
  }
  return offline.record();
}

/// Distance between the positions of two poses.
inline double distanceBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (b.translation() - a.translation()).norm();
}

/// The image with another focal length.
inline cv::Mat zoomed(const cv::Mat& image, const PinholeCamera& camera, double zoom) {
  const cv::Matx23d A(zoom, 0, (1 - zoom) * camera.cx, 0, zoom, (1 - zoom) * camera.cy);
  cv::Mat result;
  cv::warpAffine(image, result, A, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return result;
}

}  // namespace gsv
