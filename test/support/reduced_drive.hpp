#pragma once

#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "support/sanitizer.hpp"

namespace ground_scale_vo {

/// Wider images are reduced with a sanitizer [px].
constexpr int kMaxSanitizedWidth = 500;

/// With a sanitizer, the rule for drives with large images: all frames, in images of half the width
/// and height and of the same field of view. Memory errors and data races do not depend on the size
/// of the images, but accuracy does: tests check thresholds of accuracy only where this is false.
inline bool isReduced(const SyntheticDrive::Options& drive) {
  return kSanitized && drive.camera.width > kMaxSanitizedWidth;
}

/// The drive to run: see isReduced().
inline SyntheticDrive::Options reducedDrive(SyntheticDrive::Options drive) {
  if (!isReduced(drive)) return drive;
  PinholeCamera& camera = drive.camera;
  camera.width /= 2;
  camera.height /= 2;
  camera.fx /= 2;
  camera.fy /= 2;
  camera.cx = (camera.cx + 0.5) / 2 - 0.5;
  camera.cy = (camera.cy + 0.5) / 2 - 0.5;
  return drive;
}

}  // namespace ground_scale_vo
