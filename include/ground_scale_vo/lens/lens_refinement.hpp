#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <future>
#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/lens/lens_estimator.hpp"

namespace gsv {

/// Estimates the lens while driving, on a second thread, and decides when a change of the lens
/// improves the odometry.
///
/// A drive observes the lens where it turns. So the first estimate is made after a turn, and the
/// next ones when the sum of the turns has grown by a factor: a straight drive costs nothing, and
/// the cost per frame is bounded.
class LensRefinement {
 public:
  struct Options {
    LensEstimator::Options estimator;
    /// The result of an estimate is used a fixed number of frames after its start, and add()
    /// waits for it. False: it is used as soon as it is there, and nothing waits.
    bool deterministic = true;
  };

  /// given: the calibration. Throws OptionError.
  LensRefinement(const Lens& given, const Options& options);

  /// The next frame, with features in pixels of the given images, and the lens with which it was
  /// made. Returns a better lens when there is one.
  std::optional<LensEstimate> add(const VoFrame& frame, const Lens& in_use);

  /// After the change to another lens: forgets the tracks, which depend on the lens in use.
  void restart();

 private:
  void addTurn(const VoFrame& frame);
  std::optional<LensEstimator::Result> finished();

  Options options_;
  LensEstimator estimator_;
  LensEstimate prior_;
  double turned_ = 0, next_turn_ = 0;  ///< rotation since restart(), and at the next estimate [rad]
  std::optional<Eigen::Matrix3d> R_w_reference_;  ///< of the frame at the last step of turned_
  std::future<LensEstimator::Result> pending_;
  int frames_since_start_ = 0;  ///< of the pending estimate
};

}  // namespace gsv
