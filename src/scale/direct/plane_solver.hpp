#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/scale/direct_plane_estimator.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "scale/direct/image_buffer.hpp"
#include "scale/direct/patch.hpp"
#include "scale/direct/patch_matcher.hpp"

namespace ground_scale_vo::direct {

/// Robust Gauss-Newton estimate of the plane m = n / h from the epipolar shifts of all patches in
/// all reference images.
///
/// Unknowns: m (3), the curvature of the road along the path, across it (crown) and its twist (3),
/// and for each reference image the error of its relative pose (3 rotation, 2 direction of
/// translation), which is marginalised out by the Schur complement. Priors: on the normal, the
/// curvatures and the pose errors.
class PlaneSolver {
 public:
  explicit PlaneSolver(const DirectPlaneEstimator::Options& options) : options_(options) {}

  /// Starts at the plane `initial`. The result is the height of a camera at origin_c, in this
  /// frame's camera axes [VO units]. Its status is kNone or kNoPlane.
  DirectPlaneEstimator::Result solve(const std::vector<Patch>& patches,
                                     const std::vector<Reference>& references,
                                     const PatchMatcher& matcher, const NormalPrior& prior,
                                     const GroundPlane& initial, const Eigen::Vector3d& origin_c);

 private:
  using Result = DirectPlaneEstimator::Result;
  using Matrix11d = Eigen::Matrix<double, 11, 11>;
  using Vector11d = Eigen::Matrix<double, 11, 1>;
  /// Normal equations H x = b of the plane, the curvatures and one reference's motion error.
  struct JointEquations {
    Matrix11d H;
    Vector11d b;
  };
  /// Of the plane (first three) and the curvatures.
  struct PlaneEquations {
    Matrix6d H = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
  };

  bool matchPatches(const std::vector<Patch>& patches, const std::vector<Reference>& references,
                    const PatchMatcher& matcher, const Eigen::Vector3f& m, bool linearise,
                    Result* result);
  double shiftVariance(const Match& match, const Eigen::Vector3f& m) const;
  void accumulate(const std::vector<Patch>& patches, std::size_t reference_count,
                  const NormalPrior& prior, const Eigen::Vector3d& m, double initial_height,
                  const Eigen::Vector3d& origin_c, double robust_scale);
  PlaneEquations marginaliseMotion(std::size_t reference_count);
  void addPriors(const NormalPrior& prior, const Eigen::Vector3d& m, double initial_height,
                 PlaneEquations* equations) const;
  void accept(const Eigen::Vector3d& m, const Matrix6d& H, double initial_height,
              const Eigen::Vector3d& origin_c, Result* result) const;

  DirectPlaneEstimator::Options options_;
  std::vector<Match> matches_;  ///< of patch i in reference k: i * kReferences + k
  std::vector<double> normalised_shifts_;
  std::array<JointEquations, kReferences> joint_;
};

}  // namespace ground_scale_vo::direct
