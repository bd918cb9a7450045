#include "ground_scale_vo/vo/local_bundle_adjustment.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {
namespace {

/// Minimum depth of a landmark in its observer, relative to its depth in the anchor. A landmark
/// with a smaller ratio is behind or beside the observer.
constexpr double kMinAdjustedDepthRatio = 1e-3;
/// Minimum of the same ratio after a step; below it the cost is infinite.
constexpr double kMinStepDepthRatio = 0.1 * kMinAdjustedDepthRatio;
/// [landmarks] minimum number that constrains the poses.
constexpr std::size_t kMinLandmarks = 10;
constexpr std::size_t kNone = static_cast<std::size_t>(-1);

// Levenberg-Marquardt with the damping rule of Nielsen (Madsen, Nielsen, Tingleff 2004, sec. 3.2).
constexpr double kInitialDamping = 1e-4;     // relative to the diagonal of the Hessian
constexpr double kMinDiagonal = 1e-6;        // of the Hessian, for the damping
constexpr double kMinGainRatio = 1e-3;       // cost decrease over the model's; less: rejected
constexpr double kInitialDampingGrowth = 2;  // after a rejected step; doubles with each further one
constexpr double kMinDampingFactor = 1.0 / 3;  // after an accepted step
constexpr double kCostTolerance = 1e-6;        // relative change of the cost at convergence

}  // namespace

/// The optimisation problem in flat arrays. A keyframe is numbered by its position in the map.
/// Keyframes before `first_free` are fixed; the others have six rows each.
struct LocalBundleAdjustment::Problem {
  /// The first observation of a landmark is that of its anchor, which has no residual.
  struct Observation {
    std::size_t keyframe;
    std::size_t relative_pose;  // T_o_a; kNone for the anchor
    Eigen::Vector2d x;          // normalised image coordinates
    double weight;              // 1 / sigma
    Vector6d H_pl;  // pose-landmark block of the Hessian: this keyframe's pose, the inverse depth
  };
  struct Landmark {
    std::uint64_t id;
    Eigen::Vector3d ray;     // in the anchor, z = 1
    std::size_t begin, end;  // of its observations, by keyframe
    double H_ll, gradient;   // over its inverse depth
  };
  struct State {
    std::vector<Eigen::Isometry3d> T_w_c;
    std::vector<double> inverse_depth;
  };
  /// Relative pose of an observer o and an anchor a, shared by all landmarks of the anchor that the
  /// observer observes.
  struct RelativePose {
    std::size_t observer, anchor;
    Eigen::Isometry3d T_o_a;
    Matrix6d H_oo;  // sums over these landmarks, over the observer's pose
    Vector6d gradient;
  };

  std::size_t first_free = 0;
  std::vector<Landmark> landmarks;
  std::vector<Observation> observations;
  std::vector<RelativePose> relative_poses;
  std::vector<std::size_t> relative_pose_of;  // [observer * keyframes + anchor]; kNone: not needed
  State state, candidate;
  bool usable = false;

  // Normal equations of the poses; lower triangles.
  Eigen::MatrixXd H_pp;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd schur_complement;  // H_pp - H_pl H_ll^-1 H_lp, damped
  Eigen::VectorXd step;

  std::size_t keyframes() const { return state.T_w_c.size(); }
  bool isFixed(std::size_t keyframe) const { return keyframe < first_free; }
  Eigen::Index row(std::size_t keyframe) const {
    return static_cast<Eigen::Index>(6 * (keyframe - first_free));
  }

  // --- loading the map -------------------------------------------------------------------------

  void load(const LocalMap& map, std::size_t window) {
    landmarks.clear();
    observations.clear();
    relative_poses.clear();
    state.T_w_c.clear();
    state.inverse_depth.clear();
    usable = false;
    if (map.keyframes().size() < 2) return;

    for (const Keyframe& keyframe : map.keyframes()) state.T_w_c.push_back(keyframe.T_w_c);
    first_free = keyframes() > window ? keyframes() - window : 1;
    relative_pose_of.assign(keyframes() * keyframes(), kNone);
    const Eigen::Index rows = row(keyframes());
    H_pp.resize(rows, rows);
    gradient.resize(rows);

    const std::uint32_t first_id = map.keyframes().front().id;
    for (const auto& [id, landmark] : map.landmarks()) {
      if (!landmark.depth || landmark.observations.size() < 2) continue;
      if (isFixed(landmark.observations.back().keyframe - first_id)) continue;
      addLandmark(id, landmark, first_id);
    }
  }

