#pragma once

#include <cstdint>

#include "ground_scale_vo/common/options.hpp"

namespace gsv {

// The options of ScaleRecovery and its stages. Lengths ending in _heights are in camera heights.
// Their ranges are checked once, by ScaleRecoveryOptions::validate().

/// [m] range of the camera height above the road.
constexpr double kMinCameraHeight = 0.05, kMaxCameraHeight = 100;
/// Of a camera on a road vehicle; others need ScaleRecoveryOptions::unusual_height.
constexpr double kMinUsualHeight = 0.2, kMaxUsualHeight = 5;
/// Relative standard deviation of a camera height that was measured with care.
constexpr double kUsualHeightSigma = 0.01;

/// The average of the camera's mounting.
struct MountingOptions {
  double initial_pitch_sigma = 0.1;
  double pitch_motion_sigma = 0.012;
  double heave_sigma_heights = 0.02;
  double chord_length_heights = 3;
  double max_tilt_rad = 0.5;
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("initial_pitch_sigma", self.initial_pitch_sigma, 1e-4, 1,
          "[rad] standard deviation of the initial pitch, which is zero");
    visit("pitch_motion_sigma", self.pitch_motion_sigma, 1e-4, 1,
          "[rad] standard deviation of the vehicle's pitch against the road (braking, crests)");
    visit("heave_sigma_heights", self.heave_sigma_heights, 1e-5, 1,
          "[camera heights] standard deviation of the vertical motion against the road between the "
          "ends of a chord");
    visit("chord_length_heights", self.chord_length_heights, 0.01, 1000,
          "[camera heights] length of the chord that defines the direction of motion");
    visit("max_tilt_rad", self.max_tilt_rad, 0.001, 0.8, "[rad] bound of pitch and roll");
  }
};

/// GPE (Alg. 1).
struct GroundPointExtractionOptions {
  // Region of interest on the expected plane. It depends on the pixel's ray alone and never on
  // the depth of a point, so it does not bias the depth.
  double max_ahead_heights = 25.0;
  double lane_half_width_heights = 1.2;
  double max_half_width_heights = 4.0;
  int min_lane_features = 15;

  double motion_tolerance_rad = 0.12;
  double pitch_tolerance_rad = 0.12;
  int min_points = 6;
  double plane_threshold_heights = 0.006;  ///< the paper's 0.01 m over 1.65 m
  double plane_threshold_sigma = 2.0;
  bool frame_pitch_test = false;  ///< theta_1 on the pitch of T_{t,t-1}, as printed (line 10)
  bool most_inliers = false;

  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("max_ahead_heights", self.max_ahead_heights, 1, 10000,
          "[camera heights] far end of the region of interest");
    visit("lane_half_width_heights", self.lane_half_width_heights, 0.01, 1000,
          "[camera heights] half width of the region while it contains min_lane_features");
    visit("max_half_width_heights", self.max_half_width_heights, 0.01, 1000,
          "[camera heights] half width of the region otherwise");
    visit("min_lane_features", self.min_lane_features, 0, 1e6,
          "[features] number that is enough for the narrow region");
    visit("motion_tolerance_rad", self.motion_tolerance_rad, 1e-4, 1.6,
          "[rad] theta_2 of Alg. 1: largest |90 deg - angle(n, t)| of a triangle");
    visit("pitch_tolerance_rad", self.pitch_tolerance_rad, 1e-4, 1.6,
          "[rad] theta_1 of Alg. 1: largest pitch of a triangle, and pitch and roll of the plane, "
          "against the road; three standard deviations of the prior are added in quadrature");
    visit("min_points", self.min_points, 3, 1e6,
          "[points] least number of ground points (Alg. 1 line 18)");
    visit("plane_threshold_heights", self.plane_threshold_heights, 1e-6, 1,
          "[camera heights] d_thresh of Alg. 1: inlier distance from the plane");
    visit("plane_threshold_sigma", self.plane_threshold_sigma, 0, 100,
          "[sigma] multiple of the relative depth error of a point that is added to "
          "plane_threshold_heights in quadrature");
    visit("frame_pitch_test", self.frame_pitch_test,
          "[] theta_1 tests the pitch between two frames (Alg. 1 line 10), not the triangles");
    visit("most_inliers", self.most_inliers,
          "[] RANSAC by the number of inliers (Alg. 1), not by the distance (Eq. 4)");
  }
};

