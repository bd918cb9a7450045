#include "ground_scale_vo/vo/triangulation.hpp"

#include <cmath>

namespace ground_scale_vo {

std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations,
                                        double noise) {
  if (observations.empty()) return std::nullopt;

  // In camera c the point is, up to scale, a + rho t with a = R ray. Start from the linear solution
  // of x (a + rho t)_z = (a + rho t)_xy.
  double numerator = 0, denominator = 0;
  for (const RayObservation& o : observations) {
    const Eigen::Vector3d a = o.T_c_anchor.linear() * ray;
    const Eigen::Vector3d& t = o.T_c_anchor.translation();
    const Eigen::Vector2d slope = o.x * t.z() - t.head<2>();
    numerator += slope.dot(a.head<2>() - o.x * a.z());
    denominator += slope.squaredNorm();
  }
  if (denominator < 1e-18) return std::nullopt;
  double rho = numerator / denominator;

  double information = 0;
  for (int iteration = 0; iteration < 8; ++iteration) {
    double gradient = 0;
    information = 0;
    for (const RayObservation& o : observations) {
      const Eigen::Vector3d& t = o.T_c_anchor.translation();
      const Eigen::Vector3d p = o.T_c_anchor.linear() * ray + rho * t;
      if (p.z() < 1e-6) return std::nullopt;
      const Eigen::Vector2d residual = p.head<2>() / p.z() - o.x;
      const Eigen::Vector2d J = (t.head<2>() - p.head<2>() / p.z() * t.z()) / p.z();
      gradient += J.dot(residual);
      information += J.squaredNorm();
    }
    if (information < 1e-18) return std::nullopt;
    const double step = gradient / information;
    rho -= step;
    if (!std::isfinite(rho)) return std::nullopt;
    if (std::abs(step) < 1e-3 * noise / std::sqrt(information)) {
      return InverseDepth{rho, noise / std::sqrt(information)};
    }
  }
  return std::nullopt;
}

}  // namespace ground_scale_vo
