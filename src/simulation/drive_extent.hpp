#pragma once

namespace ground_scale_vo::simulation {

constexpr double kRoadBehind = 25;        // [m] behind the rearmost position of the camera
constexpr double kRoadAhead = 190;        // [m] ahead of the foremost one; behind, if it looks back
constexpr double kMaxDriveLength = 3000;  // [m] unless the path is recorded (RecordedPath)

}  // namespace ground_scale_vo::simulation
