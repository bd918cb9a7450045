#pragma once

#include <memory>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/local_map.hpp"

namespace ground_scale_vo {

/// Refines the newest keyframes' poses and all depths that they see, by reprojection error with
/// Huber's loss. Older keyframes are held, which fixes the seven degrees of freedom that images
/// leave open; while there are no two of them, the first keyframe and the length of the way to the
/// newest are held.
///
/// Of a point with inverse depth rho on the ray of its anchor a, camera o sees
///   q = R_o_a ray + rho t_o_a,   residual (q_xy / q_z - x) / sigma.
/// Minimised by Levenberg-Marquardt over increments of each pose in its own camera,
///   R_w_c exp(w), t_w_c + R_w_c v,
/// and of rho. The depths, a scalar each, are eliminated (Schur complement); what is left, six
/// numbers a keyframe, is solved by Cholesky.
///
/// The problem is held in flat arrays that are kept from one adjustment to the next.
class LocalBundleAdjustment {
 public:
  struct Options {
    int window = 7;
    int max_iterations = 8;
    double huber_sigma = 1.0;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("window", self.window, 1, 100,
            "[keyframes] newest ones that are optimised; older ones are fixed");
      visit("max_iterations", self.max_iterations, 1, 1000, "[iterations] of Levenberg-Marquardt");
      visit("huber_sigma", self.huber_sigma, 0.1, 1000,
            "[sigma] residual above which Huber's loss is linear");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    bool usable = false;  ///< false: too little to adjust, something is not a number, or no step
                          ///< could be computed; the map is unchanged
    int residuals = 0;
    double rms_sigma = 0;  ///< of the residuals afterwards, in standard deviations
  };

  explicit LocalBundleAdjustment(const Options& options);
  ~LocalBundleAdjustment();

  Result adjust(LocalMap* map);

  // The same in three steps. Only solve() takes long, and it does not touch the map: it can run on
  // another thread.

  /// Takes poses, depths and observations out of the map.
  void load(const LocalMap& map);
  Result solve();
  /// Puts the poses and depths of the last solve() into the map; nothing if they are not usable.
  /// Precondition: the map's keyframes and anchors are as in load().
  void store(LocalMap* map) const;

 private:
  struct Problem;
  Options options_;
  std::unique_ptr<Problem> problem_;
};

}  // namespace ground_scale_vo
