#pragma once

#include <vector>

#include "ground_scale_vo/calibration/height_calibration.hpp"

namespace ground_scale_vo {

/// Weighted mean of values in the order of travel, with a standard error that accounts for their
/// autocorrelation: the autocovariances are summed up to the first lag at which they are not
/// positive, at most a third of the values. Precondition: at least two values; positive weights.
HeightCalibration::Estimate correlatedMean(const std::vector<double>& values,
                                           const std::vector<double>& weights);

}  // namespace ground_scale_vo