/// The plane through the points of GPA.
struct PlaneFitOptions {
  /// Roads fall off towards the gutter and pavements are higher, so the ground beside the vehicle
  /// is tilted against the ground below it. This enters the height's standard deviation alone: in
  /// the fit, points on both sides constrain each other.
  double camber_sigma_rad = 0.03;
  /// Eq. 6 and 7 as printed, without prior or PCL: the eigenvector of the smallest eigenvalue of Q,
  /// the sum of p p^T over the homogeneous points. The common weight of Eq. 8 has no effect.
  bool homogeneous = false;
  double reject_distance_heights = 0.006;  ///< of the homogeneous fit
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("camber_sigma_rad", self.camber_sigma_rad, 1e-9, 1,
          "[rad] standard deviation of the cross slope beside the vehicle against that below it");
    visit("homogeneous", self.homogeneous,
          "[] the fit of Eq. 6 and 7 as printed, without prior and PCL");
    visit("reject_distance_heights", self.reject_distance_heights, 1e-6, 1,
          "[camera heights] largest distance of an inlier of the homogeneous fit");
  }
};

/// GPA (Alg. 2).
struct GroundPointAggregationOptions {
  double window_heights = 3.0;
  int max_frames = 60;
  /// A map point has one error however often it is seen; its copies are not independent.
  bool unique_features = true;
  PlaneFitOptions fit;
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("window_heights", self.window_heights, 0, 1e6,
          "[camera heights] length of the window, as distance travelled");
    visit("max_frames", self.max_frames, 1, 1e6, "[frames] in the window at most (Alg. 2 line 8)");
    visit("unique_features", self.unique_features,
          "[] a feature seen in several frames counts once, with its newest point");
  }
};

/// Direct measurements.
struct DirectPlaneEstimatorOptions {
  // Lane region and patches.
  double max_ahead_heights = 10;
  double lane_half_width_heights = 1.0;  ///< the own lane; kerbs and pavements lie higher
  double patch_size = 0.03;              ///< [focal lengths]
  double baseline_heights = 0.7;

  // Noise model.
  double roughness_heights = 0.005;
  double curvature_sigma = 1e-3;  ///< [1 / camera height]
  double lens_k1_sigma = 0.02;
  double lens_k2_sigma = 0.01;
  double rotation_sigma_rad = 7e-5;
  double direction_sigma_rad = 1e-3;

  // Acceptance.
  double min_correlation = 0.8;

  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("max_ahead_heights", self.max_ahead_heights, 1.5, 1000,
          "[camera heights] far end of the lane region; at least 6 beyond the road at the lower "
          "image border");
    visit("lane_half_width_heights", self.lane_half_width_heights, 0.01, 1000,
          "[camera heights] half width of the lane region");
    visit("patch_size", self.patch_size, 1e-3, 1, "[focal lengths] side of a patch");
    visit("baseline_heights", self.baseline_heights, 0.01, 100,
          "[camera heights] distance to the first reference image; the second is twice as far");
    visit("roughness_heights", self.roughness_heights, 1e-6, 1,
          "[camera heights] standard deviation of the road surface; limits the weight of a patch");
    visit("curvature_sigma", self.curvature_sigma, 1e-9, 1,
          "[1/camera height] standard deviation of the road's vertical curvature");
    visit("lens_k1_sigma", self.lens_k1_sigma, 1e-9, 1,
          "[] standard deviation of the radial distortion (k1) that the calibration has left");
    visit("lens_k2_sigma", self.lens_k2_sigma, 1e-9, 1, "[] the same of k2");
    visit("rotation_sigma_rad", self.rotation_sigma_rad, 1e-9, 1,
          "[rad] standard deviation of the odometry's rotation between two images");
    visit("direction_sigma_rad", self.direction_sigma_rad, 1e-9, 1,
          "[rad] standard deviation of the odometry's direction of motion between two images");
    visit("min_correlation", self.min_correlation, 0, 1,
          "[] least accepted mean correlation of the patches");
  }
};

/// The filter of the camera height.
struct ScaleFilterOptions {
  double correlation_heights = 5;
  double drift_per_k1_sigma = 2.5;
  double kerb_sigma = 0.02;
  double nis_memory_heights = 20;

  double start_tilt_sigma_rad = 0.007;
  double start_tilt_per_rad = 0.1;

  int moving_average_frames = 0;  ///< replaces the Kalman filter by a moving average of the scale
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("correlation_heights", self.correlation_heights, 0, 1e6,
          "[camera heights] correlation length of the errors of one source");
    visit(
        "drift_per_k1_sigma", self.drift_per_k1_sigma, 0, 100,
        "[] random walk of ln h over one radian of rotation, per standard deviation of k1: a wrong "
        "lens changes the unit of the map in turns");
    visit("kerb_sigma", self.kerb_sigma, 0, 1,
          "[] standard deviation of the kerb: of ln of the height above the ground beside the "
          "lane by that above the lane");
    visit("nis_memory_heights", self.nis_memory_heights, 0.1, 1e6,
          "[camera heights] averaging length of the NIS that scales sigma");
    visit("start_tilt_sigma_rad", self.start_tilt_sigma_rad, 0, 1,
          "[rad] standard deviation of the tilt of a young map");
    visit("start_tilt_per_rad", self.start_tilt_per_rad, 0, 10,
          "[] the same, in addition, per rotation up to the first measurement");
    visit("moving_average_frames", self.moving_average_frames, 0, 1e6,
          "[frames] moving average of the scale instead of the Kalman filter; 0: off");
  }
};

