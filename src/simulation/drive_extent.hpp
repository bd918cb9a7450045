#pragma once

namespace ground_scale_vo::simulation {

constexpr double kRoadBehind = 25;        // of the first place of the drive [m]
constexpr double kRoadAhead = 190;        // of its last place [m]
constexpr double kMaxDriveLength = 3000;  // [m]

}  // namespace ground_scale_vo::simulation
