#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "simulation/image_faults.hpp"

namespace gsv {

/// A rendered drive along a textured street with kerbs, facades, trees, parked and moving cars,
/// curves, a slope, a stop and a suspension. Camera poses and ground planes are exact. The options
/// beyond the default drive add conditions that are difficult for a camera, see scenarios.hpp.
///
/// The road repeats every 130 m: a curve to the left at 15-55 m, one to the right at 65-105 m;
/// uphill from 0 to 65 m, downhill from 65 to 130 m (crests of 830 m radius). The camera drives in
/// the right lane.
class SyntheticDrive {
 public:
  struct SpeedAt {
    double time_s;
    double speed;  ///< [m/s], negative: backwards
  };
  /// A part of the road, in metres along the lane from the start; to_m <= from_m: none.
  struct Stretch {
    double from_m = 0, to_m = 0;
    bool exists() const { return from_m < to_m; }
    /// Whether s is in it, or nearer to it than the margin [m].
    bool contains(double s, double margin = 0) const {
      return exists() && s >= from_m - margin && s <= to_m + margin;
    }
  };

  /// Positions on the road ("..._m") are distances along the lane from the start [m].
  struct Options {
    // --- Camera and recording ---
    PinholeCamera camera;         ///< defaults to 800x248, f = 464 px (KITTI's field of view)
    double camera_height = 1.65;  ///< mean height over the road [m]
    double pitch_rad = 0.02;      ///< of the mounting, positive looks down
    double roll_rad = 0;          ///< of the mounting, positive: the camera's x axis points down
    double yaw_rad = 0;           ///< of the mounting, positive looks to the left; pi: rear-facing
    double frame_rate_hz = 10.0;
    /// Rolling shutter: time from the exposure of the first row to that of the last one plus
    /// one row [s]; 0: global shutter. Stamps, poses and ground planes are those of the middle of
    /// the image: row y is exposed at the stamp + readout_time * ((y + 0.5) / height - 0.5).
    double readout_time = 0;
    int frames = 200;
    std::uint64_t random_seed = 1;
    std::uint64_t noise_seed = 1;  ///< another one: the same drive with other sensor noise

    // --- Motion of the ego vehicle ---
    double speed = 9.0;      ///< at cruise [m/s]
    double stop_s = 2.5;     ///< time at standstill [s]; 0: no stop
    double stop_at_m = 60;   ///< position of the stop [m]
    double lane_offset = 0;  ///< of the camera, left of the middle of the lane [m]
    /// Speeds at given times, in chronological order, with smooth changes in between; the first and
    /// the last one hold before and after. They replace cruise and stop; `speed` then only scales
    /// the vibrations. Empty: cruise with the stop.
    std::vector<SpeedAt> speeds;
    /// Positions of a camera in each frame, such as those of a recorded drive [m], x right, y down,
    /// z forward of the first camera. Road and motion follow them, smoothed (recorded_path.hpp);
    /// the camera looks along the road. They replace stop, speeds and the shape of the road;
    /// `speed` then only limits the vibrations. What would stand on the road where it crosses
    /// itself is left out. Empty: a generated road.
    std::vector<Eigen::Vector3d> path;
    double suspension = 1;  ///< factor on pitch, roll and bounce; 0: a rigid car

    // --- Shape of the road ---
    double curvature = 1.0 / 35;  ///< largest, in the middle of a curve [1/m]; 0: a straight road
    double slope = 0.025;         ///< largest [m/m]; 0: a flat road
    double ramp_slope = 0;        ///< of one straight ramp [m/m]; 0: none
    Stretch ramp;                 ///< with transitions of 6 m at both ends
    double bump_height = 0;     ///< of speed bumps, 3.6 m long, at 21 m and every 17 m [m]; 0: none
    double road_shift_m = 0;    ///< by which curves and slopes lie nearer to the start [m]
    double kerb_height = 0.12;  ///< of both kerbs and pavements above the carriageway [m]

