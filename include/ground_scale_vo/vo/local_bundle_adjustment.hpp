#pragma once

#include "ground_scale_vo/vo/local_map.hpp"

namespace ground_scale_vo {

/// Refines the newest keyframes' poses and all depths that they see, by reprojection error with a
/// robust loss (Ceres). Older keyframes are held, which fixes the seven degrees of freedom that
/// images leave open; while there are no two of them, the first keyframe and the length of the way
/// to the newest are held.
class LocalBundleAdjustment {
 public:
  struct Options {
    int window = 7;  ///< newest keyframes that move
    int max_iterations = 4;
    double noise = 0.0008;     ///< standard deviation of an observation, normalised coordinates
    double huber_sigma = 1.0;  ///< residuals over this many standard deviations count linearly
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    bool usable =
        false;  ///< false: too little to adjust, or no step was found; the map is unchanged
    int residuals = 0;
    double rms_sigma = 0;  ///< of the residuals afterwards, in standard deviations
  };

  explicit LocalBundleAdjustment(const Options& options);

  Result adjust(LocalMap* map) const;

 private:
  Options options_;
};

}  // namespace ground_scale_vo
