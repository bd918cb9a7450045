#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/lens/lens_estimator.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace gsv {

/// A drive that can be read several times: calls its argument with each image (8-bit grey) and its
/// stamp [ns], in order of time.
using ImageVisitor = std::function<void(const cv::Mat& image, std::int64_t stamp_ns)>;
using RepeatableDrive = std::function<void(const ImageVisitor&)>;

/// Estimates the lens from drives of one camera. The tracks of an odometry with a wrong lens pull
/// the estimate towards it, so the drives are processed again with each estimate until it
/// converges.
class LensCalibration {
 public:
  struct Options {
    LensEstimator::Options estimator = allTracks();
    VisualOdometry::Options vo;
    int max_runs = 5;               ///< of each drive
    double min_significance = 15;   ///< of an estimate, else the calibration is confirmed
    double converged_sigmas = 0.3;  ///< largest change between two runs [standard deviations]
    /// The calibration is a pinhole of a field of view that may be wrong by 15 %: a weak prior,
    /// twice as many runs, and several starts, see startsOf().
    bool is_rough = false;
    template <typename Self, typename Visit>
    static void visitStages(Self& self, Visit&& visit) {
      LensEstimator::Options::visitStages(self.estimator, visit);
      VisualOdometry::Options::visitStages(self.vo, visit);
    }
    /// Throws OptionError.
    void validate() const;

   private:
    /// Time matters less than while driving.
    static LensEstimator::Options allTracks() {
      LensEstimator::Options options;
      options.tracks_per_cell = 1000;
      return options;
    }
  };

  struct Result {
    LensEstimator::Status status = LensEstimator::Status::kTooFew;
    std::string reason;  ///< one sentence unless kOk
    LensEstimate prior, estimate;
    std::vector<LensEstimator::Result> drives;  ///< of the last run
    int runs = 0;
    bool converged = false;
    /// The estimate does not differ significantly from the calibration, which is the result then.
    bool confirmed = false;
  };
  /// Throws OptionError.
  explicit LensCalibration(const Options& options);

  /// drives: not empty, images of the calibration's size (throws OptionError otherwise). A drive
  /// that does not observe the lens is left out; the status is that of the first drive if all are.
  /// mask: of the images as they come, 0 where they never show the scene; empty: no such region.
  Result calibrate(const std::vector<RepeatableDrive>& drives, const Lens& calibration,
                   const cv::Mat& mask = {}) const;

 private:
  /// Processes the images undistorted by `lens` and returns the tracks in the pixels of the images,
  /// up to this number of keyframes.
  LensEstimator track(const RepeatableDrive& drive, const Lens& lens, const cv::Mat& mask,
                      bool is_first,
                      std::size_t max_keyframes = std::numeric_limits<std::size_t>::max()) const;
  LensEstimate priorOf(const Lens& calibration) const;
  /// The starts with which the first keyframes of a drive leave the smallest residuals, in their
  /// order.
  std::vector<Lens> bestStarts(const RepeatableDrive& drive, const Lens& pinhole,
                               const cv::Mat& mask) const;
  Result calibrateFrom(const Lens& calibration, const std::vector<RepeatableDrive>& drives,
                       const cv::Mat& mask) const;

  Options options_;
};

/// The prior, the estimate and their standard deviations, a line per parameter.
std::string lensTable(const LensCalibration::Result& result);
/// The mean residuals of a drive over the image as arrows: above with the prior, below with the
/// estimate.
cv::Mat drawResiduals(const LensEstimator::Result& drive, const PinholeCamera& camera);

}  // namespace gsv
