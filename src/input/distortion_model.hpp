#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace gsv {

/// All that differs between the models of distortion. A new one is an entry of distortionModels().
struct DistortionModel {
  using Names = std::vector<std::string>;
  using Points = std::vector<cv::Point2d>;   ///< normalised image coordinates
  using Coefficients = std::vector<double>;  ///< in OpenCV's order
  /// Of one point x; jacobian: d(result) / dx, if given.
  using Distort = Eigen::Vector2d(const Eigen::Vector2d& x, const Coefficients& coefficients,
                                  Eigen::Matrix2d* jacobian);
  using Undistort = void(const Points& from, const Coefficients& coefficients, Points* to);

  /// Throws OptionError: a wrong number of coefficients, or one that is not plausible.
  void validate(const Coefficients& coefficients) const;

  /// In ROS, Kalibr and OpenCV; as Camera.type of ORB-SLAM; as model_type of VINS. Messages use the
  /// first one.
  Names names, orb_slam_names, vins_names;
  /// Valid numbers of coefficients, ascending. With 0: none, or zeros, mean no distortion.
  std::vector<std::size_t> counts;
  bool is_brown_conrady = false;  ///< the first coefficients are those of plumb_bob
  Distort* distort;
  Undistort* undistort;
};

/// The first one is plumb_bob.
const std::vector<DistortionModel>& distortionModels();

/// The model with a name in one of its lists of names. Throws OptionError: what, then the names
/// that are supported.
const DistortionModel& modelNamed(const std::string& name,
                                  DistortionModel::Names DistortionModel::*names,
                                  const std::string& what);

}  // namespace gsv
