#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace gsv {

class LensSegment;
class LensSolver;
struct TrackNoise;

/// Estimates the lens of a camera (focal length, principal point, k1, k2) from the tracks and poses
/// of a drive: a bundle adjustment over poses, points and lens on keyframes, with the calibration
/// as a prior. It uses only the frames of the odometry.
///
/// The ratio of fy to fx and the tangential terms stay as given: estimates from different drives of
/// one camera contradict each other, as they hardly differ from a motion of the principal point.
///
///     LensEstimator estimator({});
///     for (const VoFrame& frame : drive) estimator.add(frame);
///     const auto result = estimator.estimate(estimator.priorOf(calibration));
///     // The next drive of the camera continues with result.estimate as its prior.
class LensEstimator {
 public:
  struct Options {
    double prior_focal_sigma = 0.003;
    double prior_centre_sigma_px = 3;
    int min_observations = 4;
    int tracks_per_cell = 1;
    /// [focal lengths] Largest standard deviation of the principal point, from the drive alone,
    /// with which the lens is observable: a straight drive leaves it unknown.
    double max_centre_sigma = 0.004;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("prior_focal_sigma", self.prior_focal_sigma, 1e-5, 1,
            "[] relative standard deviation of the focal length of a calibration");
      visit("prior_centre_sigma_px", self.prior_centre_sigma_px, 1e-3, 1000,
            "[px] standard deviation of each coordinate of its principal point");
      visit("min_observations", self.min_observations, 3, 100,
            "[] least number of keyframes that observe a track");
      visit("tracks_per_cell", self.tracks_per_cell, 1, 1000,
            "[] about as many tracks are used in each of 16 x 6 cells of a keyframe");
    }
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      visit("lens/", self);
    }
  };

  enum class Status {
    kOk,
    kTooFew,        ///< not enough keyframes or tracks
    kUnobservable,  ///< no parallax, or no turns
    kDiverged       ///< the prior is too far from the lens
  };

  /// Mean residual of the observations in a cell of the image.
  struct FieldCell {
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< [px]
    Eigen::Vector2d before = Eigen::Vector2d::Zero();  ///< projection minus observation [px]
    Eigen::Vector2d after = Eigen::Vector2d::Zero();   ///< the same
    int observations = 0;
  };

  struct Result {
    Status status = Status::kTooFew;
    std::string reason;     ///< one sentence unless kOk
    LensEstimate estimate;  ///< of drive and prior; the prior itself unless kOk
    /// That the drive contradicts the prior's lens, which is then no calibration of this camera:
    /// one sentence, also when the drive does not determine another one; empty: it does not.
    /// Distances by the prior's lens are wrong.
    std::string contradiction;
    /// Residuals with the lens of the prior (poses and points adjusted to it) and with the
    /// estimate.
    double rms_before_px = 0, rms_after_px = 0;
    std::vector<FieldCell> field;
    std::size_t keyframes = 0, tracks = 0;
    /// Smooth displacements of the pixels that this lens model does not describe: standard
    /// deviation of the coefficients of a polynomial over the image, as found in the drive [px].
    double model_error_px = 0;
  };

  /// Throws OptionError.
  explicit LensEstimator(const Options& options);

  /// The next frame of the drive. The features are pixels of the images whose lens is estimated.
  /// Frames without a pose and new maps interrupt the tracks.
  void add(const VoFrame& frame);

  /// Number of keyframes so far.
  std::size_t keyframes() const { return keyframes_.size(); }

  /// Of the drive so far. prior: a calibration, or the estimate from other drives of this camera.
  /// initial: where the optimisation starts, such as the lens with which the drive was processed.
  Result estimate(const LensEstimate& prior, const Lens& initial) const;
  Result estimate(const LensEstimate& prior) const { return estimate(prior, prior.lens); }

  /// The prior of a calibration, with the standard deviations of the options.
  LensEstimate priorOf(const Lens& calibration) const;

 private:
  struct Keyframe {
    std::size_t run = 0;  ///< number of uninterrupted runs of one map before
    Eigen::Isometry3d T_w_c;
    std::vector<std::pair<std::uint64_t, Eigen::Vector2d>> features;  ///< by id
  };

  std::vector<LensSegment> segments(const Lens& lens, const TrackNoise& noise) const;
  bool count(const std::vector<LensSegment>& segments, Result* result) const;
  void judge(const LensSolver& solver, const LensEstimate& estimate, Result* result) const;
  /// Median flow between two keyframes [px]; infinite without a common feature.
  static double flow(const Keyframe& a, const Keyframe& b);

  Options options_;
  std::vector<Keyframe> keyframes_;
  std::size_t run_ = 0;
  bool interrupted_ = true;
};

/// The frame as LensEstimator::add() needs it, from one of images that were undistorted by `lens`.
VoFrame withDistortedFeatures(VoFrame frame, const Lens& lens);

const char* toString(LensEstimator::Status status);  ///< "ok", "too few", ...

}  // namespace gsv
