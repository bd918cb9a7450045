#include "ground_scale_vo/vo/triangulation.hpp"

#include <cmath>

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// [VO units^2] minimum information (1 / sigma^2) on the inverse depth; below it there is no
/// baseline.
constexpr double kMinInformation = 1e-12;
/// Gauss-Newton starts at the linear solution and converges in two or three iterations.
constexpr int kMaxTriangulationIterations = 8;
/// [standard deviations of the inverse depth] step length at convergence.
constexpr double kConvergedSigmas = 1e-3;

}  // namespace

std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations) {
  if (observations.empty()) return std::nullopt;

  // In camera c the point is, up to scale, a + rho t with a = R ray. Initialise with the linear
  // solution of x (a + rho t)_z = (a + rho t)_xy.
  double numerator = 0, denominator = 0;
  for (const RayObservation& o : observations) {
    const Eigen::Vector3d a = o.T_c_anchor.linear() * ray;
    const Eigen::Vector3d& t = o.T_c_anchor.translation();
    const Eigen::Vector2d coefficient = o.x * t.z() - t.head<2>();
    const double weight = 1 / (o.sigma * o.sigma);
    numerator += weight * coefficient.dot(a.head<2>() - o.x * a.z());
    denominator += weight * coefficient.squaredNorm();
  }
  if (denominator < kMinInformation) return std::nullopt;
  double rho = numerator / denominator;

  double information = 0;
  for (int iteration = 0; iteration < kMaxTriangulationIterations; ++iteration) {
    double gradient = 0;
    information = 0;
    for (const RayObservation& o : observations) {
      const auto [p, scaled_derivative] = projectOnRay(ray, rho, o.T_c_anchor);
      if (p.z() < kMinObserverDepthRatio) return std::nullopt;
      const Eigen::Vector2d residual = p.head<2>() / p.z() - o.x;
      const Eigen::Vector2d J = scaled_derivative / p.z();
      const double weight = 1 / (o.sigma * o.sigma);
      gradient += weight * J.dot(residual);
      information += weight * J.squaredNorm();
    }
    if (information < kMinInformation) return std::nullopt;
    const double step = gradient / information;
    rho -= step;
    if (!areFinite(rho, information)) return std::nullopt;
    if (std::abs(step) < kConvergedSigmas / std::sqrt(information)) {
      return InverseDepth{rho, 1 / std::sqrt(information)};
    }
  }
  return std::nullopt;
}

}  // namespace ground_scale_vo