  /// Adds a landmark with its observations, unless fewer than two can be used.
  void addLandmark(std::uint64_t id, const ground_scale_vo::Landmark& landmark,
                   std::uint32_t first_id) {
    const Eigen::Vector3d ray = landmark.ray();
    const std::size_t begin = observations.size();
    for (const auto& o : landmark.observations) {
      const std::size_t keyframe = o.keyframe - first_id;
      std::size_t relative_pose = kNone;
      if (observations.size() > begin) {
        relative_pose = relativePose(keyframe, observations[begin].keyframe);
        // No descent leads from behind a camera to its front: leave such an observation out.
        const RayProjection projection =
            projectOnRay(ray, landmark.depth->value, relative_poses[relative_pose].T_o_a);
        if (projection.p.z() < kMinAdjustedDepthRatio) continue;
      }
      observations.push_back({keyframe, relative_pose, o.x, 1 / o.sigma, Vector6d::Zero()});
    }
    if (observations.size() < begin + 2) {
      observations.resize(begin);
      return;
    }
    landmarks.push_back({id, ray, begin, observations.size(), 0, 0});
    state.inverse_depth.push_back(landmark.depth->value);
  }

  std::size_t relativePose(std::size_t observer, std::size_t anchor) {
    std::size_t& index = relative_pose_of[observer * keyframes() + anchor];
    if (index == kNone) {
      index = relative_poses.size();
      relative_poses.push_back({observer, anchor,
                                state.T_w_c[observer].inverse() * state.T_w_c[anchor],
                                Matrix6d::Zero(), Vector6d::Zero()});
    }
    return index;
  }

  // --- cost and normal equations ---------------------------------------------------------------

