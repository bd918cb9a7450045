#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// Where something fixed to the vehicle truly was.
struct TruePosition {
  std::int64_t stamp_ns = 0;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< [m], in any fixed axes
};

/// The positions of a trajectory file: KITTI (12 numbers a line, a line for each of the stamps) or
/// TUM (8 numbers a line, in the order of time). Throws DataError.
std::vector<TruePosition> readTruePositions(const std::filesystem::path& file,
                                            const std::vector<std::int64_t>& stamps_ns);

/// WGS84 to metres east, north and up of the first of the fixes (latitude [deg], longitude [deg],
/// altitude [m]).
std::vector<Eigen::Vector3d> eastNorthUp(const std::vector<Eigen::Vector3d>& fixes);

/// The camera's height above the road and its mounting, from a drive whose length is known. The
/// scale is linear in the height: a run with a nominal height gives ways that are wrong by the
/// factor nominal / true.
class HeightCalibration {
 public:
  struct Options {
    double segment_h = 12;                ///< least length of a segment [camera heights]
    double segment_position_sigmas = 40;  ///< and this many sigmas of a true position
    double outlier_sigma = 4;             ///< a segment farther from the median (MAD) is left out
    int min_segments = 4;
    double max_error = 0.05;  ///< relative, of the 95 % interval; above it there is no height
    /// Relative, of what is common to all segments: where the plane is thought to lie.
    double method_sigma = 0.003;
    /// Throws OptionError.
    void validate() const;
  };

  enum class Status {
    kOk,
    kNoScale,      ///< no frame got a scale
    kBroken,       ///< the odometry did not track from the first image to the last
    kTooFew,       ///< segments
    kTooUncertain  ///< see max_error
  };

  /// A number with its standard error and what that must be multiplied with for 95 %.
  struct Estimate {
    double value = 0;
    double sigma = 0;
    double factor95 = 2;
    double error95() const { return factor95 * sigma; }
  };

  struct Segment {
    std::int64_t from_ns = 0, to_ns = 0;
    double way_h = 0;   ///< as the odometry sees it [camera heights]
    double height = 0;  ///< that the true way over it asks for [m]
    bool used = false;  ///< false: an outlier
  };

  struct Result {
    Status status = Status::kNoScale;
    std::string reason;  ///< one sentence unless kOk
    Estimate height;     ///< [m]
    /// Mean road normal in the camera; empty when too few frames saw the road.
    std::optional<Estimate> pitch;  ///< [rad] positive looks down
    std::optional<Estimate> roll;   ///< [rad] positive: the camera's x axis dips
    double way_h = 0;               ///< of the segments used [camera heights]
    std::vector<Segment> segments;  ///< empty when only the length was known
  };

  /// Throws OptionError.
  explicit HeightCalibration(const Options& options);

  /// The vehicle came length_m (standard deviation length_sigma_m) from the first frame to the
  /// last. One number, so its error is what the scale's own sigma says. nominal_height: the
  /// camera_height of the run. Throws OptionError when the length is not positive or the sigma
  /// negative.
  Result fromLength(const RunRecord& record, double nominal_height, double length_m,
                    double length_sigma_m) const;

  /// The drive is cut into segments; in each, positions and odometry are laid over each other by
  /// the similarity with the least squares, whose scale noise in the positions does not shift. The
  /// error is the scatter of the segments. position_sigma_m: of one position against its
  /// neighbours, for the length of the segments alone. Throws OptionError when it is negative or
  /// the stamps do not grow.
  Result fromPositions(const RunRecord& record, double nominal_height,
                       const std::vector<TruePosition>& truth, double position_sigma_m) const;

 private:
  void measureMounting(const RunRecord& record, double nominal_height, Result* result) const;
  void conclude(Result* result) const;

  Options options_;
};

const char* toString(HeightCalibration::Status status);

}  // namespace ground_scale_vo
