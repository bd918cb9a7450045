#include "vo/bundle_adjustment.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
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

/// Damping term of a diagonal element of the Hessian.
double addedDiagonal(double diagonal, double damping) {
  return damping * std::max(diagonal, kMinDiagonal);
}

}  // namespace

void BundleAdjustment::load(const LocalMap& map) {
  landmarks_.clear();
  rays_.clear();
  residuals_.clear();
  relative_poses_.clear();
  T_w_c_.clear();
  inverse_depths_.clear();
  usable_ = false;
  if (map.keyframes().size() < 2) return;

  for (const Keyframe& keyframe : map.keyframes()) T_w_c_.push_back(keyframe.T_w_c);
  first_free_ = keyframes() > window_ ? keyframes() - window_ : 1;
  relative_pose_of_.assign(keyframes() * keyframes(), kNone);
  const Eigen::Index size = row(keyframes());
  H_pp_.resize(size, size);
  gradient_.resize(size);

  for (const Landmark& landmark : map.landmarks()) {
    if (!landmark.depth || landmark.observations.size() < 2) continue;
    if (isFixed(map.indexOf(landmark.observations.back().keyframe))) continue;
    addLandmark(landmark, map);
  }
  const std::size_t row_count = landmarks_.empty() ? 1 : landmarks_.back().end;
  rows_.assign(Reprojections::kRow * row_count, 0);
  reprojections_.assign(residuals_, rays_, relative_poses_.size());
}

/// Adds a landmark with its residuals, unless there are none.
void BundleAdjustment::addLandmark(const Landmark& landmark, const LocalMap& map) {
  const Eigen::Vector3d ray = landmark.ray();
  const std::size_t anchor = map.indexOf(landmark.observations.front().keyframe);
  const std::size_t begin =
      landmarks_.empty() ? Reprojections::kPaddingRow + 1 : landmarks_.back().end;
  Unknown added{landmark.id(), !isFixed(anchor), begin, begin, begin, 0, 0, 0};
  if (added.free_anchor) addRow(anchor, &added);
  const std::size_t before = residuals_.size();
  for (auto o = std::next(landmark.observations.begin()); o != landmark.observations.end(); ++o) {
    const std::size_t keyframe = map.indexOf(o->keyframe);
    const std::size_t group = relativePose(keyframe, anchor);
    // No descent leads from behind a camera to its front: leave such an observation out.
    const Eigen::Vector3d p =
        projectOnRay(ray, landmark.depth->value, relative_poses_[group].T_o_a);
    if (p.z() < kMinAdjustedDepthRatio) continue;
    residuals_.push_back({group, landmarks_.size(), addRow(keyframe, &added), o->x, 1 / o->sigma});
  }
  if (residuals_.size() == before) return;
  landmarks_.push_back(added);
  rays_.push_back(ray);
  inverse_depths_.push_back(landmark.depth->value);
}

/// Adds the row of a keyframe, and those of free keyframes between the last one and this one.
std::size_t BundleAdjustment::addRow(std::size_t keyframe, Unknown* landmark) const {
  if (isFixed(keyframe)) {
    landmark->free_begin = ++landmark->end;
  } else {
    const std::size_t block = keyframe - first_free_;
    if (landmark->blocks() == 0) landmark->first_block = block;
    landmark->end = landmark->free_begin + block - landmark->first_block + 1;
  }
  return landmark->end - 1;
}

std::size_t BundleAdjustment::relativePose(std::size_t observer, std::size_t anchor) {
  std::size_t& index = relative_pose_of_[observer * keyframes() + anchor];
  if (index == kNone) {
    index = relative_poses_.size();
    relative_poses_.push_back({observer, anchor, T_w_c_[observer].inverse() * T_w_c_[anchor]});
  }
  return index;
}

/// Half the sum of squares with Huber's loss; infinite when a landmark is behind a camera. Leaves
/// the relative poses as they are with these poses.
double BundleAdjustment::cost(const std::vector<Eigen::Isometry3d>& T_w_c,
                              const std::vector<double>& inverse_depths) {
  double sum = 0;
  for (std::size_t g = 0; g < relative_poses_.size(); ++g) {
    RelativePose& relative = relative_poses_[g];
    relative.T_o_a = T_w_c[relative.observer].inverse() * T_w_c[relative.anchor];
    sum += reprojections_.cost(g, relative.T_o_a, inverse_depths, kHuberSigma, kMinStepDepthRatio);
  }
  return sum;
}

