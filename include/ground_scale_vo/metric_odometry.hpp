#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"

namespace gsv {

/// The whole pipeline without ROS: images in, metric poses out. It runs the two stages of
/// the nodelets one after the other for every image.
///
///     PinholeCamera camera{1241, 376, 718.9, 718.9, 607.2, 185.2};  // width height fx fy cx cy
///     MetricOdometry::Options options;
///     options.scale.camera_height = 1.65;  // [m] above the road
///     MetricOdometry odometry(camera, options);
///     const MetricOdometry::Output output = odometry.process(image, stamp_ns);
///     if (output.pose()) use(output.pose()->T_o_c, output.pose()->covariance);
///
/// Causal (a pose never uses later images) and deterministic (the same images give the same bytes).
/// Not thread safe; instances are independent.
class MetricOdometry {
 public:
  struct Options {
    SelfCalibratingOdometry::Options odometry;
    ScaleRecovery::Options scale;  ///< scale.camera_height [m] is required without scale.use_speed
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      SelfCalibratingOdometry::Options::visitStages(self.odometry, visit);
      ScaleRecovery::Options::visitStages(self.scale, visit);
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Output {
    SelfCalibratingOdometry::Output vo;  ///< features, and the pose up to scale
    ScaleRecovery::Output scale;         ///< scale, ground plane and metric pose

    /// kInitialising: no map or no scale yet, which needs motion and a visible road, or the pose of
    /// this frame is refused (MeasurementStatus::kImplausibleMotion). kTracking: pose() is valid.
    /// kLost: tracking resumes by itself, in the same map or in a new one.
    VoStatus status() const;
    /// Metric pose with covariance, velocity and distance; empty unless it is tracking.
    const std::optional<MetricPose>& pose() const { return scale.pose; }
  };

  /// camera: of the images as they come; their distortion is removed. mask: 8-bit, one channel, of
  /// their size; 0 where they never show the scene (own vehicle, watermark); empty: no such region.
  /// Throws OptionError.
  MetricOdometry(const CameraCalibration& camera, const Options& options, const cv::Mat& mask = {});
  /// For images without distortion.
  MetricOdometry(const PinholeCamera& camera, const Options& options, const cv::Mat& mask = {})
      : MetricOdometry(withoutDistortion(camera), options, mask) {}

  /// Processes the next image of the drive. image: 8-bit, one channel, the camera's size (throws
  /// OptionError otherwise). stamp_ns: [ns]; greater than for the previous image.
  Output process(const cv::Mat& image, std::int64_t stamp_ns);

  /// The next image is of another camera, or does not continue the ones before it: a new map starts
  /// with it, whose rotation against them is not known. The path goes on. Throws OptionError.
  void changeCamera(const CameraCalibration& camera);

  /// ScaleRecovery::addSpeed(); needs scale.use_speed.
  void addSpeed(const SpeedSample& speed) { scale_.addSpeed(speed); }

  /// ScaleRecovery::smoothed(); needs scale.record.
  std::vector<ScaleRecovery::Smoothed> smoothed() const { return scale_.smoothed(); }

  /// SelfCalibratingOdometry::lens().
  const LensEstimate& lens() const { return vo_->lens(); }
  std::string finalLensContradiction() { return vo_->finalLensContradiction(); }

 private:
  const SelfCalibratingOdometry::Options options_;
  const cv::Mat mask_;
  std::unique_ptr<SelfCalibratingOdometry> vo_;
  std::uint32_t first_sequence_ = 0, first_map_ = 0;  ///< of vo_, in the numbers that are reported
  std::uint32_t next_sequence_ = 0, last_map_ = 0;
  ScaleRecovery scale_;
};

}  // namespace gsv
