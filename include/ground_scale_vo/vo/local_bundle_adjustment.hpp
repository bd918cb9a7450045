#pragma once

#include "ground_scale_vo/options.hpp"
#include "ground_scale_vo/vo/local_map.hpp"

namespace ground_scale_vo {

/// Refines the newest keyframes' poses and all depths that they see, by reprojection error with a
/// robust loss (Ceres). Older keyframes are held, which fixes the seven degrees of freedom that
/// images leave open; while there are no two of them, the first keyframe and the length of the way
/// to the newest are held.
class LocalBundleAdjustment {
 public:
  struct Options {
    int window = 7;
    int max_iterations = 4;
    double huber_sigma = 1.0;
    template <typename Self, typename Visit>
    static void describe(Self& self, Visit&& visit) {
      visit("window", self.window, 1, 100,
            "[keyframes] newest ones that move; older ones are held");
      visit("max_iterations", self.max_iterations, 1, 1000, "[iterations] of Levenberg-Marquardt");
      visit("huber_sigma", self.huber_sigma, 0.1, 1000, "[sigma] larger residuals count linearly");
    }
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
