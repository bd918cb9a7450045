#include "ground_scale_vo/lens/lens.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <vector>

namespace ground_scale_vo {
namespace {

constexpr int kMaxNewtonSteps = 20;
constexpr double kConverged = 1e-12;  // [focal lengths]

}  // namespace

Eigen::Vector2d Lens::distort(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian) const {
  const double r2 = x.squaredNorm(), xy = x.x() * x.y();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (jacobian) {
    const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, times 2
    Eigen::Matrix2d tangential;
    tangential << 2 * p1 * x.y() + 6 * p2 * x.x(), 2 * p1 * x.x() + 2 * p2 * x.y(),
        2 * p1 * x.x() + 2 * p2 * x.y(), 6 * p1 * x.y() + 2 * p2 * x.x();
    *jacobian = radial * Eigen::Matrix2d::Identity() + slope * x * x.transpose() + tangential;
  }
  return radial * x + Eigen::Vector2d(2 * p1 * xy + p2 * (r2 + 2 * x.x() * x.x()),
                                      p1 * (r2 + 2 * x.y() * x.y()) + 2 * p2 * xy);
}

Eigen::Vector2d Lens::project(const Eigen::Vector2d& x) const {
  return camera.project(distort(x).homogeneous());
}

Eigen::Vector2d Lens::unproject(const Eigen::Vector2d& u) const {
  const Eigen::Vector2d distorted = camera.ray(u).head<2>();
  Eigen::Vector2d x = distorted;
  for (int i = 0; i < kMaxNewtonSteps; ++i) {
    Eigen::Matrix2d jacobian;
    const Eigen::Vector2d step = distort(x, &jacobian) - distorted;
    if (step.norm() < kConverged) break;
    x -= jacobian.inverse() * step;
  }
  return x;
}

Lens lensOf(const CameraCalibration& calibration) {
  if (!calibration.hasLens()) return Lens(pinholeOf(calibration));
  std::vector<double> d = calibration.distortion;
  d.resize(5);
  return Lens(pinholeOf(calibration), d[0], d[1], d[4], d[2], d[3]);
}

CameraCalibration calibrationOf(const Lens& lens) {
  CameraCalibration calibration = withoutDistortion(lens.camera);
  calibration.distortion = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
  return calibration;
}

Lens boxplus(const Lens& lens, const LensVector& delta) {
  Lens result = lens;
  result.camera.fx *= std::exp(delta[0]);
  result.camera.fy *= std::exp(delta[0]);
  result.camera.cx += delta[1];
  result.camera.cy += delta[2];
  result.k1 += delta[3];
  result.k2 += delta[4];
  return result;
}

LensVector boxminus(const Lens& a, const Lens& b) {
  LensVector delta;
  delta << std::log(a.camera.fx / b.camera.fx), a.camera.cx - b.camera.cx,
      a.camera.cy - b.camera.cy, a.k1 - b.k1, a.k2 - b.k2;
  return delta;
}

double LensEstimate::significance(const Lens& current) const {
  const LensVector difference = boxminus(current, lens);
  return difference.dot(covariance.ldlt().solve(difference));
}

}  // namespace ground_scale_vo