/// Gradient and Gauss-Newton Hessian at the state whose cost was computed last.
void BundleAdjustment::linearise() {
  H_pp_.setZero();
  gradient_.setZero();
  anchor_sums_.assign(3 * landmarks_.size(), 0);
  for (std::size_t g = 0; g < relative_poses_.size(); ++g) {
    const RelativePose& relative = relative_poses_[g];
    const ProjectionSums sums =
        reprojections_.linearise(g, relative.T_o_a, rows_.data(), anchor_sums_.data());
    if (isFixed(relative.observer)) continue;
    addPoseBlocks(relative, sums.hessian(), -sums.gradientSum());
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) finishLandmark(i);
}

/// Adds to H_pp and the gradient of the poses. A residual depends on T_o_a alone: a motion of the
/// anchor acts like minus its adjoint on the observer.
void BundleAdjustment::addPoseBlocks(const RelativePose& relative, const Matrix6d& H_oo,
                                     const Vector6d& gradient_o) {
  const Eigen::Index o = row(relative.observer);
  H_pp_.block<6, 6>(o, o) += H_oo;
  gradient_.segment<6>(o) += gradient_o;
  if (isFixed(relative.anchor)) return;
  const Eigen::Index a = row(relative.anchor);
  const Matrix6d A = adjoint(relative.T_o_a), HA = H_oo * A;
  H_pp_.block<6, 6>(o, a) -= HA;
  H_pp_.block<6, 6>(a, a).noalias() += A.transpose() * HA;
  gradient_.segment<6>(a).noalias() -= A.transpose() * gradient_o;
}

/// Sums the rows of a landmark, and fills that of its anchor.
void BundleAdjustment::finishLandmark(std::size_t i) {
  Unknown& landmark = landmarks_[i];
  landmark.H_ll = landmark.gradient = 0;
  for (std::size_t k = landmark.begin; k < landmark.end; ++k) {
    const double* const row = &rows_[Reprojections::kRow * k];
    landmark.H_ll += row[6];
    landmark.gradient += row[7];
  }
  if (!landmark.free_anchor) return;
  const Eigen::Map<const Eigen::Vector3d> sum(&anchor_sums_[3 * i]);
  Eigen::Map<Vector6d>(&rows_[Reprojections::kRow * landmark.begin]) << rays_[i].cross(sum),
      inverse_depths_[i] * sum;
}

/// Fills the candidates with the minimum of the damped quadratic model. Returns the decrease of the
/// undamped model's cost; empty when the equations have no solution.
std::optional<double> BundleAdjustment::makeStep(double damping) {
  step_ = -gradient_;
  eliminateLandmarks(damping);
  for (Eigen::Index i = 0; i < step_.size(); ++i) {
    schur_complement_(i, i) += addedDiagonal(H_pp_(i, i), damping);
  }
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> cholesky(schur_complement_);  // in place
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  cholesky.solveInPlace(step_);
  if (!isFinite(step_)) return std::nullopt;

  // With (H + D) s = -g the model changes by g s + s H s / 2 = (g s - s D s) / 2.
  double decrease = 0;
  for (Eigen::Index i = 0; i < step_.size(); ++i) {
    decrease += 0.5 * step_(i) * (addedDiagonal(H_pp_(i, i), damping) * step_(i) - gradient_(i));
  }
  candidate_T_w_c_ = T_w_c_;
  candidate_inverse_depths_ = inverse_depths_;
  for (std::size_t k = first_free_; k < keyframes(); ++k) {
    candidate_T_w_c_[k] = boxplus(T_w_c_[k], step_.segment<6>(row(k)));
  }
  padStep();
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const Unknown& landmark = landmarks_[i];
    const double d = addedDiagonal(landmark.H_ll, damping);
    const double s = -gradientAfterPoseStep(landmark) / (landmark.H_ll + d);
    decrease += 0.5 * s * (d * s - landmark.gradient);
    candidate_inverse_depths_[i] += s;
  }
  return decrease;
}