/// Metric poses and their covariance.
struct MetricTrajectoryOptions {
  // Errors of the calibration and rectification of real cameras; rendered ones have none.
  double rotation_sigma_per_sqrt_m = 0.0005;
  double rotation_scale_sigma = 0.01;
  double direction_sigma = 0.005;
  double scale_correlation_m = 10.0;
  double young_map_heights = 10;
  double bridge_acceleration_sigma = 2.0;
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("rotation_sigma_per_sqrt_m", self.rotation_sigma_per_sqrt_m, 0, 1,
          "[rad/sqrt(m)] random walk of the rotation, in addition to the errors of the poses");
    visit("rotation_scale_sigma", self.rotation_scale_sigma, 0, 1,
          "[] relative standard deviation of the angle of a rotation, from errors of the camera "
          "calibration");
    visit("direction_sigma", self.direction_sigma, 0, 1,
          "[rad] standard deviation of the direction of motion between two frames, in addition to "
          "the errors of the poses");
    visit("scale_correlation_m", self.scale_correlation_m, 1e-3, 1e6,
          "[m] correlation length of the errors of the scale and of the angle of rotation");
    visit("young_map_heights", self.young_map_heights, 0, 1e6,
          "[camera heights] length of a new map up to which its motion is rescaled with the "
          "newest scale");
    visit("bridge_acceleration_sigma", self.bridge_acceleration_sigma, 0, 100,
          "[m/s^2] standard deviation of the acceleration between two maps");
  }
};

/// Of ScaleRecovery with all its stages.
struct ScaleRecoveryOptions {
  /// h* above the road [m]; 0: not known, which needs use_speed.
  double camera_height = 0;
  double camera_height_sigma = -1;  ///< [m] negative: kUsualHeightSigma
  bool unusual_height = false;      ///< camera_height may be any
  bool use_speed = false;           ///< addSpeed() will be called
  double speed_sigma = 0.05;
  double speed_scale_sigma = 0;
  std::uint64_t random_seed = 1;
  bool refine = true;   ///< false: no direct measurements
  bool record = false;  ///< for ScaleRecovery::smoothed(); about 2 kB per frame
  double standstill_distance_heights = 0.02;

  MountingOptions mounting;
  GroundPointExtractionOptions gpe;
  GroundPointAggregationOptions gpa;
  DirectPlaneEstimatorOptions direct;
  ScaleFilterOptions filter;
  MetricTrajectoryOptions trajectory;

  /// All of this struct but camera_height, which has no default.
  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("camera_height_sigma", self.camera_height_sigma, -1, 10,
          "[m] standard deviation of camera_height, which speeds then correct; 0: it is exact; "
          "negative: 1 % of it");
    visit("unusual_height", self.unusual_height, "[] confirms a camera_height outside 0.2 to 5 m");
    visit("use_speed", self.use_speed,
          "[] use speeds of the vehicle; camera_height may then be left out");
    visit("speed_sigma", self.speed_sigma, 1e-4, 100,
          "[m/s] standard deviation of a speed that comes without one");
    visit("speed_scale_sigma", self.speed_scale_sigma, 0, 1,
          "[] relative standard deviation of a constant factor of all speeds (wear of tyres)");
    visit("random_seed", self.random_seed, 0, 2147483647,
          "[] seed of the RANSAC over ground points");
    visit("standstill_distance_heights", self.standstill_distance_heights, 0, 1,
          "[camera heights] a shorter motion since the last frame without standstill is "
          "standstill");
    visit("refine", self.refine,
          "[] use direct measurements from the images; false: feature-based only");
  }
  template <typename Self, typename Visit>
  static void visitStages(Self& self, Visit&& visit) {
    visit("", self);
    visit("mounting/", self.mounting);
    visit("gpe/", self.gpe);
    visit("gpa/", self.gpa);
    visit("fit/", self.gpa.fit);
    visit("direct/", self.direct);
    visit("filter/", self.filter);
    visit("trajectory/", self.trajectory);
  }
  /// [m] of camera_height.
  double cameraHeightSigma() const {
    return camera_height_sigma < 0 ? kUsualHeightSigma * camera_height : camera_height_sigma;
  }
  /// Throws OptionError.
  void validate() const;
  /// Throws OptionError if ScaleRecovery::smoothed() is not possible.
  void requireSmoothable() const;
};

}  // namespace gsv
