#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/image_faults.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {

/// Frames [first, last] of a drive that are faulty.
struct PlacedFault {
  std::string name;
  std::optional<ImageFault> image;  ///< injected into the image; empty: part of the rendered scene
  std::size_t first = 0, last = 0;
  bool hides_ground = false;  ///< no part of the ground is visible
  std::uint64_t seed = 0;
};

/// A rendered drive with faults in chronological order, with fault-free segments in between.
struct FaultDrive {
  std::string name;
  SyntheticDrive::Options options;
  std::vector<PlacedFault> faults;
};

constexpr std::size_t kFaultDriveCount = 10;

/// Drive i of kFaultDriveCount, with two faults. Camera, speed, street, faults and their durations
/// are drawn from the seed. The drives of one seed contain every ImageFault, a lorry close ahead
/// for 10 s and a wall in front of the camera. Throws OptionError.
FaultDrive faultDrive(std::size_t i, std::uint64_t seed = 20);

/// A drive of the same kind with a single fault: "lorry", "wall" or toString(ImageFault). Throws
/// OptionError with a list of the names.
FaultDrive faultDrive(const std::string& name, std::uint64_t seed = 20);
std::vector<std::string> faultNames();

/// A fault-free segment begins when this time [s] and this distance [m] have passed since a fault
/// or since the start: a new map needs some images, and its scale some distance.
constexpr double kSettlingTime = 3, kSettlingDistance = 20;

}  // namespace ground_scale_vo