  /// Half the sum of squares with Huber's loss; infinite when a landmark is behind a camera. Leaves
  /// the relative poses as they are in this state.
  double cost(const State& of, double huber) {
    for (RelativePose& relative : relative_poses) {
      relative.T_o_a = of.T_w_c[relative.observer].inverse() * of.T_w_c[relative.anchor];
    }
    double sum = 0;
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Landmark& landmark = landmarks[i];
      for (std::size_t k = landmark.begin + 1; k < landmark.end; ++k) {
        const Observation& o = observations[k];
        const Eigen::Isometry3d& T_o_a = relative_poses[o.relative_pose].T_o_a;
        const Eigen::Vector3d q =
            T_o_a.linear() * landmark.ray + of.inverse_depth[i] * T_o_a.translation();
        if (q.z() < kMinStepDepthRatio) return std::numeric_limits<double>::infinity();
        const double r = o.weight * (q.head<2>() / q.z() - o.x).norm();
        sum += r > huber ? huber * (2 * r - huber) : r * r;
      }
    }
    return 0.5 * sum;
  }

  /// Gradient and Gauss-Newton Hessian at `state`, whose cost was computed last.
  void linearise(double huber) {
    for (RelativePose& relative : relative_poses) {
      relative.H_oo.setZero();
      relative.gradient.setZero();
    }
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      lineariseLandmark(huber, state.inverse_depth[i], &landmarks[i]);
    }
    sumPoseBlocks();
  }

  void lineariseLandmark(double huber, double rho, Landmark* landmark) {
    landmark->H_ll = landmark->gradient = 0;
    Eigen::Vector3d anchor_sum = Eigen::Vector3d::Zero();  // of R_o_a^T P^T j
    for (std::size_t k = landmark->begin + 1; k < landmark->end; ++k) {
      Observation& o = observations[k];
      RelativePose& relative = relative_poses[o.relative_pose];
      const Eigen::Vector3d& t = relative.T_o_a.translation();
      const Eigen::Vector3d q = relative.T_o_a.linear() * landmark->ray + rho * t;
      const Eigen::Vector2d u = q.head<2>() / q.z();
      Eigen::Vector2d r = o.weight * (u - o.x);
      const double norm = r.norm();
      const double robust = norm > huber ? std::sqrt(huber / norm) : 1;
      r *= robust;
      const double m = robust * o.weight, m_z = m / q.z();
      Eigen::Matrix<double, 2, 3> P;  // dr / dq
      P << m_z, 0, -m_z * u.x(), 0, m_z, -m_z * u.y();
      const Eigen::Vector2d j = P * t;  // dr / drho
      landmark->H_ll += j.squaredNorm();
      landmark->gradient += j.dot(r);
      if (isFixed(o.keyframe)) continue;
      // Over the observer's pose: P [skew(q), -rho I]. Its transpose, so that Eigen vectorises.
      Eigen::Matrix<double, 6, 2> Jt;
      Jt.col(0).head<3>() << m * u.x() * u.y(), -m * (1 + u.x() * u.x()), m * u.y();
      Jt.col(1).head<3>() << m * (1 + u.y() * u.y()), -m * u.x() * u.y(), -m * u.x();
      Jt.bottomRows<3>() = -rho * P.transpose();
      relative.H_oo.noalias() += Jt * Jt.transpose();
      relative.gradient.noalias() += Jt * r;
      o.H_pl.noalias() = Jt * j;
      anchor_sum.noalias() += relative.T_o_a.linear().transpose() * (P.transpose() * j);
    }
    observations[landmark->begin].H_pl << landmark->ray.cross(anchor_sum), rho * anchor_sum;
  }

  /// H_pp and the gradient of the poses. A residual depends on T_o_a alone: a motion of the anchor
  /// acts like minus its adjoint on the observer.
  void sumPoseBlocks() {
    H_pp.setZero();
    gradient.setZero();
    for (const RelativePose& relative : relative_poses) {
      if (isFixed(relative.observer)) continue;
      const Eigen::Index o = row(relative.observer);
      H_pp.block<6, 6>(o, o) += relative.H_oo;
      gradient.segment<6>(o) += relative.gradient;
      if (isFixed(relative.anchor)) continue;
      const Eigen::Index a = row(relative.anchor);
      const Matrix6d A = adjoint(relative.T_o_a), HA = relative.H_oo * A;
      H_pp.block<6, 6>(o, a) -= HA;
      H_pp.block<6, 6>(a, a).noalias() += A.transpose() * HA;
      gradient.segment<6>(a).noalias() -= A.transpose() * relative.gradient;
    }
  }

  // --- Levenberg-Marquardt ---------------------------------------------------------------------

  /// Damping term of a diagonal element of the Hessian.
  static double addedDiagonal(double diagonal, double damping) {
    return damping * std::max(diagonal, kMinDiagonal);
  }

  /// Fills `candidate` with the minimum of the damped quadratic model. Returns the decrease of the
  /// undamped model's cost; empty when the equations have no solution.
  std::optional<double> makeStep(double damping) {
    schur_complement = H_pp;
    step = -gradient;
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      schur_complement(i, i) += addedDiagonal(H_pp(i, i), damping);
    }
    for (const Landmark& landmark : landmarks) eliminate(landmark, damping);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> cholesky(schur_complement);  // in place
    if (cholesky.info() != Eigen::Success) return std::nullopt;
    cholesky.solveInPlace(step);
    if (!isFinite(step)) return std::nullopt;

    // With (H + D) s = -g the model changes by g s + s H s / 2 = (g s - s D s) / 2.
    double decrease = 0;
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      decrease += 0.5 * step(i) * (addedDiagonal(H_pp(i, i), damping) * step(i) - gradient(i));
    }
    candidate = state;
    for (std::size_t k = first_free; k < keyframes(); ++k) {
      candidate.T_w_c[k] = boxplus(state.T_w_c[k], step.segment<6>(row(k)));
    }
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Landmark& landmark = landmarks[i];
      const double d = addedDiagonal(landmark.H_ll, damping);
      const double s = -gradientAfterPoseStep(landmark) / (landmark.H_ll + d);
      decrease += 0.5 * s * (d * s - landmark.gradient);
      candidate.inverse_depth[i] += s;
    }
    return decrease;
  }

  /// Subtracts H_pl (H_ll + D)^-1 H_lp from the Schur complement and the same from its right side.
  void eliminate(const Landmark& landmark, double damping) {
    const double h = landmark.H_ll + addedDiagonal(landmark.H_ll, damping);
    for (std::size_t a = landmark.begin; a < landmark.end; ++a) {
      const Observation& o_a = observations[a];
      if (isFixed(o_a.keyframe)) continue;
      const Vector6d e = o_a.H_pl / h;
      step.segment<6>(row(o_a.keyframe)) += landmark.gradient * e;
      for (std::size_t b = a; b < landmark.end; ++b) {
        const Observation& o_b = observations[b];
        schur_complement.block<6, 6>(row(o_b.keyframe), row(o_a.keyframe)).noalias() -=
            o_b.H_pl * e.transpose();
      }
    }
  }

  /// Back substitution: gradient with respect to the inverse depth after the step of the poses.
  double gradientAfterPoseStep(const Landmark& landmark) const {
    double reduced = landmark.gradient;
    for (std::size_t k = landmark.begin; k < landmark.end; ++k) {
      const Observation& o = observations[k];
      if (isFixed(o.keyframe)) continue;
      reduced += o.H_pl.dot(step.segment<6>(row(o.keyframe)));
    }
    return reduced;
  }

  /// Minimises the cost, starting at `state` with cost `now`. Returns the final cost.
  double minimise(int max_iterations, double huber, double now) {
    linearise(huber);
    double damping = kInitialDamping, growth = kInitialDampingGrowth;
    for (int iteration = 1; iteration <= max_iterations; ++iteration) {
      const auto decrease = makeStep(damping);
      usable = usable || decrease;
      const double then =
          decrease ? cost(candidate, huber) : std::numeric_limits<double>::infinity();
      const bool converged = std::abs(now - then) <= kCostTolerance * now;
      const double gain = decrease ? (now - then) / *decrease : 0;
      if (gain > kMinGainRatio) {
        std::swap(state, candidate);
        now = then;
        damping *= std::max(kMinDampingFactor, 1 - std::pow(2 * gain - 1, 3));
        growth = kInitialDampingGrowth;
      } else {
        damping *= growth;
        growth *= 2;
      }
      if (converged) break;
      if (gain > kMinGainRatio && iteration < max_iterations) linearise(huber);
    }
    return now;
  }

  Result solve(int max_iterations, double huber) {
    if (landmarks.size() < kMinLandmarks) return {};
    const double length = baseline();
    const double initial_cost = cost(state, huber);
    if (!isFinite(initial_cost)) return {};
    const double final_cost = minimise(max_iterations, huber, initial_cost);
    if (!usable) return {};

    if (first_free < 2) {
      const double adjusted_length = baseline();
      if (length > 0 && adjusted_length > 0) rescale(length / adjusted_length);
    }
    usable = std::all_of(state.T_w_c.begin(), state.T_w_c.end(),
                         [](const auto& T) { return isFinite(T); }) &&
             isFinite(state.inverse_depth);
    if (!usable) return {};
    Result result;
    result.usable = true;
    result.residuals = static_cast<int>(2 * (observations.size() - landmarks.size()));
    result.rms_sigma = std::sqrt(2 * final_cost / std::max(1, result.residuals));
    return result;
  }

  /// Distance between the first and the newest keyframe.
  double baseline() const {
    return (state.T_w_c.back().translation() - state.T_w_c.front().translation()).norm();
  }

  void rescale(double factor) {
    const Eigen::Vector3d origin = state.T_w_c.front().translation();
    for (Eigen::Isometry3d& T : state.T_w_c) {
      T.translation() = origin + factor * (T.translation() - origin);
    }
    for (double& rho : state.inverse_depth) rho /= factor;
  }

  void store(LocalMap* map) const {
    if (!usable) return;
    for (std::size_t k = first_free; k < keyframes(); ++k) {
      map->keyframes()[k].T_w_c = state.T_w_c[k];
    }
    LandmarkWalk stored(map->landmarks());
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      stored.find(landmarks[i].id)->depth->value = state.inverse_depth[i];
    }
  }
};

void LocalBundleAdjustment::Options::validate() const {
  visitParameters(*this, RangeCheck("bundle_adjustment/"));
}

LocalBundleAdjustment::LocalBundleAdjustment(const Options& options)
    : options_((options.validate(), options)), problem_(std::make_unique<Problem>()) {}

LocalBundleAdjustment::~LocalBundleAdjustment() = default;

LocalBundleAdjustment::Result LocalBundleAdjustment::adjust(LocalMap* map) {
  load(*map);
  const Result result = solve();
  store(map);
  return result;
}

void LocalBundleAdjustment::load(const LocalMap& map) {
  problem_->load(map, static_cast<std::size_t>(options_.window));
}

LocalBundleAdjustment::Result LocalBundleAdjustment::solve() {
  return problem_->solve(options_.max_iterations, options_.huber_sigma);
}

void LocalBundleAdjustment::store(LocalMap* map) const { problem_->store(map); }

}  // namespace ground_scale_vo
