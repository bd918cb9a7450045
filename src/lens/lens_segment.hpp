#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "lens/track_noise.hpp"

namespace gsv {

struct LensObservation {
  std::size_t keyframe = 0;                     ///< index in the segment
  Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< [px]
};

/// Most keyframes from the first to the last observation of a track. It limits the size of the
/// normal equations of a track, and the band of those of the poses.
constexpr int kMaxTrackKeyframes = 16;

/// A static point and its observations. The parameters of the point are relative to a fixed frame,
/// the initial pose of the keyframe that observed it first: the ray (x, y, 1) and the inverse depth
/// rho along it, p_w = R (x, y, 1) / rho + c. rho = 0 is a point at infinity.
struct LensTrack {
  std::vector<LensObservation> observations;        ///< increasing keyframes
  std::size_t frame = 0;                            ///< keyframe whose initial pose is the frame
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< x, y, rho
  Eigen::MatrixXd information;                      ///< of TrackNoise
  bool used = true;                                 ///< false: an outlier

  /// Number of residuals minus the parameters of the point.
  int redundancy() const { return 2 * static_cast<int>(observations.size()) - 3; }
};

/// Error of one observation.
struct LensResidual {
  Eigen::Vector2d u;      ///< [px] where it was observed
  Eigen::Vector2d error;  ///< [px] projection minus observation
};

/// Bundle adjustment of the keyframes of one map, with the lens as an unknown that it shares with
/// other segments: poses and points are eliminated, so that a small system in the lens remains.
///
/// Gauge: the first pose and the distance of the farthest keyframe from it are fixed.
class LensSegment {
 public:
  /// Displacements of the pixels that the lens does not describe: each of x and y is a sum of
  /// products of Chebyshev polynomials over the image, of total degree up to kFieldDegree.
  static constexpr int kFieldDegree = 4;
  static constexpr int kFieldTerms = (kFieldDegree + 1) * (kFieldDegree + 2) / 2;
  static constexpr int kFieldParameters = 2 * kFieldTerms;

  /// Normal equations after elimination of poses and points: A delta = -b minimises the cost. Rows:
  /// the lens, then, if requested, the coefficients of the field [px] in x, then those in y.
  struct Reduced {
    Eigen::MatrixXd A;
    Eigen::VectorXd b;
    /// The parts of the tracks in b, lens only.
    std::vector<LensVector> scores;
  };

  /// T_w_c: initial poses; at least two positions differ. The points are triangulated; tracks that
  /// do not reproject are marked as outliers.
  LensSegment(const std::vector<Eigen::Isometry3d>& T_w_c, std::vector<LensTrack> tracks,
              const Lens& lens, const TrackNoise& noise);

  /// Linearises at the current poses and points. damping: of Levenberg-Marquardt.
  Reduced reduce(const Lens& lens, const TrackNoise& noise, double damping);
  /// The same without damping, with the field and the scores.
  Reduced reduceWithField(const Lens& lens, const TrackNoise& noise);
  /// Moves poses and points to the minimum of the last reduce() for this change of the lens.
  void update(const LensVector& lens_delta);
  /// Restores poses and points from before the last update().
  void undo();

  double cost(const Lens& lens, const TrackNoise& noise) const;
  /// Of each used track: whitened squared residuals per redundancy [px^2].
  std::vector<double> variances(const Lens& lens) const;
  std::vector<LensResidual> residuals(const Lens& lens) const;
  /// Rejects observations with larger errors, and tracks with less than min_observations left or
  /// less than half of theirs. Rejections are final.
  void rejectOutliers(const Lens& lens, const TrackNoise& noise, double max_error_px,
                      std::size_t min_observations);

  const std::vector<LensTrack>& tracks() const { return tracks_; }
  std::size_t keyframes() const { return T_c_w_.size(); }
  double turned() const;  ///< largest angle between the first keyframe and another [rad]

 private:
  using Jacobian26 = Eigen::Matrix<double, 2, 6>;
  using Matrix23 = Eigen::Matrix<double, 2, 3>;
  /// A row for x of each observation of a track, then one for y of each.
  template <int kColumns>
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, kColumns, Eigen::ColMajor,
                             2 * kMaxTrackKeyframes, kColumns>;

  /// A track at the current poses and point.
  template <int kParameters>
  struct Linearisation {
    std::vector<Jacobian26> J_c;   ///< of each observation by its pose
    Rows<3 + kParameters + 1> J;   ///< by point, lens and field; the error
    Rows<3 + kParameters + 1> WJ;  ///< W: weighted information of the track
    double weight = 0;             ///< W = weight * LensTrack::information
  };
  /// What update() needs of an observation and of a track.
  struct Observation {
    Jacobian26 J_c;
    Matrix23 WJ_p;
  };
  struct Elimination {
    std::size_t track, first_observation;  ///< indices in tracks_ and observations_
    Eigen::Matrix3d H_pp_inverse;
    Eigen::Vector3d g_p;
    Eigen::Matrix<double, 3, kLensParameters> H_pl;
  };
  /// Normal equations without the points: poses c, lens and field l. The gradient is the last
  /// column of cl and ll.
  struct Schur {
    Eigen::MatrixXd cc;  ///< the lower part within the band
    Eigen::MatrixXd cl, ll;
    Eigen::VectorXd diagonal;  ///< of cc before the elimination of the points
  };

  void triangulate(const Lens& lens, LensTrack* track) const;
  Eigen::Vector3d inCamera(const LensTrack& track, std::size_t keyframe) const;
  bool project(const Lens& lens, const LensTrack& track, const LensObservation& observation,
               Eigen::Vector2d* error) const;
  /// One row of (x, y) for each observation; empty when a point is behind a camera.
  Eigen::MatrixX2d errors(const Lens& lens, const LensTrack& track) const;
  template <int kParameters>
  bool linearise(const Lens& lens, const TrackNoise& noise, const LensTrack& track,
                 Linearisation<kParameters>* result) const;
  template <int kParameters>
  void eliminate(std::size_t index, const Linearisation<kParameters>& system, double damping);
  template <int kParameters>
  void assemble(const Lens& lens, const TrackNoise& noise, double damping);
  Reduced solve();
  void fixGauge();

  std::vector<Eigen::Isometry3d> T_c_w_;
  std::vector<Eigen::Isometry3d> initial_T_w_c_;
  std::vector<LensTrack> tracks_;
  std::size_t farthest_ = 0;  ///< the keyframe farthest from the first one

  Eigen::Index band_ = 0;  ///< rows below the diagonal in which the poses are coupled

  // Of the last reduce(). The first pose has no rows; six for each other one.
  Schur schur_;
  std::vector<Observation> observations_;
  std::vector<Elimination> eliminations_;
  Eigen::MatrixXd poses_per_lens_;  ///< S_cc^-1 S_cl
  Eigen::VectorXd poses_;           ///< S_cc^-1 g_c

  std::vector<Eigen::Isometry3d> previous_poses_;
  std::vector<Eigen::Vector3d> previous_points_;
};

}  // namespace gsv
