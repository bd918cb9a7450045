#include "ground_scale_vo/lens/lens.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/text.hpp"
#include "input/distortion_model.hpp"

namespace gsv {
namespace {

constexpr int kMaxNewtonSteps = 20;
constexpr double kConverged = 1e-12;  // [focal lengths]

/// Standard deviations of the prior. As it draws the estimate, the true error may be much larger.
constexpr double kMaxFocalSigmas = 4;
/// Radial distortion that published calibrations never leave: five times their standard deviation
/// (PinholeCamera::k1Sigma()); and in standard deviations of the estimate.
constexpr double kMaxDistortionError = 0.1, kMaxDistortionSigmas = 5;

/// Rays of a grid of pixels of the image, without those that no rectified image can show.
std::vector<Eigen::Vector2d> visibleRays(const Lens& lens) {
  constexpr int kColumns = 32, kRows = 24;
  constexpr double kMaxErrorPx = 0.01;
  constexpr double kMaxTangent = 5;  // of the angle to the optical axis
  std::vector<Eigen::Vector2d> rays;
  for (int i = 0; i < kColumns * kRows; ++i) {
    const Eigen::Vector2d u((lens.camera.width - 1.0) * (i % kColumns) / (kColumns - 1),
                            (lens.camera.height - 1.0) * (i / kColumns) / (kRows - 1));
    const Eigen::Vector2d x = lens.unproject(u);
    if (x.norm() < kMaxTangent && (lens.project(x) - u).norm() < kMaxErrorPx) rays.push_back(x);
  }
  return rays;
}

/// Coefficients with which the model alone is the lens: Gauss-Newton from those that it has. The
/// smallest step wins where they hardly differ in their effect, as those of a rational model do.
std::vector<double> fittedCoefficients(const Lens& lens) {
  constexpr int kSteps = 10;
  constexpr double kDifference = 1e-5, kNegligible = 1e-9;
  std::vector<double> result = lens.coefficients;
  if (lens.k1 == 0 && lens.k2 == 0) return result;
  const std::vector<Eigen::Vector2d> rays = visibleRays(lens);
  const auto n = static_cast<Eigen::Index>(rays.size());
  const auto residuals = [&](const std::vector<double>& coefficients) {
    Eigen::VectorXd r(2 * n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector2d& x = rays[static_cast<std::size_t>(i)];
      r.segment<2>(2 * i) = lens.distort(x) - lens.model->distort(x, coefficients, nullptr);
    }
    return r;
  };
  Eigen::MatrixXd J(2 * n, static_cast<Eigen::Index>(result.size()));
  for (int step = 0; step < kSteps; ++step) {
    const Eigen::VectorXd r = residuals(result);
    for (std::size_t k = 0; k < result.size(); ++k) {
      std::vector<double> changed = result;
      changed[k] += kDifference;
      J.col(static_cast<Eigen::Index>(k)) = (r - residuals(changed)) / kDifference;
    }
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver;
    solver.setThreshold(kNegligible);
    const Eigen::VectorXd change = solver.compute(J).solve(r);
    for (std::size_t k = 0; k < result.size(); ++k) {
      result[k] += change[static_cast<Eigen::Index>(k)];
    }
  }
  return result;
}

}  // namespace

Eigen::Vector2d Lens::distortByModel(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian) const {
  if (model) return model->distort(x, coefficients, jacobian);
  if (jacobian) jacobian->setIdentity();
  return x;
}

Eigen::Vector2d Lens::distortRest(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian) const {
  const double r2 = x.squaredNorm(), xy = x.x() * x.y();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (jacobian) {
    const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, times 2
    Eigen::Matrix2d tangential;
    tangential << 2 * p1 * x.y() + 6 * p2 * x.x(), 2 * p1 * x.x() + 2 * p2 * x.y(),
        2 * p1 * x.x() + 2 * p2 * x.y(), 6 * p1 * x.y() + 2 * p2 * x.x();
    const Eigen::Matrix2d d_x =
        radial * Eigen::Matrix2d::Identity() + slope * x * x.transpose() + tangential;
    *jacobian = model ? Eigen::Matrix2d(d_x * *jacobian) : d_x;
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
  std::vector<double> d = calibration.distortion;
  if (!calibration.isPlumbBob()) {
    Lens lens(pinholeOf(calibration));
    lens.model = calibration.model;
    lens.coefficients = std::move(d);
    return lens;
  }
  d.resize(5);
  return Lens(pinholeOf(calibration), d[0], d[1], d[4], d[2], d[3]);
}

CameraCalibration calibrationOf(const Lens& lens) {
  CameraCalibration calibration = withoutDistortion(lens.camera);
  if (lens.model) {
    calibration.model = lens.model;
    calibration.distortion = fittedCoefficients(lens);
  } else {
    calibration.distortion = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
  }
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

std::string LensEstimate::contradiction(const LensEstimate& prior) const {
  if (!isEstimate()) return {};
  const Lens& given = prior.lens;
  const double focal_change = std::abs(std::log(lens.camera.fx / given.camera.fx));
  if (focal_change > kMaxFocalSigmas * prior.sigmas()[0]) {
    return format("its focal length is wrong, by %.1f %% or more", 100 * focal_change);
  }
  // k1 + k2 r^2 at the left and right border of the image.
  const double r2 = std::pow(0.5 * lens.camera.width / lens.camera.fx, 2);
  const Eigen::Vector2d g(1, r2);
  const double change = g.dot(Eigen::Vector2d(lens.k1 - given.k1, lens.k2 - given.k2));
  const double sigma = std::sqrt(g.dot(covariance.block<2, 2>(3, 3) * g));
  if (std::abs(change) < std::max(kMaxDistortionError, kMaxDistortionSigmas * sigma)) return {};
  return format(
      "its radial distortion k1 + k2 r^2 at the border of the image is wrong by %.2f (standard "
      "deviation %.2f)",
      std::abs(change), sigma);
}

}  // namespace gsv
