#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <future>
#include <optional>
#include <string>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/lens/lens_estimator.hpp"

namespace gsv {

/// Estimates the lens while driving, on a second thread, and decides when a change of the lens
/// improves the odometry.
///
/// A drive observes the lens where it turns. So the first estimate is made after a turn, and the
/// next ones when the sum of the turns has grown by a factor, which bounds the cost per frame. A
/// straight drive still contradicts a calibration of another lens, so it is compared with it once.
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
  /// made. Returns a better lens when there is one. With a frame of Continuity::kOtherLens it
  /// starts anew: the tracks before depend on the lens that was in use.
  std::optional<LensEstimate> add(const VoFrame& frame, const Lens& in_use);

  /// How the drive contradicts the given calibration, by the latest estimate, in one sentence;
  /// empty: it does not, or there is none.
  const std::string& contradiction() const { return contradiction_; }
  /// The same after the last frame, by all frames with `in_use`: takes as long as an estimate.
  const std::string& finalContradiction(const Lens& in_use);

 private:
  void restart();
  void addTurn(const VoFrame& frame);
  std::optional<LensEstimator::Result> finished();
  void compare(const LensEstimator::Result& result);
  bool isDue();

  Options options_;
  LensEstimator estimator_;
  LensEstimate prior_;
  std::string contradiction_;
  double turned_ = 0, next_turn_ = 0;  ///< rotation of these frames, and at the next estimate [rad]
  std::optional<Eigen::Matrix3d> R_w_reference_;  ///< of the frame at the last step of turned_
  bool is_compared_ = false;                      ///< the drive with the calibration
  std::future<LensEstimator::Result> pending_;
  int frames_since_start_ = 0;  ///< of the pending estimate
  bool is_for_use_ = false;     ///< the drive has turned before it
};

}  // namespace gsv
