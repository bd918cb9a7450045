#pragma once

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <array>
#include <cmath>
#include <deque>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "support/scene.hpp"
#include "vo/bundle_adjustment.hpp"

namespace gsv::test {

// As in BundleAdjustment: least ratio of the depth in the observer to that in the anchor, and
// least number of landmarks.
constexpr double kMinDepthRatio = 1e-3;
constexpr std::size_t kMinLandmarks = 10;

/// Rotation vector, then translation, of T_r_c; r is the newest keyframe, so that the rotations
/// stay far from the singularity at 2 pi.
using PoseParameters = std::array<double, 6>;

/// Residual of one observation; a: anchor, o: observer, rho: inverse depth. The point seen from
/// camera o is, up to scale, q = R_o^T (R_a ray + rho (t_a - t_o)). The residual is
/// (q_xy / q_z - x) / sigma.
struct ReprojectionCost {
  Eigen::Vector3d ray;
  Eigen::Vector2d x;
  double sigma;

  template <typename T>
  bool operator()(const T* pose_a, const T* pose_o, const T* rho, T* residual) const {
    const Eigen::Matrix<T, 3, 1> ray_c = ray.cast<T>();
    Eigen::Matrix<T, 3, 1> y, q;
    ceres::AngleAxisRotatePoint(pose_a, ray_c.data(), y.data());
    for (int i = 0; i < 3; ++i) y[i] += *rho * (pose_a[3 + i] - pose_o[3 + i]);
    const T inverse[3] = {-pose_o[0], -pose_o[1], -pose_o[2]};
    ceres::AngleAxisRotatePoint(inverse, y.data(), q.data());
    // A step may go a little beyond the limit for observations.
    if (q.z() < T(0.1 * kMinDepthRatio)) return false;
    for (int i = 0; i < 2; ++i) residual[i] = (q[i] / q.z() - x[i]) / sigma;
    return true;
  }
};

inline PoseParameters toParameters(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d w = rotationVector(T.linear()), t = T.translation();
  return {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()};
}

/// The same problem as BundleAdjustment, solved by Ceres with another parametrisation.
inline bool adjustWithCeres(int adjusted_keyframes, LocalMap* map) {
  std::deque<Keyframe>& keyframes = map->keyframes();
  if (keyframes.size() < 2) return false;

  const std::size_t window = static_cast<std::size_t>(adjusted_keyframes);
  const std::size_t first_free = keyframes.size() > window ? keyframes.size() - window : 1;
  const std::uint32_t first_id = keyframes.front().id;
  const Eigen::Isometry3d T_w_r = keyframes.back().T_w_c;
  std::vector<PoseParameters> poses;
  for (const Keyframe& keyframe : keyframes) {
    poses.push_back(toParameters(T_w_r.inverse() * keyframe.T_w_c));
  }

  struct Adjusted {
    Landmark* landmark;
    double inverse_depth;
  };
  std::vector<Adjusted> adjusted;
  for (Landmark& landmark : map->landmarks()) {
    if (!landmark.depth || landmark.observations.size() < 2) continue;
    if (landmark.observations.back().keyframe - first_id < first_free) continue;
    adjusted.push_back({&landmark, landmark.depth->value});
  }
  if (adjusted.size() < kMinLandmarks) return false;

  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::HuberLoss loss(kHuberSigma);
  ceres::Problem problem(problem_options);
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    problem.AddParameterBlock(poses[i].data(), 6);
    ordering->AddElementToGroup(poses[i].data(), 1);
    if (i < first_free) problem.SetParameterBlockConstant(poses[i].data());
  }
  for (Adjusted& a : adjusted) {
    problem.AddParameterBlock(&a.inverse_depth, 1);
    ordering->AddElementToGroup(&a.inverse_depth, 0);
    const auto& observations = a.landmark->observations;
    const std::size_t anchor = observations.front().keyframe - first_id;
    for (std::size_t i = 1; i < observations.size(); ++i) {
      const std::size_t observer = observations[i].keyframe - first_id;
      // As in BundleAdjustment: leave out observations from behind the camera.
      const Eigen::Vector3d q =
          keyframes[observer].T_w_c.inverse() *
          (keyframes[anchor].T_w_c * Eigen::Vector3d(a.landmark->ray() / a.inverse_depth));
      if (q.z() < kMinDepthRatio / a.inverse_depth) continue;
      auto* const cost = new ceres::AutoDiffCostFunction<ReprojectionCost, 2, 6, 6, 1>(
          new ReprojectionCost{a.landmark->ray(), observations[i].x, observations[i].sigma});
      problem.AddResidualBlock(cost, &loss, poses[anchor].data(), poses[observer].data(),
                               &a.inverse_depth);
    }
  }
  const bool scale_is_free = first_free < 2;
  const double length =
      (keyframes.back().T_w_c.translation() - keyframes.front().T_w_c.translation()).norm();

  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.linear_solver_ordering.reset(ordering);
  solver.max_num_iterations = kMaxAdjustmentIterations;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (!summary.IsSolutionUsable()) return false;

  for (std::size_t i = first_free; i < keyframes.size(); ++i) {
    const double* const p = poses[i].data();
    keyframes[i].T_w_c = T_w_r * pose(Eigen::Vector3d(p), Eigen::Vector3d(p + 3));
  }
  double unit = 1;
  if (scale_is_free) {
    const Eigen::Vector3d origin = keyframes.front().T_w_c.translation();
    const double adjusted_length = (keyframes.back().T_w_c.translation() - origin).norm();
    if (length > 0 && adjusted_length > 0) unit = length / adjusted_length;
    for (Keyframe& keyframe : keyframes) {
      keyframe.T_w_c.translation() = origin + unit * (keyframe.T_w_c.translation() - origin);
    }
  }
  for (const Adjusted& a : adjusted) a.landmark->depth->value = a.inverse_depth / unit;
  return true;
}

}  // namespace gsv::test
