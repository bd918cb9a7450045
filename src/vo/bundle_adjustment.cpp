#include "vo/bundle_adjustment.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/reprojections.hpp"

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
  /// Its rows (Reprojections) are those of its fixed observers, then one per free keyframe from the
  /// first to the last that observes it, so that sums over them need no indices. The anchor has no
  /// residual; a keyframe between these that does not observe the landmark has a row of zeros.
  struct Landmark {
    std::uint64_t id;
    bool free_anchor;
    std::size_t begin, free_begin, end;  // of its rows
    std::size_t first_block;             // free keyframe of the row free_begin
    double H_ll, gradient;               // over its inverse depth

    std::size_t blocks() const { return end - free_begin; }
  };
  struct State {
    std::vector<Eigen::Isometry3d> T_w_c;
    std::vector<double> inverse_depth;
  };
  /// Relative pose of an observer o and an anchor a, shared by all landmarks of the anchor that the
  /// observer observes: a group of residuals.
  struct RelativePose {
    std::size_t observer, anchor;
    Eigen::Isometry3d T_o_a;
  };

  std::size_t first_free = 0;
  std::vector<Landmark> landmarks;
  std::vector<Eigen::Vector3d> rays;  // of the landmarks, in the anchor, z = 1
  std::vector<Reprojections::Residual> residuals;
  std::vector<RelativePose> relative_poses;
  std::vector<std::size_t> relative_pose_of;  // [observer * keyframes + anchor]; kNone: not needed
  State state, candidate;
  bool usable = false;

  Reprojections reprojections;
  std::vector<double> rows;         // of the landmarks
  std::vector<double> anchor_sums;  // three numbers per landmark

  // Normal equations of the poses; lower triangles.
  Eigen::MatrixXd H_pp;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd schur_complement;  // H_pp - H_pl H_ll^-1 H_lp, damped
  Eigen::VectorXd step;
  // Sum over the landmarks of H_pl H_ll^-1 H_lp, in rows of kRow numbers per free keyframe.
  std::vector<double> eliminated;
  std::vector<double> padded;  // one row per free keyframe

  std::size_t keyframes() const { return state.T_w_c.size(); }
  bool isFixed(std::size_t keyframe) const { return keyframe < first_free; }
  /// First row of the keyframe in the normal equations.
  Eigen::Index row(std::size_t keyframe) const {
    return static_cast<Eigen::Index>(6 * (keyframe - first_free));
  }
  std::size_t freeKeyframes() const { return keyframes() - first_free; }

  // --- loading the map -------------------------------------------------------------------------

  void load(const LocalMap& map, std::size_t window) {
    landmarks.clear();
    rays.clear();
    residuals.clear();
    relative_poses.clear();
    state.T_w_c.clear();
    state.inverse_depth.clear();
    usable = false;
    if (map.keyframes().size() < 2) return;

    for (const Keyframe& keyframe : map.keyframes()) state.T_w_c.push_back(keyframe.T_w_c);
    first_free = keyframes() > window ? keyframes() - window : 1;
    relative_pose_of.assign(keyframes() * keyframes(), kNone);
    const Eigen::Index size = row(keyframes());
    H_pp.resize(size, size);
    gradient.resize(size);

    const std::uint32_t first_id = map.keyframes().front().id;
    for (const auto& [id, landmark] : map.landmarks()) {
      if (!landmark.depth || landmark.observations.size() < 2) continue;
      if (isFixed(landmark.observations.back().keyframe - first_id)) continue;
      addLandmark(id, landmark, first_id);
    }
    const std::size_t row_count = landmarks.empty() ? 1 : landmarks.back().end;
    rows.assign(Reprojections::kRow * row_count, 0);
    reprojections.assign(residuals, rays, relative_poses.size());
  }

  /// Adds a landmark with its residuals, unless there are none.
  void addLandmark(std::uint64_t id, const ground_scale_vo::Landmark& landmark,
                   std::uint32_t first_id) {
    const Eigen::Vector3d ray = landmark.ray();
    const std::size_t anchor = landmark.observations.front().keyframe - first_id;
    const std::size_t begin =
        landmarks.empty() ? Reprojections::kPaddingRow + 1 : landmarks.back().end;
    Landmark added{id, !isFixed(anchor), begin, begin, begin, 0, 0, 0};
    if (added.free_anchor) addRow(anchor, &added);
    const std::size_t before = residuals.size();
    for (auto o = std::next(landmark.observations.begin()); o != landmark.observations.end(); ++o) {
      const std::size_t keyframe = o->keyframe - first_id;
      const std::size_t group = relativePose(keyframe, anchor);
      // No descent leads from behind a camera to its front: leave such an observation out.
      const RayProjection projection =
          projectOnRay(ray, landmark.depth->value, relative_poses[group].T_o_a);
      if (projection.p.z() < kMinAdjustedDepthRatio) continue;
      residuals.push_back({group, landmarks.size(), addRow(keyframe, &added), o->x, 1 / o->sigma});
    }
    if (residuals.size() == before) return;
    landmarks.push_back(added);
    rays.push_back(ray);
    state.inverse_depth.push_back(landmark.depth->value);
  }

  /// Adds the row of a keyframe, and those of free keyframes between the last one and this one.
  std::size_t addRow(std::size_t keyframe, Landmark* landmark) const {
    if (isFixed(keyframe)) {
      landmark->free_begin = ++landmark->end;
    } else {
      const std::size_t block = keyframe - first_free;
      if (landmark->blocks() == 0) landmark->first_block = block;
      landmark->end = landmark->free_begin + block - landmark->first_block + 1;
    }
    return landmark->end - 1;
  }

  std::size_t relativePose(std::size_t observer, std::size_t anchor) {
    std::size_t& index = relative_pose_of[observer * keyframes() + anchor];
    if (index == kNone) {
      index = relative_poses.size();
      relative_poses.push_back(
          {observer, anchor, state.T_w_c[observer].inverse() * state.T_w_c[anchor]});
    }
    return index;
  }

  // --- cost and normal equations ---------------------------------------------------------------

  /// Half the sum of squares with Huber's loss; infinite when a landmark is behind a camera. Leaves
  /// the relative poses as they are in this state.
  double cost(const State& of, double huber) {
    double sum = 0;
    for (std::size_t g = 0; g < relative_poses.size(); ++g) {
      RelativePose& relative = relative_poses[g];
      relative.T_o_a = of.T_w_c[relative.observer].inverse() * of.T_w_c[relative.anchor];
      sum += reprojections.cost(g, relative.T_o_a, of.inverse_depth, huber, kMinStepDepthRatio);
    }
    return sum;
  }

  /// Gradient and Gauss-Newton Hessian at `state`, whose cost was computed last.
  void linearise() {
    H_pp.setZero();
    gradient.setZero();
    anchor_sums.assign(3 * landmarks.size(), 0);
    for (std::size_t g = 0; g < relative_poses.size(); ++g) {
      const RelativePose& relative = relative_poses[g];
      if (isFixed(relative.observer)) {
        reprojections.lineariseDepths(g, relative.T_o_a, rows.data());
      } else {
        addPoseBlocks(relative,
                      reprojections.linearise(g, relative.T_o_a, rows.data(), anchor_sums.data()));
      }
    }
    for (std::size_t i = 0; i < landmarks.size(); ++i) finishLandmark(i);
  }

  /// Adds to H_pp and the gradient of the poses. A residual depends on T_o_a alone: a motion of the
  /// anchor acts like minus its adjoint on the observer.
  void addPoseBlocks(const RelativePose& relative, const Reprojections::Blocks& blocks) {
    const Eigen::Index o = row(relative.observer);
    H_pp.block<6, 6>(o, o) += blocks.H_oo;
    gradient.segment<6>(o) += blocks.gradient;
    if (isFixed(relative.anchor)) return;
    const Eigen::Index a = row(relative.anchor);
    const Matrix6d A = adjoint(relative.T_o_a), HA = blocks.H_oo * A;
    H_pp.block<6, 6>(o, a) -= HA;
    H_pp.block<6, 6>(a, a).noalias() += A.transpose() * HA;
    gradient.segment<6>(a).noalias() -= A.transpose() * blocks.gradient;
  }

  /// Sums the rows of a landmark, and fills that of its anchor.
  void finishLandmark(std::size_t i) {
    Landmark& landmark = landmarks[i];
    landmark.H_ll = landmark.gradient = 0;
    for (std::size_t k = landmark.begin; k < landmark.end; ++k) {
      const double* const row = &rows[Reprojections::kRow * k];
      landmark.H_ll += row[6];
      landmark.gradient += row[7];
    }
    if (!landmark.free_anchor) return;
    const Eigen::Map<const Eigen::Vector3d> sum(&anchor_sums[3 * i]);
    Eigen::Map<Vector6d>(&rows[Reprojections::kRow * landmark.begin]) << rays[i].cross(sum),
        state.inverse_depth[i] * sum;
  }

  // --- Levenberg-Marquardt ---------------------------------------------------------------------

  /// Damping term of a diagonal element of the Hessian.
  static double addedDiagonal(double diagonal, double damping) {
    return damping * std::max(diagonal, kMinDiagonal);
  }

  /// Fills `candidate` with the minimum of the damped quadratic model. Returns the decrease of the
  /// undamped model's cost; empty when the equations have no solution.
  std::optional<double> makeStep(double damping) {
    step = -gradient;
    eliminateLandmarks(damping);
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      schur_complement(i, i) += addedDiagonal(H_pp(i, i), damping);
    }
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
    padStep();
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Landmark& landmark = landmarks[i];
      const double d = addedDiagonal(landmark.H_ll, damping);
      const double s = -gradientAfterPoseStep(landmark) / (landmark.H_ll + d);
      decrease += 0.5 * s * (d * s - landmark.gradient);
      candidate.inverse_depth[i] += s;
    }
    return decrease;
  }

  /// Sets the Schur complement to H_pp - H_pl (H_ll + D)^-1 H_lp, and adds the same to the right
  /// side.
  void eliminateLandmarks(double damping) {
    constexpr std::size_t kRow = Reprojections::kRow;
    const std::size_t stride = kRow * freeKeyframes();
    eliminated.assign(6 * freeKeyframes() * stride, 0);
    padded.resize(stride);
    for (const Landmark& landmark : landmarks) {
      const double h = landmark.H_ll + addedDiagonal(landmark.H_ll, damping);
      addOuterProduct(rows.data() + kRow * landmark.free_begin, landmark.blocks(), h, stride,
                      padded.data(), &eliminated[(6 * stride + kRow) * landmark.first_block]);
      for (std::size_t k = 0; k < landmark.blocks(); ++k) {
        step.segment<6>(static_cast<Eigen::Index>(6 * (landmark.first_block + k))) +=
            landmark.gradient * Eigen::Map<const Vector6d>(&padded[kRow * k]);
      }
    }
    schur_complement = H_pp;
    using Blocks = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const Blocks> sum(eliminated.data(), step.size(),
                                       static_cast<Eigen::Index>(stride));
    for (std::size_t k = 0; k < freeKeyframes(); ++k) {
      const auto column = static_cast<Eigen::Index>(6 * k),
                 at = static_cast<Eigen::Index>(kRow * k);
      const Eigen::Index below = step.size() - column;
      schur_complement.block(column, column, below, 6) -= sum.block(column, at, below, 6);
    }
  }

  /// Writes the step to `padded`, in the layout of the landmarks' rows.
  void padStep() {
    padded.assign(Reprojections::kRow * freeKeyframes(), 0);
    for (std::size_t k = 0; k < freeKeyframes(); ++k) {
      Eigen::Map<Vector6d> of_keyframe(&padded[Reprojections::kRow * k]);
      of_keyframe = step.segment<6>(static_cast<Eigen::Index>(6 * k));
    }
  }

  /// Back substitution: gradient with respect to the inverse depth after the step of the poses.
  double gradientAfterPoseStep(const Landmark& landmark) const {
    constexpr std::size_t kRow = Reprojections::kRow;
    const auto size = static_cast<Eigen::Index>(kRow * landmark.blocks());
    using Numbers = Eigen::Map<const Eigen::VectorXd>;
    return landmark.gradient + Numbers(rows.data() + kRow * landmark.free_begin, size)
                                   .dot(Numbers(padded.data() + kRow * landmark.first_block, size));
  }

  /// Minimises the cost, starting at `state` with cost `now`. Returns the final cost.
  double minimise(int max_iterations, double huber, double now) {
    linearise();
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
      if (gain > kMinGainRatio && iteration < max_iterations) linearise();
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
    result.residuals = static_cast<int>(2 * residuals.size());
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

LocalBundleAdjustment::LocalBundleAdjustment(int window)
    : window_(window), problem_(std::make_unique<Problem>()) {}

LocalBundleAdjustment::~LocalBundleAdjustment() = default;

LocalBundleAdjustment::Result LocalBundleAdjustment::adjust(LocalMap* map) {
  load(*map);
  const Result result = solve();
  store(map);
  return result;
}

void LocalBundleAdjustment::load(const LocalMap& map) {
  problem_->load(map, static_cast<std::size_t>(window_));
}

LocalBundleAdjustment::Result LocalBundleAdjustment::solve() {
  return problem_->solve(kMaxAdjustmentIterations, kHuberSigma);
}

void LocalBundleAdjustment::store(LocalMap* map) const { problem_->store(map); }

}  // namespace ground_scale_vo
