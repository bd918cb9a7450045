#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/simulation/image_faults.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {

/// Frames [first, last] of a drive in which something is wrong.
struct PlacedFault {
  std::string what;
  std::optional<ImageFault> image;  ///< empty: it is part of the rendered scene
  std::size_t first = 0, last = 0;
  bool hides = false;  ///< nothing of the ground is seen in it
  std::uint64_t seed = 0;
};

/// A rendered drive with faults in the order of time, apart from each other.
struct FaultDrive {
  std::string name;
  SyntheticDrive::Options options;
  std::vector<PlacedFault> faults;
};

constexpr std::size_t kFaultDrives = 10;

/// Drive i of kFaultDrives: camera, speed, street, which faults and when are all drawn from the
/// seed. Over the ten of one seed every ImageFault, a lorry close ahead for 10 s and a wall before
/// the camera occur. Throws OptionError.
FaultDrive faultDrive(std::size_t i, std::uint64_t seed = 20);

/// One of each fault alone, in the same kind of drive: "lorry", "wall" or toString(ImageFault).
/// Throws OptionError that lists the names.
FaultDrive faultDrive(const std::string& what, std::uint64_t seed = 20);
std::vector<std::string> faultNames();

/// No number of what a frame gave is NaN or infinite, and no variance is negative.
bool isFinite(const VisualOdometry::Output& vo);
bool isFinite(const ScaleRecovery::Output& scale);

/// How the pipeline went through one fault. Seconds and frames are counted from its first frame or
/// from the first after it.
struct FaultFigures {
  std::string what;
  bool hides = false;
  double duration_s = 0;
  /// Until LOST (odometry) or HELD (scale) is said; NaN: never during the fault.
  double said_after_s = 0;
  /// Frames later than kLatestWord in which the scale is said to be measured.
  std::size_t ok_frames = 0;
  int tracking_after = 0;  ///< frames after the fault until TRACKING; -1: never
  int metric_after = 0;    ///< ... until a metric pose with the scale measured (OK); -1: never
  /// Metric way less true way from the last good frame before to settled, when positive [m].
  double invented_m = 0;
  double missed_m = 0;  ///< error of the position change over the same frames [m]
  double sigma_m = 0;   ///< what its covariance has grown by, as a standard deviation [m]
};

/// A stretch without a fault: from where the odometry had time to settle to the next fault.
struct StretchFigures {
  std::size_t first = 0, last = 0;
  double true_m = 0;         ///< its true way
  double error_percent = 0;  ///< of the relative pose over it, see below
};

struct FaultRunFigures {
  std::size_t frames = 0;
  std::size_t tracked_frames = 0;
  std::size_t non_finite_frames = 0;
  std::vector<FaultFigures> faults;
  std::vector<StretchFigures> stretches;
};

/// HELD or LOST is to be said so soon at the latest while the ground is hidden [s].
constexpr double kLatestWord = 3;
/// After a fault (and at the start) a stretch begins when both have passed: a new map needs some
/// images, and its scale some way [s, m].
constexpr double kSettleS = 3, kSettleM = 20;
/// Shorter stretches say nothing [m].
constexpr double kShortestStretch = 8;
/// Largest error of a stretch: the distance between the true and the estimated end of it, seen from
/// its begin, over its true way.
constexpr double kStretchBarPercent = 5;

/// Renders, spoils and runs the whole pipeline over it, with the defaults but for the camera
/// height. each: is called with every frame's image and outputs, may be empty.
FaultRunFigures runFaultDrive(
    const FaultDrive& drive,
    const std::function<void(std::size_t, const cv::Mat&, const OfflineRun&)>& each = {});

/// The first bar that the figures break, in a sentence; empty: none. Bars: all is finite; every
/// stretch is within kStretchBarPercent; while the ground is hidden HELD or LOST is said within
/// kLatestWord, and nothing is measured after that; no way is invented; the covariance covers what
/// was missed within three sigma.
std::string violatedThreshold(const FaultRunFigures& figures);

}  // namespace ground_scale_vo
