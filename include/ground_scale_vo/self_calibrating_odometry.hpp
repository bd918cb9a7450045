#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "ground_scale_vo/lens/lens_refinement.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace ground_scale_vo {

/// VisualOdometry on the images of a camera with distortion, whose lens it refines while driving.
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
    bool refine_camera = false;
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
      visit("lens/", self.refinement.estimator);
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Output : VisualOdometry::Output {
    cv::Mat image;  ///< undistorted, of frame.camera; the given image if that has no distortion
    cv::Mat mask;   ///< of this image; the same cv::Mat while frame.camera is the same
  };

  /// lens: of the given images. mask: of the given images, as for VisualOdometry. Throws
  /// OptionError.
  SelfCalibratingOdometry(const Lens& lens, const Options& options, const cv::Mat& mask = {});
  ~SelfCalibratingOdometry();

  /// The next image of the drive, 8-bit, one channel, the camera's size (throws OptionError
  /// otherwise). Precondition: stamps increase.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

  /// Lens of the given images, as used in the last frame. Its covariance is zero before the first
  /// change.
  const LensEstimate& lens() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
