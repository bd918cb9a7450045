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

constexpr double kMinDepthRatio = 1e-3;  // depth in the observer over depth in the anchor
constexpr std::size_t kMinPoints = 10;
constexpr std::size_t kNone = static_cast<std::size_t>(-1);
constexpr double kFirstDamping = 1e-4;   // added to the diagonal, as a share of it
constexpr double kMinDiagonal = 1e-6;    // the share is of at least this
constexpr double kMinGain = 1e-3;        // decrease of the cost over the model's, of a good step
constexpr double kCostTolerance = 1e-6;  // a smaller relative change is the last

}  // namespace

/// Blocks of six rows belong to the keyframes from `held` on.
struct LocalBundleAdjustment::Problem {
  /// A keyframe that sees a point. Of the anchor only the coupling counts.
  struct View {
    std::size_t keyframe, pair;
    Eigen::Vector2d x;
    double weight;      // 1 / sigma
    Vector6d coupling;  // block of the Hessian between the keyframe's pose and the point's depth
  };
  struct Point {
    std::uint64_t id;
    Eigen::Vector3d ray;
    std::size_t begin, end;  // of its views, by keyframe; the first is the anchor's
    double hessian, gradient;
  };
  struct State {
    std::vector<Eigen::Isometry3d> T_w_c;
    std::vector<double> inverse_depth;
  };
  /// Sums over all points of one anchor that one keyframe sees, for the pose of the latter.
  struct Pair {
    std::size_t observer, anchor;
    Eigen::Isometry3d T_o_a;
    Matrix6d hessian;
    Vector6d gradient;
  };

  std::size_t held = 0;
  std::vector<Point> points;
  std::vector<View> views;
  State state, candidate;
  bool usable = false;

  std::vector<Pair> pairs;
  std::vector<std::size_t> pair_of;  // by observer, then anchor; kNone: no point needs it
  Eigen::MatrixXd hessian, reduced;  // of the poses; lower triangles
  Eigen::VectorXd gradient, step;

  std::size_t keyframes() const { return state.T_w_c.size(); }
  Eigen::Index row(std::size_t keyframe) const {
    return static_cast<Eigen::Index>(6 * (keyframe - held));
  }

  void load(const LocalMap& map, std::size_t window) {
    points.clear();
    views.clear();
    pairs.clear();
    state.T_w_c.clear();
    state.inverse_depth.clear();
    usable = false;
    if (map.keyframes().size() < 2) return;

    for (const Keyframe& keyframe : map.keyframes()) state.T_w_c.push_back(keyframe.T_w_c);
    held = keyframes() > window ? keyframes() - window : 1;
    pair_of.assign(keyframes() * keyframes(), kNone);
    const Eigen::Index rows = row(keyframes());
    hessian.resize(rows, rows);
    gradient.resize(rows);

    const std::uint32_t first_id = map.keyframes().front().id;
    for (const auto& [id, landmark] : map.landmarks()) {
      const auto& observations = landmark.observations;
      if (!landmark.depth || observations.size() < 2) continue;
      if (observations.back().keyframe - first_id < held) continue;
      const Eigen::Vector3d ray = landmark.ray();
      const std::size_t begin = views.size();
      for (const Observation& o : observations) {
        const std::size_t keyframe = o.keyframe - first_id;
        std::size_t pair = kNone;
        if (views.size() > begin) {
          pair = pairOf(keyframe, views[begin].keyframe);
          // A start behind a camera has no way to its front; such an observation does not count.
          const RayProjection seen = projectOnRay(ray, landmark.depth->value, pairs[pair].T_o_a);
          if (seen.p.z() < kMinDepthRatio) continue;
        }
        views.push_back({keyframe, pair, o.x, 1 / o.sigma, Vector6d::Zero()});
      }
      if (views.size() < begin + 2) {
        views.resize(begin);
        continue;
      }
      points.push_back({id, ray, begin, views.size(), 0, 0});
      state.inverse_depth.push_back(landmark.depth->value);
    }
  }

  std::size_t pairOf(std::size_t observer, std::size_t anchor) {
    std::size_t& pair = pair_of[observer * keyframes() + anchor];
    if (pair == kNone) {
      pair = pairs.size();
      pairs.push_back({observer, anchor, state.T_w_c[observer].inverse() * state.T_w_c[anchor],
                       Matrix6d::Zero(), Vector6d::Zero()});
    }
    return pair;
  }

