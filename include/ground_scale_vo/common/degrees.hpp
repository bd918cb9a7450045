#pragma once

namespace ground_scale_vo {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegreesPerRadian = 180 / kPi;
constexpr double kRadiansPerDegree = kPi / 180;

}  // namespace ground_scale_vo
