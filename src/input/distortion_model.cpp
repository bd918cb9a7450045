#include "input/distortion_model.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

using Names = DistortionModel::Names;
using Points = DistortionModel::Points;
using Coefficients = DistortionModel::Coefficients;

constexpr double kMaxCoefficient = 1e3;
const cv::Matx33d kNormalised = cv::Matx33d::eye();  // camera matrix

/// Rotates the image plane by the angles (tau_x, tau_y) of a tilted sensor, as OpenCV does.
Eigen::Vector2d tilt(const Eigen::Vector2d& x, double tau_x, double tau_y,
                     Eigen::Matrix2d* jacobian) {
  const Eigen::Matrix3d R = (Eigen::AngleAxisd(-tau_y, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(-tau_x, Eigen::Vector3d::UnitX()))
                                .toRotationMatrix();
  Eigen::Matrix3d projection;
  projection << R(2, 2), 0, -R(0, 2), 0, R(2, 2), -R(1, 2), 0, 0, 1;
  const Eigen::Matrix3d H = projection * R;
  const Eigen::Vector3d p = H * x.homogeneous();
  Eigen::Vector2d result = p.hnormalized();
  if (jacobian) {
    const Eigen::Matrix2d d_x = H.topLeftCorner<2, 2>() - result * H.bottomLeftCorner<1, 2>();
    *jacobian = (d_x / p.z() * *jacobian).eval();
  }
  return result;
}

/// k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y; those that are not given are zero.
Eigen::Vector2d distortBrown(const Eigen::Vector2d& x, const Coefficients& given,
                             Eigen::Matrix2d* jacobian) {
  std::array<double, 14> d = {};
  std::copy(given.begin(), given.end(), d.begin());
  const double r2 = x.squaredNorm();
  const double numerator = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const double denominator = 1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7]));
  const double radial = numerator / denominator;
  const Eigen::Vector2d p(d[3], d[2]), s_2(d[8], d[10]), s_4(d[9], d[11]);
  const Eigen::Vector2d result = radial * x + p * r2 + 2 * x.dot(p) * x + r2 * s_2 + r2 * r2 * s_4;
  if (jacobian) {  // by x and, twice, by r2
    const double slope = (d[0] + r2 * (2 * d[1] + r2 * 3 * d[4]) -
                          radial * (d[5] + r2 * (2 * d[6] + r2 * 3 * d[7]))) /
                         denominator;
    *jacobian = (radial + 2 * x.dot(p)) * Eigen::Matrix2d::Identity() + 2 * x * p.transpose() +
                2 * (slope * x + p + s_2 + 2 * r2 * s_4) * x.transpose();
  }
  return d[12] == 0 && d[13] == 0 ? result : tilt(result, d[12], d[13], jacobian);
}

void undistortBrown(const Points& from, const Coefficients& coefficients, Points* to) {
  cv::undistortPoints(from, *to, kNormalised, coefficients);
}

Eigen::Vector2d distortFisheye(const Eigen::Vector2d& x, const Coefficients& k,
                               Eigen::Matrix2d* jacobian) {
  constexpr double kCentre = 1e-8;
  const double r = x.norm(), theta = std::atan(r), t2 = theta * theta;
  const double distorted = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
  const double factor = r > kCentre ? distorted / r : 1;
  if (jacobian) {
    *jacobian = factor * Eigen::Matrix2d::Identity();
    const double slope =
        (1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))) / (1 + r * r);
    if (r > kCentre) *jacobian += (slope - factor) / (r * r) * x * x.transpose();
  }
  return factor * x;
}

void undistortFisheye(const Points& from, const Coefficients& coefficients, Points* to) {
  cv::fisheye::undistortPoints(from, *to, kNormalised, coefficients);
}

/// "4, 5 or 8" with last " or ".
std::string enumeration(const Names& words, const std::string& last) {
  std::string text = words.front();
  for (std::size_t i = 1; i < words.size(); ++i) {
    text += (i + 1 == words.size() ? last : ", ") + words[i];
  }
  return text;
}

}  // namespace

const std::vector<DistortionModel>& distortionModels() {
  // plumb_bob with the coefficients of rational_polynomial is accepted, and vice versa.
  static const std::vector<std::size_t> kBrown{0, 4, 5, 8, 12, 14};
  static const std::vector<DistortionModel> kModels{
      {{"plumb_bob", "radtan", "radial-tangential"},
       {"PinHole", "Rectified"},
       {"PINHOLE"},
       kBrown,
       true,
       distortBrown,
       undistortBrown},
      {{"rational_polynomial"}, {}, {}, kBrown, true, distortBrown, undistortBrown},
      {{"equidistant", "fisheye", "kannala_brandt", "KANNALA_BRANDT"},
       {"KannalaBrandt8"},
       {"KANNALA_BRANDT"},
       {4},
       false,
       distortFisheye,
       undistortFisheye}};
  return kModels;
}

const DistortionModel& plumbBob() { return distortionModels().front(); }

const DistortionModel& modelNamed(const std::string& name, Names DistortionModel::*names,
                                  const std::string& what) {
  Names supported;
  for (const DistortionModel& model : distortionModels()) {
    const Names& own = model.*names;
    if (std::find(own.begin(), own.end(), name) != own.end()) return model;
    if (!own.empty()) supported.push_back(own.front());
  }
  throw OptionError(what + "supported are " + enumeration(supported, " and "));
}

void DistortionModel::validate(const Coefficients& coefficients) const {
  if (std::find(counts.begin(), counts.end(), coefficients.size()) == counts.end()) {
    Names numbers;
    for (const std::size_t count : counts) numbers.push_back(std::to_string(count));
    if (counts.front() == 0) numbers.erase(numbers.begin());
    throw OptionError(names.front() + " distortion has " + enumeration(numbers, " or ") +
                      " coefficients, not " + std::to_string(coefficients.size()));
  }
  for (const double k : coefficients) {
    requireInRange("distortion coefficient", k, -kMaxCoefficient, kMaxCoefficient);
  }
}

}  // namespace gsv