    // --- Other vehicles ---
    bool parked_cars = true;
    bool moving_cars = true;  ///< one ahead in the lane, others oncoming or beside; not the lorry
    bool lead_van = false;    ///< the one ahead is a van, 2.1 m wide and 2.5 m high
    double lead_gap = 6.9;    ///< from the camera to the rear of the one ahead at standstill [m]
    double lead_time = 1.2;   ///< lead of the one ahead in the speed profile [s]
    int cars_beside = 0;      ///< number of cars in the left lane at the same speed; they replace
                              ///< the oncoming ones
    double oncoming_spacing = 150;  ///< between oncoming cars, which drive at 8 m/s [m]
    /// A lorry that cuts in from the left, leads 2.3 m ahead and leaves to the left again. It is as
    /// wide as the lanes, so that it hides the road.
    FrameRange lorry;

    // --- Surroundings ---
    bool built_up = true;   ///< houses, hedges, paved footways, and marked parking bays
    bool off_road = false;  ///< rough gravel and grass without road, kerbs and houses
    double wall_at_m = 0;  ///< position of a house across the road [m], only with built_up; 0: none
    Stretch bridge;        ///< the terrain beside the road is 9 m lower
    Stretch underpass;     ///< walls and a ceiling absorb 80 % of the light

    // --- Surface of the road ---
    bool lane_markings = true;
    bool solid_lines = false;  ///< only continuous lines instead of dashes and parking bays
    double arrow_spacing = 0;  ///< of arrows painted in the lane [m]; 0: none
    double road_texture = 1;   ///< contrast factor of asphalt, repairs and cracks; 0: uniform grey
    double grain = 0;          ///< contrast of stones below 2 cm, visible to a camera near the road
    Stretch bare;              ///< here the asphalt has only the markings as texture
    bool cobbles = false;      ///< instead of asphalt
    double puddles = 0;        ///< share of the carriageway under water; requires a flat road

    // --- Light ---
    bool shadows = true;      ///< of trees, houses and cars on the road
    bool own_shadow = false;  ///< of the ego vehicle, which is as high as the camera
    /// Direction towards the sun: x along the road at the start, y left, z up.
    Eigen::Vector3d sun{0.25, 0.62, 0.75};
    double daylight = 1;  ///< 1: day; below 1 the headlamps are on; 0: only they give light

    // --- Image ---
    double hood = 0;         ///< share of the image height that the hood of the ego vehicle covers
    double noise_sigma = 1;  ///< of the sensor, standard deviation [grey levels]
    int jpeg_quality = 0;    ///< of a lossy compression, 1 to 100; 0: none
    /// Of lens, exposure and camera driver, one after the other.
    std::vector<ImageFault> faults;

    Options();
    /// Checks what users can set, and what must fit together. Throws OptionError.
    void validate() const;
  };

  struct Frame {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_c0_c = Eigen::Isometry3d::Identity();  ///< first camera from camera [m]
    /// Unit normal of the road plane below the camera, up, in camera axes. On ramps and bumps it is
    /// the plane through the contact points of the axles, 1.4 m before and 1.2 m behind the camera.
    Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
    double height = 0;  ///< of the camera over that plane [m]
    double speed = 0;   ///< along the middle of the lane [m/s], negative: backwards
  };

  /// Throws OptionError. The first image builds the street: 0.5 s for the default drive, 130 MB at
  /// the peak; along a recorded path of 5 km 2.5 s and 900 MB.
  explicit SyntheticDrive(const Options& options);
  ~SyntheticDrive();

  const PinholeCamera& camera() const;
  double cameraHeight() const;  ///< Options::camera_height
  std::size_t size() const;     ///< number of frames
  const Frame& frame(std::size_t i) const;
  /// Renders frame i on the calling thread: 8-bit, one channel, 0.1 s at the default size. The same
  /// options and i give the same bytes. Thread safe.
  cv::Mat image(std::size_t i) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// T_c0_c of every frame [m].
std::vector<Eigen::Isometry3d> groundTruth(const SyntheticDrive& drive);
/// Height of the camera above the road in every frame [m].
std::vector<double> groundTruthHeights(const SyntheticDrive& drive);

}  // namespace gsv
