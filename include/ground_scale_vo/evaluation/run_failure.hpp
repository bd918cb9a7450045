#pragma once

#include <string>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {

/// Why the poses of a run are no result, in one sentence; empty: they are. No frame has a metric
/// pose, too few are tracked, or the scale is not measured in most of the frames in motion. The
/// rule of the exit status, also of the recorded output of the nodelets.
std::string failureOf(const RunRecord& record);

}  // namespace gsv
