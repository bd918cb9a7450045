#pragma once

#include <cstdint>

namespace ground_scale_vo {

/// [messages] that wait for a slow subscriber of a topic with one message per image: ten seconds of
/// a 10 Hz camera.
constexpr std::uint32_t kPublishQueue = 100;
constexpr double kDiagnosticsPeriod = 1.0;  ///< [s] wall time

}  // namespace ground_scale_vo
