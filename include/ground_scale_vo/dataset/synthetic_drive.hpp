#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// A rendered drive along a textured street (kerbs, facades, trees, parked and moving cars, curves,
/// a slope, a stop, suspension pitch), with exact poses and exact ground planes. Deterministic.
///
/// The road repeats every 130 m: a curve to the left at 15-55 m, one to the right at 65-105 m; up
/// to 65 m, down again to 130 m (crests of 830 m radius). The camera keeps the middle of the right
/// lane.
class SyntheticDrive {
 public:
  struct Options {
    PinholeCamera camera;         ///< defaults to 800x248, f = 464 px (KITTI's field of view)
    double camera_height = 1.65;  ///< [m] mean height over the road
    double frame_rate_hz = 10.0;
    int frames = 200;
    double speed = 9.0;       ///< cruise [m/s]
    double pitch_rad = 0.02;  ///< mounting, positive looks down
    std::uint64_t random_seed = 1;

    double curvature = 1.0 / 35;  ///< largest, in the middle of a curve [1/m]; 0: a straight road
    double slope = 0.025;         ///< largest rise over run; 0: a flat road
    double stop_s = 2.5;          ///< time at standstill [s]; 0: no stop
    double stop_at_m = 60;        ///< where it stands [m] from the start, along the road
    double suspension = 1;        ///< factor on pitch, roll and bounce; 0: a rigid car
    bool moving_cars = true;      ///< one ahead in the lane, others oncoming
    bool lane_markings = true;
    bool shadows = true;      ///< of trees, houses and cars on the road
    double road_texture = 1;  ///< contrast of the asphalt, its patches and cracks; 0: none
    double noise_sigma = 1;   ///< sensor noise [grey levels]
    int black_first = 0;      ///< first frame of a blinded camera (all zero)
    int black_frames = 0;     ///< how many of them
    Options();
    /// Throws OptionError.
    void validate() const;
  };

  struct Frame {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_c0_c = Eigen::Isometry3d::Identity();  ///< [m]
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< unit normal of the road below, up
    double height = 0;                              ///< camera above the local road plane [m]
    double speed = 0;                               ///< along the road [m/s]
  };

  /// Builds the street: 0.5 s for the default drive, 130 MB at the peak. Throws OptionError.
  explicit SyntheticDrive(const Options& options);
  ~SyntheticDrive();

  const PinholeCamera& camera() const;
  std::size_t size() const;
  const Frame& frame(std::size_t i) const;
  /// 8-bit grey. The same bytes for the same options and i. Thread safe. Renders on the calling
  /// thread, 0.1 s at the default size.
  cv::Mat image(std::size_t i) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
