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
/// Options beyond the plain drive make what is hard for a camera: see scenarios.hpp.
///
/// The road repeats every 130 m: a curve to the left at 15-55 m, one to the right at 65-105 m; up
/// to 65 m, down again to 130 m (crests of 830 m radius). The camera keeps the middle of the right
/// lane.
class SyntheticDrive {
 public:
  struct SpeedAt {
    double time_s;
    double speed;  ///< [m/s], negative: backwards
  };

  struct Options {
    PinholeCamera camera;         ///< defaults to 800x248, f = 464 px (KITTI's field of view)
    double camera_height = 1.65;  ///< [m] mean height over the road
    double frame_rate_hz = 10.0;
    int frames = 200;
    double speed = 9.0;       ///< cruise [m/s]
    double pitch_rad = 0.02;  ///< mounting, positive looks down
    double roll_rad = 0;      ///< mounting, positive: the camera's x axis dips
    double lane_offset = 0;   ///< of the camera's way, left of the lane's middle [m]
    std::uint64_t random_seed = 1;

    double curvature = 1.0 / 35;  ///< largest, in the middle of a curve [1/m]; 0: a straight road
    double slope = 0.025;         ///< largest rise over run; 0: a flat road
    double stop_s = 2.5;          ///< time at standstill [s]; 0: no stop
    double stop_at_m = 60;        ///< where it stands [m] from the start, along the road
    /// In the order of time, with smooth changes in between and held before and after; then
    /// `speed` is only what the suspension calls fast, and there is no stop but theirs. Empty:
    /// cruise with the stop.
    std::vector<SpeedAt> speeds;
    double suspension = 1;  ///< factor on pitch, roll and bounce; 0: a rigid car

    double ramp_slope = 0;   ///< of one straight ramp with edges of 6 m [rise over run]; 0: none
    double ramp_from_m = 0;  ///< along the road, with its first edge [m]
    double ramp_to_m = 0;    ///< with its last edge [m]
    double bump_height = 0;  ///< of speed bumps, 3.6 m long, at 21 m and every 17 m [m]; 0: none

    bool moving_cars = true;  ///< one ahead in the lane, others oncoming
    bool lead_van = false;    ///< the one ahead is a van, 2.1 m wide and 2.5 m high
    double lead_gap = 6.9;    ///< from the camera to the rear of the one ahead, when both stand [m]
    double lead_time = 1.2;   ///< it drives as the camera does so much later [s]
    int cars_beside = 0;      ///< that keep pace in the left lane, instead of oncoming ones
    double oncoming_spacing = 150;  ///< between oncoming cars, which drive at 8 m/s [m]
    bool parked_cars = true;
    int lorry_first = 0;     ///< first frame in which a lorry is close ahead: it cuts in from the
    int lorry_frames = 0;    ///< left, leads for so many frames and leaves to the left again
    double lorry_gap = 2.3;  ///< from the camera to its rear [m]
    double lorry_width = 2.55;  ///< of the lorry with its load [m]

    double wall_at_m = 0;         ///< of a house across the road, along the road [m]; 0: none
    bool off_road = false;        ///< rough gravel and grass instead of road, kerbs and houses
    double bridge_from_m = 0;     ///< between these the ground beside the road lies 9 m below:
    double bridge_to_m = 0;       ///< along the road [m]
    double underpass_from_m = 0;  ///< between these walls and a ceiling leave hardly any light:
    double underpass_to_m = 0;    ///< along the road [m]

    bool lane_markings = true;
    bool solid_lines = false;  ///< the markings are lines along the road only
    double arrow_spacing = 0;  ///< of arrows painted in the lane [m]; 0: none
    double road_texture = 1;   ///< contrast of the asphalt, its patches and cracks; 0: none
    double grain = 0;        ///< contrast of the road's stones under 2 cm, which a near camera sees
    double bare_from_m = 0;  ///< between these the asphalt shows nothing but the markings:
    double bare_to_m = 0;    ///< along the road [m]
    bool cobbles = false;    ///< instead of asphalt
    double puddles = 0;      ///< share of the carriageway under water; needs a flat road
    bool shadows = true;     ///< of trees, houses and cars on the road
    bool own_shadow = false;  ///< of the own car, as high as the camera
    /// Towards the sun: x along the road at the start, y left, z up.
    Eigen::Vector3d sun{0.25, 0.62, 0.75};
    double daylight = 1;     ///< 1: day; 0: nothing but the headlamps
    bool headlamps = false;  ///< of the own car; to be seen at night
    double hood = 0;         ///< share of the image's height that the own hood covers
    double noise_sigma = 1;  ///< sensor noise [grey levels]
    int jpeg_quality = 0;    ///< of the image's compression, 1 to 100; 0: none
    int black_first = 0;     ///< first frame of a blinded camera (all zero)
    int black_frames = 0;    ///< how many of them
    Options();
    /// Throws OptionError.
    void validate() const;
  };

  struct Frame {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_c0_c = Eigen::Isometry3d::Identity();  ///< [m]
    /// Unit normal of the road below, up. Where the road has ramps or bumps, of the plane through
    /// the places on which the wheels stand, 1.4 m before and 1.2 m behind the camera.
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
    double height = 0;  ///< camera above that plane [m]
    double speed = 0;   ///< along the lane's middle [m/s], negative backwards
  };

  /// Builds the street: 0.5 s for the default drive, 130 MB at the peak. Throws OptionError.
  explicit SyntheticDrive(const Options& options);
  ~SyntheticDrive();

  const PinholeCamera& camera() const;
  double cameraHeight() const;  ///< Options::camera_height
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