  /// Half the robust sum of squares; infinite when a point comes behind a camera. Leaves the pairs'
  /// poses as they are in this state.
  double cost(const State& of, double huber) {
    for (Pair& pair : pairs) {
      pair.T_o_a = of.T_w_c[pair.observer].inverse() * of.T_w_c[pair.anchor];
    }
    double sum = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Point& point = points[i];
      for (std::size_t k = point.begin + 1; k < point.end; ++k) {
        const Eigen::Isometry3d& T_o_a = pairs[views[k].pair].T_o_a;
        const Eigen::Vector3d q =
            T_o_a.linear() * point.ray + of.inverse_depth[i] * T_o_a.translation();
        if (q.z() < 0.1 * kMinDepthRatio) return std::numeric_limits<double>::infinity();
        const double r = views[k].weight * (q.head<2>() / q.z() - views[k].x).norm();
        sum += r > huber ? huber * (2 * r - huber) : r * r;
      }
    }
    return 0.5 * sum;
  }

  /// Gradient and Gauss-Newton Hessian of cost(state), which was computed last.
  void linearise(double huber) {
    for (Pair& p : pairs) {
      p.hessian.setZero();
      p.gradient.setZero();
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      Point& point = points[i];
      View& anchor = views[point.begin];
      const double rho = state.inverse_depth[i];
      point.hessian = point.gradient = 0;
      Eigen::Vector3d pull = Eigen::Vector3d::Zero();
      for (std::size_t k = point.begin + 1; k < point.end; ++k) {
        View& view = views[k];
        Pair& p = pairs[view.pair];
        const Eigen::Vector3d& t = p.T_o_a.translation();
        const Eigen::Vector3d q = p.T_o_a.linear() * point.ray + rho * t;
        const Eigen::Vector2d u = q.head<2>() / q.z();
        Eigen::Vector2d r = view.weight * (u - view.x);
        const double norm = r.norm();
        const double robust = norm > huber ? std::sqrt(huber / norm) : 1;
        r *= robust;
        const double m = robust * view.weight, m_z = m / q.z();
        Eigen::Matrix<double, 2, 3> P;  // of the residual over q
        P << m_z, 0, -m_z * u.x(), 0, m_z, -m_z * u.y();
        const Eigen::Vector2d j = P * t;  // over rho
        point.hessian += j.squaredNorm();
        point.gradient += j.dot(r);
        if (view.keyframe < held) continue;
        Eigen::Matrix<double, 2, 6> J;  // over the observer's pose: P [skew(q), -rho I]
        J.leftCols<3>() << m * u.x() * u.y(), -m * (1 + u.x() * u.x()), m * u.y(),
            m * (1 + u.y() * u.y()), -m * u.x() * u.y(), -m * u.x();
        J.rightCols<3>() = -rho * P;
        p.hessian.noalias() += J.transpose() * J;
        p.gradient.noalias() += J.transpose() * r;
        view.coupling.noalias() = J.transpose() * j;
        pull.noalias() += p.T_o_a.linear().transpose() * (P.transpose() * j);
      }
      anchor.coupling << point.ray.cross(pull), rho * pull;
    }

    hessian.setZero();
    gradient.setZero();
    for (const Pair& p : pairs) {
      if (p.observer < held) continue;
      const Eigen::Index o = row(p.observer);
      hessian.block<6, 6>(o, o) += p.hessian;
      gradient.segment<6>(o) += p.gradient;
      if (p.anchor < held) continue;
      const Eigen::Index a = row(p.anchor);
      // A motion of the anchor changes the residual as its negative in the observer's axes does.
      const Matrix6d A = adjoint(p.T_o_a), HA = p.hessian * A;
      hessian.block<6, 6>(o, a) -= HA;
      hessian.block<6, 6>(a, a).noalias() += A.transpose() * HA;
      gradient.segment<6>(a).noalias() -= A.transpose() * p.gradient;
    }
  }

  static double damped(double diagonal, double damping) {
    return damping * std::max(diagonal, kMinDiagonal);
  }

  /// Fills the candidate with the minimum of the damped model. Returns by how much the model
  /// without damping decreases; empty when the equations have no solution.
  std::optional<double> makeStep(double damping) {
    reduced = hessian;
    step = -gradient;
    for (Eigen::Index i = 0; i < step.size(); ++i) reduced(i, i) += damped(hessian(i, i), damping);
    for (const Point& point : points) {
      const double h = point.hessian + damped(point.hessian, damping);
      for (std::size_t a = point.begin; a < point.end; ++a) {
        if (views[a].keyframe < held) continue;
        const Vector6d e = views[a].coupling / h;
        step.segment<6>(row(views[a].keyframe)) += point.gradient * e;
        for (std::size_t b = a; b < point.end; ++b) {
          reduced.block<6, 6>(row(views[b].keyframe), row(views[a].keyframe)).noalias() -=
              views[b].coupling * e.transpose();
        }
      }
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> cholesky(reduced);  // in place
    if (cholesky.info() != Eigen::Success) return std::nullopt;
    cholesky.solveInPlace(step);
    if (!isFinite(step)) return std::nullopt;

    // With (H + D) s = -g the model changes by g s + s H s / 2 = (g s - s D s) / 2.
    double decrease = 0;
    for (Eigen::Index i = 0; i < step.size(); ++i) {
      decrease += 0.5 * step(i) * (damped(hessian(i, i), damping) * step(i) - gradient(i));
    }
    candidate = state;
    for (std::size_t k = held; k < keyframes(); ++k) {
      candidate.T_w_c[k] = boxplus(state.T_w_c[k], step.segment<6>(row(k)));
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Point& point = points[i];
      double slope = point.gradient;
      for (std::size_t k = point.begin; k < point.end; ++k) {
        if (views[k].keyframe < held) continue;
        slope += views[k].coupling.dot(step.segment<6>(row(views[k].keyframe)));
      }
      const double d = damped(point.hessian, damping), s = -slope / (point.hessian + d);
      decrease += 0.5 * s * (d * s - point.gradient);
      candidate.inverse_depth[i] += s;
    }
    return decrease;
  }

  /// The way from the first keyframe to the newest.
  Eigen::Vector3d way() const {
    return state.T_w_c.back().translation() - state.T_w_c.front().translation();
  }

  void stretch(double factor) {
    const Eigen::Vector3d origin = state.T_w_c.front().translation();
    for (Eigen::Isometry3d& T : state.T_w_c) {
      T.translation() = origin + factor * (T.translation() - origin);
    }
    for (double& rho : state.inverse_depth) rho /= factor;
  }

  Result solve(int max_iterations, double huber) {
    if (points.size() < kMinPoints) return {};
    const double length = way().norm();
    double now = cost(state, huber);
    if (!isFinite(now)) return {};
    linearise(huber);

    // The damping follows the gain: Nielsen's rule.
    double damping = kFirstDamping, growth = 2;
    for (int iteration = 1; iteration <= max_iterations; ++iteration) {
      const auto decrease = makeStep(damping);
      usable = usable || decrease;
      const double then =
          decrease ? cost(candidate, huber) : std::numeric_limits<double>::infinity();
      const bool settled = std::abs(now - then) <= kCostTolerance * now;
      const double gain = decrease ? (now - then) / *decrease : 0;
      if (gain > kMinGain) {
        std::swap(state, candidate);
        now = then;
        damping *= std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3));
        growth = 2;
      } else {
        damping *= growth;
        growth *= 2;
      }
      if (settled) break;
      if (gain > kMinGain && iteration < max_iterations) linearise(huber);
    }
    if (!usable) return {};

    if (held < 2) {
      const double adjusted_length = way().norm();
      if (length > 0 && adjusted_length > 0) stretch(length / adjusted_length);
    }
    usable = std::all_of(state.T_w_c.begin(), state.T_w_c.end(),
                         [](const auto& T) { return isFinite(T); }) &&
             isFinite(state.inverse_depth);
    if (!usable) return {};
    Result result;
    result.usable = true;
    result.residuals = static_cast<int>(2 * (views.size() - points.size()));
    result.rms_sigma = std::sqrt(2 * now / std::max(1, result.residuals));
    return result;
  }

  void store(LocalMap* map) const {
    if (!usable) return;
    for (std::size_t k = held; k < keyframes(); ++k) map->keyframes()[k].T_w_c = state.T_w_c[k];
    for (std::size_t i = 0; i < points.size(); ++i) {
      map->find(points[i].id)->depth->value = state.inverse_depth[i];
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
