#pragma once

#include <ceres/ceres.h>

#include <array>
#include <cmath>
#include <deque>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/vo/local_bundle_adjustment.hpp"

namespace ground_scale_vo::test {

// As in LocalBundleAdjustment: least ratio of the depth in the observer to that in the anchor, and
// least number of landmarks.
constexpr double kMinDepthRatio = 1e-3;
constexpr std::size_t kMinLandmarks = 10;

/// Rotation vector, then translation, of T_r_c; r is the newest keyframe, so that the rotations
/// stay far from the singularity at 2 pi.
using PoseParameters = std::array<double, 6>;

/// exp(w), w a rotation vector.
inline Eigen::Matrix3d rotation(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  if (angle < 1e-12) return Eigen::Matrix3d::Identity() + skew(w);
  return Eigen::AngleAxisd(angle, w / angle).toRotationMatrix();
}

/// Jr of SO(3): exp(w + d) = exp(w) exp(Jr(w) d) for small d.
inline Eigen::Matrix3d rightJacobian(const Eigen::Vector3d& w) {
  const double angle2 = w.squaredNorm(), angle = std::sqrt(angle2);
  const Eigen::Matrix3d W = skew(w);
  if (angle < 1e-6) return Eigen::Matrix3d::Identity() - 0.5 * W + W * W / 6.0;
  return Eigen::Matrix3d::Identity() - (1 - std::cos(angle)) / angle2 * W +
         (angle - std::sin(angle)) / (angle2 * angle) * W * W;
}

/// Residual of one observation; a: anchor, o: observer, rho: inverse depth. The point seen from
/// camera o is, up to scale, q = R_o^T y with y = R_a ray + rho (t_a - t_o). The residual is
/// (q_xy / q_z - x) / sigma.
class ReprojectionCost : public ceres::SizedCostFunction<2, 6, 6, 1> {
 public:
  ReprojectionCost(const Eigen::Vector3d& ray, const Observation& observation)
      : ray_(ray), x_(observation.x), weight_(1 / observation.sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> w_a(parameters[0]), t_a(parameters[0] + 3);
    const Eigen::Map<const Eigen::Vector3d> w_o(parameters[1]), t_o(parameters[1] + 3);
    const double rho = parameters[2][0];
    const Eigen::Matrix3d R_a = rotation(w_a);
    const Eigen::Matrix3d R_o_T = rotation(w_o).transpose();
    const Eigen::Vector3d y = R_a * ray_ + rho * (t_a - t_o);
    const Eigen::Vector3d q = R_o_T * y;
    // A step may go a little beyond the limit for observations.
    if (q.z() < 0.1 * kMinDepthRatio) return false;

    Eigen::Map<Eigen::Vector2d> r(residuals);
    r = weight_ * (q.head<2>() / q.z() - x_);
    if (!jacobians) return true;

    Eigen::Matrix<double, 2, 3> P;
    P << 1 / q.z(), 0, -q.x() / (q.z() * q.z()), 0, 1 / q.z(), -q.y() / (q.z() * q.z());
    const Eigen::Matrix<double, 2, 3> PR = weight_ * P * R_o_T;
    using Jacobian26 = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;
    if (jacobians[0]) {
      Eigen::Map<Jacobian26> J(jacobians[0]);
      J.leftCols<3>() = -PR * R_a * skew(ray_) * rightJacobian(w_a);
      J.rightCols<3>() = rho * PR;
    }
    if (jacobians[1]) {
      Eigen::Map<Jacobian26> J(jacobians[1]);
      J.leftCols<3>() = PR * skew(y) * rightJacobian(-w_o);
      J.rightCols<3>() = -rho * PR;
    }
    if (jacobians[2]) {
      Eigen::Map<Eigen::Vector2d> J(jacobians[2]);
      J = PR * (t_a - t_o);
    }
    return true;
  }

 private:
  Eigen::Vector3d ray_;
  Eigen::Vector2d x_;
  double weight_;
};

inline PoseParameters toParameters(const Eigen::Isometry3d& T) {
  const Eigen::AngleAxisd aa(T.linear());
  const Eigen::Vector3d w = aa.angle() * aa.axis(), t = T.translation();
  return {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()};
}

inline Eigen::Isometry3d toPose(const PoseParameters& p) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation({p[0], p[1], p[2]});
  T.translation() = Eigen::Vector3d(p[3], p[4], p[5]);
  return T;
}

/// The same problem as LocalBundleAdjustment, solved by Ceres with another parametrisation.
inline LocalBundleAdjustment::Result adjustWithCeres(const LocalBundleAdjustment::Options& options,
                                                     LocalMap* map) {
  LocalBundleAdjustment::Result result;
  std::deque<Keyframe>& keyframes = map->keyframes();
  if (keyframes.size() < 2) return result;

  const std::size_t window = static_cast<std::size_t>(options.window);
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
  for (auto& [id, landmark] : map->landmarks()) {
    if (!landmark.depth || landmark.observations.size() < 2) continue;
    if (landmark.observations.back().keyframe - first_id < first_free) continue;
    adjusted.push_back({&landmark, landmark.depth->value});
  }
  if (adjusted.size() < kMinLandmarks) return result;

  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::HuberLoss loss(options.huber_sigma);
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
      // As in LocalBundleAdjustment: leave out observations from behind the camera.
      const Eigen::Vector3d q =
          keyframes[observer].T_w_c.inverse() *
          (keyframes[anchor].T_w_c * Eigen::Vector3d(a.landmark->ray() / a.inverse_depth));
      if (q.z() < kMinDepthRatio / a.inverse_depth) continue;
      problem.AddResidualBlock(new ReprojectionCost(a.landmark->ray(), observations[i]), &loss,
                               poses[anchor].data(), poses[observer].data(), &a.inverse_depth);
    }
  }
  const bool scale_is_free = first_free < 2;
  const double length =
      (keyframes.back().T_w_c.translation() - keyframes.front().T_w_c.translation()).norm();

  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.linear_solver_ordering.reset(ordering);
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (!summary.IsSolutionUsable()) return result;

  for (std::size_t i = first_free; i < keyframes.size(); ++i) {
    keyframes[i].T_w_c = T_w_r * toPose(poses[i]);
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

  result.usable = true;
  result.residuals = summary.num_residuals;
  result.rms_sigma = std::sqrt(2 * summary.final_cost / std::max(1, summary.num_residuals));
  return result;
}

}  // namespace ground_scale_vo::test
