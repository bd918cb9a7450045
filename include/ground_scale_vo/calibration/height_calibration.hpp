#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/io/stamped_position.hpp"

namespace ground_scale_vo {

/// Estimates the camera's height above the road and its mounting from a drive of known length. The
/// scale is linear in the camera height: a run with a nominal height gives lengths that are wrong
/// by the factor nominal / true height.
class HeightCalibration {
 public:
  struct Options {
    // Minimum length of a segment: the larger of the two.
    double segment_length_heights = 12;   ///< [camera heights]
    double segment_position_sigmas = 40;  ///< [standard deviations of a position]
    /// Segments whose height is farther from the median are outliers [the larger of 1.4826 MAD and
    /// method_sigma times the median].
    double outlier_sigma = 4;
    int min_segments = 4;
    double max_error = 0.05;  ///< maximum relative half width of the 95 % interval
    /// Relative standard deviation of the error common to all segments: the bias of the estimated
    /// plane's height.
    double method_sigma = 0.003;
    /// Throws OptionError.
    void validate() const;
  };

  enum class Status {
    kOk,
    kNoScale,      ///< no frame got a scale
    kBroken,       ///< the odometry did not move, or not track from the first image to the last
    kTooFew,       ///< fewer than min_segments segments
    kTooUncertain  ///< above max_error
  };

  /// A value with its standard error sigma; value ± factor95 * sigma is the 95 % interval.
  struct Estimate {
    double value = 0;
    double sigma = 0;
    double factor95 = 2;
    /// Half width of the 95 % interval.
    double error95() const { return factor95 * sigma; }
  };

  struct Segment {
    std::int64_t from_ns = 0, to_ns = 0;
    double length_heights = 0;  ///< as the odometry measures it [camera heights]
    double height = 0;          ///< camera height that gives its known length [m]
    bool used = false;          ///< false: an outlier
  };

  struct Result {
    Status status = Status::kNoScale;
    std::string reason;  ///< one sentence unless kOk
    Estimate height;     ///< [m]
    /// Mean road normal in the camera frame; empty with fewer than three sections of
    /// segment_length_heights in which the plane was measured.
    std::optional<Estimate> pitch;  ///< [rad] positive looks down
    std::optional<Estimate> roll;   ///< [rad] positive: the camera's x axis points down
    std::vector<Segment> segments;  ///< empty after fromLength()
  };

  /// Throws OptionError.
  explicit HeightCalibration(const Options& options);

  /// From the path length between the first frame and the last: length_m with standard deviation
  /// length_sigma_m. The error comes from the reported sigma of the scale. nominal_height [m]: the
  /// camera_height of the run. Throws OptionError when the length is not positive or the sigma
  /// negative.
  Result fromLength(const RunRecord& record, double nominal_height, double length_m,
                    double length_sigma_m) const;

  /// From positions along the drive. It is cut into segments; in each, the least-squares similarity
  /// between odometry and positions gives the height, which noise in the positions does not bias.
  /// The error comes from the standard deviation of the segments. position_sigma_m: of one position
  /// relative to its neighbours, sets the length of the segments only. Throws OptionError when it
  /// is negative or the stamps do not increase.
  Result fromPositions(const RunRecord& record, double nominal_height,
                       const std::vector<StampedPosition>& positions,
                       double position_sigma_m) const;

 private:
  void cutSegments(const std::vector<RunFrame>& frames, double nominal_height,
                   const std::vector<StampedPosition>& positions, double position_sigma_m,
                   Result* result) const;
  void averageSegments(Result* result) const;
  void measureMounting(const RunRecord& record, double nominal_height, Result* result) const;
  void judge(Result* result) const;

  Options options_;
};

}  // namespace ground_scale_vo
