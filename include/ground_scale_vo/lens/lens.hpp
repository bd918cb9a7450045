#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// A pinhole camera with the distortion model plumb_bob of OpenCV and ROS (Brown-Conrady), or with
/// another model and, after that, what it has left of the distortion: in the formulas of plumb_bob
/// x is then the result of the model.
struct Lens {
  PinholeCamera camera;
  double k1 = 0, k2 = 0, k3 = 0;           ///< radial
  double p1 = 0, p2 = 0;                   ///< tangential
  const DistortionModel* model = nullptr;  ///< null: plumb_bob alone
  std::vector<double> coefficients = {};   ///< of the model

  Lens() = default;
  explicit Lens(const PinholeCamera& c, double radial_1 = 0, double radial_2 = 0,
                double radial_3 = 0, double tangential_1 = 0, double tangential_2 = 0)
      : camera(c), k1(radial_1), k2(radial_2), k3(radial_3), p1(tangential_1), p2(tangential_2) {}

  /// Distorted coordinates of the ray (x, 1): x (1 + k1 r^2 + k2 r^4 + k3 r^6) plus the tangential
  /// terms. x: normalised image coordinates without distortion. jacobian: d(result) / dx, if given.
  Eigen::Vector2d distort(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian = nullptr) const {
    return distortRest(distortByModel(x, jacobian), jacobian);
  }
  /// Its two parts; the second one multiplies the jacobian of the first one by its own.
  Eigen::Vector2d distortByModel(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian) const;
  Eigen::Vector2d distortRest(const Eigen::Vector2d& x, Eigen::Matrix2d* jacobian) const;

  /// Pixel of the distorted image.
  Eigen::Vector2d project(const Eigen::Vector2d& x) const;

  /// The inverse of project(), by Newton's method. Outside the image of a plausible lens, where
  /// the model need not be invertible, the result may be inaccurate.
  Eigen::Vector2d unproject(const Eigen::Vector2d& u) const;
};

/// The lens of the images as they come, and vice versa: of another model than plumb_bob, its
/// coefficients are fitted to the lens.
Lens lensOf(const CameraCalibration& calibration);
CameraCalibration calibrationOf(const Lens& lens);

/// The parameters that a drive determines, in this order: ln f (common to fx and fy), cx [px],
/// cy [px], k1, k2.
constexpr int kLensParameters = 5;
using LensVector = Eigen::Matrix<double, kLensParameters, 1>;
using LensMatrix = Eigen::Matrix<double, kLensParameters, kLensParameters>;

/// A lens and how well its parameters are known.
struct LensEstimate {
  Lens lens;
  LensMatrix covariance = LensMatrix::Zero();

  /// False: a lens as it was given, with zero covariance.
  bool isEstimate() const { return covariance != LensMatrix::Zero(); }
  LensVector sigmas() const { return covariance.diagonal().cwiseSqrt(); }

  /// Squared Mahalanobis distance of `current` from the estimate. If `current` is exact and was the
  /// prior's lens, the mean is at most kLensParameters.
  double significance(const Lens& current) const;

  /// That the lens of the prior, with which the estimate began, has a focal length or radial
  /// distortion that no published calibration of the camera would have, as a clause; empty: it has
  /// not.
  std::string contradiction(const LensEstimate& prior) const;
};

/// The lens with its parameters changed by delta.
Lens boxplus(const Lens& lens, const LensVector& delta);
/// The inverse: a = boxplus(b, boxminus(a, b)) for lenses that differ in these parameters only.
LensVector boxminus(const Lens& a, const Lens& b);

}  // namespace gsv
