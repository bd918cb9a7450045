#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/lens/lens_refinement.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace gsv {

/// VisualOdometry on images as they come: removes their distortion, and refines the lens while
/// driving.
///
/// When LensRefinement finds a better lens, a second odometry starts with images undistorted by it.
/// Once that has a map of its own, it replaces the first one at a keyframe: it continues from the
/// pose of the first one in its unit of length, so frames before and after belong to the same map.
/// Only the features have new ids, and VoFrame::camera changes.
///
/// Deterministic unless LensRefinement::Options says otherwise. Not thread safe.
class SelfCalibratingOdometry {
 public:
  struct Options {
    VisualOdometry::Options vo;
    bool refine_camera = true;
    LensRefinement::Options refinement;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("refine_camera", self.refine_camera,
            "[] estimate what the calibration has left of the lens error while driving, and remove "
            "it from the images");
    }
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      VisualOdometry::Options::visitStages(self.vo, visit);
      visit("", self);
      LensEstimator::Options::visitStages(self.refinement.estimator, visit);
    }
  };

  struct Output : VisualOdometry::Output {
    CameraImage image;  ///< rectified, of frame.camera; its pixels are the given image's data
                        ///< if that has no distortion
  };

  /// camera and mask: of the images as they come, as for Undistortion. Throws OptionError.
  SelfCalibratingOdometry(const CameraCalibration& camera, const Options& options,
                          const cv::Mat& mask = {});
  ~SelfCalibratingOdometry();

  /// The next image of the drive, 8-bit, one channel, the camera's size (throws OptionError
  /// otherwise). Precondition: stamps increase.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

  /// Lens of the images as they come, as used in the last frame. Its covariance is zero before the
  /// first change.
  const LensEstimate& lens() const;

  /// LensRefinement::contradiction(), and finalContradiction().
  const std::string& lensContradiction() const;
  std::string finalLensContradiction();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gsv
