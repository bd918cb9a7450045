#pragma once

namespace ground_scale_vo::simulation {

constexpr double kRoadBehind = 25;        // [m] length of road behind the first camera position
constexpr double kRoadAhead = 190;        // [m] length of road ahead of the last camera position
constexpr double kMaxDriveLength = 3000;  // [m] longest drive

}  // namespace ground_scale_vo::simulation
