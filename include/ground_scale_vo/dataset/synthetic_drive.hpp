#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// A rendered drive along a textured street (kerbs, facades, parked and moving cars, curves, a
/// slope, a stop, suspension pitch), with exact poses and exact ground planes. Deterministic.
class SyntheticDrive {
 public:
  struct Options {
    PinholeCamera camera;          ///< defaults to 620x188, f = 359 px (KITTI's field of view)
    double camera_height = 1.65;   ///< [m] mean height over the road
    double frame_rate_hz = 10.0;
    int frames = 150;
    double speed = 8.0;            ///< cruise [m/s]
    double pitch_rad = 0.02;       ///< mounting, positive looks down
    std::uint64_t random_seed = 1;
    Options();
    /// Throws OptionError.
    void validate() const;
  };

  struct Frame {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_c0_c = Eigen::Isometry3d::Identity();  ///< [m]
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< unit normal of the road below, up
    double height = 0;                              ///< camera above the local road plane [m]
  };

  explicit SyntheticDrive(const Options& options);
  ~SyntheticDrive();

  const PinholeCamera& camera() const;
  std::size_t size() const;
  const Frame& frame(std::size_t i) const;
  /// 8-bit grey. The same bytes for the same options and i. Thread safe.
  cv::Mat image(std::size_t i) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
