#pragma once

#include <memory>

#include "ground_scale_vo/common/options.hpp"
#include "vo/map.hpp"

namespace ground_scale_vo {

constexpr int kMaxAdjustmentIterations =
    6;                             ///< of Levenberg-Marquardt; the cost then hardly changes
constexpr double kHuberSigma = 1;  ///< [standard deviations] above it Huber's loss is linear

/// Optimises the poses of the newest keyframes and the inverse depths of the landmarks that they
/// observe: reprojection error with Huber's loss, Levenberg-Marquardt. Older keyframes are fixed,
/// which fixes the gauge (7 degrees of freedom). While fewer than two keyframes
/// are older than the window, the first keyframe of the map and its distance to the newest one are
/// fixed instead.
///
/// A landmark with inverse depth rho on the ray of its anchor a projects into observer o as
///   q = R_o_a ray + rho t_o_a,   residual r = (q_xy / q_z - x) / sigma,
/// x: observed position in normalised image coordinates, sigma: its standard deviation.
/// Poses are updated by boxplus (common/se3.hpp). The inverse depths, a scalar each, are eliminated
/// by the Schur complement; the remaining system, six rows per keyframe, is solved by Cholesky.
///
/// All arrays keep their memory from one adjustment to the next.
class LocalBundleAdjustment {
 public:
  struct Result {
    /// False if there are too few landmarks, the result is not finite, or no step can be computed;
    /// store() then leaves the map unchanged.
    bool usable = false;
    int residuals = 0;  ///< scalar residuals: two per observation other than the anchor's
    /// Square root of the mean Huber loss (twice the final cost over `residuals`), in standard
    /// deviations. The RMS of the residuals where none exceeds huber_sigma.
    double rms_sigma = 0;
  };

  /// window: see OdometryOptions::adjusted_keyframes.
  explicit LocalBundleAdjustment(int window);
  ~LocalBundleAdjustment();

  /// load(), solve() and store().
  Result adjust(LocalMap* map);

  /// Copies poses, inverse depths and observations from the map.
  void load(const LocalMap& map);
  /// Does not access the map, so it can run on another thread. Takes nearly all of the time.
  Result solve();
  /// Writes the poses and inverse depths of the last solve() to the map, if they are usable.
  /// Precondition: the map has the keyframes and anchors that it had in load().
  void store(LocalMap* map) const;

 private:
  struct Problem;
  int window_;
  std::unique_ptr<Problem> problem_;
};

}  // namespace ground_scale_vo