/// Sets the Schur complement to H_pp - H_pl (H_ll + D)^-1 H_lp, and adds the same to the right
/// side.
void BundleAdjustment::eliminateLandmarks(double damping) {
  constexpr std::size_t kRow = Reprojections::kRow;
  const std::size_t stride = kRow * freeKeyframes();
  eliminated_.assign(6 * freeKeyframes() * stride, 0);
  padded_.resize(stride);
  for (const Unknown& landmark : landmarks_) {
    const double h = landmark.H_ll + addedDiagonal(landmark.H_ll, damping);
    addOuterProduct(rows_.data() + kRow * landmark.free_begin, landmark.blocks(), h, stride,
                    padded_.data(), &eliminated_[(6 * stride + kRow) * landmark.first_block]);
    for (std::size_t k = 0; k < landmark.blocks(); ++k) {
      step_.segment<6>(static_cast<Eigen::Index>(6 * (landmark.first_block + k))) +=
          landmark.gradient * Eigen::Map<const Vector6d>(&padded_[kRow * k]);
    }
  }
  schur_complement_ = H_pp_;
  using Blocks = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const Blocks> sum(eliminated_.data(), step_.size(),
                                     static_cast<Eigen::Index>(stride));
  for (std::size_t k = 0; k < freeKeyframes(); ++k) {
    const auto column = static_cast<Eigen::Index>(6 * k), at = static_cast<Eigen::Index>(kRow * k);
    const Eigen::Index below = step_.size() - column;
    schur_complement_.block(column, column, below, 6) -= sum.block(column, at, below, 6);
  }
}

/// Writes the step to `padded_`, in the layout of the landmarks' rows.
void BundleAdjustment::padStep() {
  padded_.assign(Reprojections::kRow * freeKeyframes(), 0);
  for (std::size_t k = 0; k < freeKeyframes(); ++k) {
    Eigen::Map<Vector6d> of_keyframe(&padded_[Reprojections::kRow * k]);
    of_keyframe = step_.segment<6>(static_cast<Eigen::Index>(6 * k));
  }
}

/// Back substitution: gradient with respect to the inverse depth after the step of the poses.
double BundleAdjustment::gradientAfterPoseStep(const Unknown& landmark) const {
  constexpr std::size_t kRow = Reprojections::kRow;
  const auto size = static_cast<Eigen::Index>(kRow * landmark.blocks());
  using Numbers = Eigen::Map<const Eigen::VectorXd>;
  return landmark.gradient + Numbers(rows_.data() + kRow * landmark.free_begin, size)
                                 .dot(Numbers(padded_.data() + kRow * landmark.first_block, size));
}

/// Minimises the cost, which is `now`.
void BundleAdjustment::minimise(double now) {
  linearise();
  double damping = kInitialDamping, growth = kInitialDampingGrowth;
  for (int iteration = 1; iteration <= kMaxAdjustmentIterations; ++iteration) {
    const auto decrease = makeStep(damping);
    usable_ = usable_ || decrease;
    const double then = decrease ? cost(candidate_T_w_c_, candidate_inverse_depths_)
                                 : std::numeric_limits<double>::infinity();
    const bool converged = std::abs(now - then) <= kCostTolerance * now;
    const double gain = decrease ? (now - then) / *decrease : 0;
    if (gain > kMinGainRatio) {
      std::swap(T_w_c_, candidate_T_w_c_);
      std::swap(inverse_depths_, candidate_inverse_depths_);
      now = then;
      damping *= std::max(kMinDampingFactor, 1 - std::pow(2 * gain - 1, 3));
      growth = kInitialDampingGrowth;
    } else {
      damping *= growth;
      growth *= 2;
    }
    if (converged) break;
    if (gain > kMinGainRatio && iteration < kMaxAdjustmentIterations) linearise();
  }
}

bool BundleAdjustment::solve() {
  if (landmarks_.size() < kMinLandmarks) return false;
  const double length = baseline();
  const double initial_cost = cost(T_w_c_, inverse_depths_);
  if (!isFinite(initial_cost)) return false;
  minimise(initial_cost);
  if (!usable_) return false;

  if (first_free_ < 2) {
    const double adjusted_length = baseline();
    if (length > 0 && adjusted_length > 0) rescale(length / adjusted_length);
  }
  usable_ = std::all_of(T_w_c_.begin(), T_w_c_.end(), [](const auto& T) { return isFinite(T); }) &&
            isFinite(inverse_depths_);
  return usable_;
}

/// Distance between the first and the newest keyframe.
double BundleAdjustment::baseline() const {
  return (T_w_c_.back().translation() - T_w_c_.front().translation()).norm();
}

void BundleAdjustment::rescale(double factor) {
  const Eigen::Vector3d origin = T_w_c_.front().translation();
  for (Eigen::Isometry3d& T : T_w_c_) {
    T.translation() = origin + factor * (T.translation() - origin);
  }
  for (double& rho : inverse_depths_) rho /= factor;
}

void BundleAdjustment::store(LocalMap* map) const {
  if (!usable_) return;
  for (std::size_t k = first_free_; k < keyframes(); ++k) {
    map->keyframes()[k].T_w_c = T_w_c_[k];
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    map->find(landmarks_[i].id)->depth->value = inverse_depths_[i];
  }
}

}  // namespace gsv
