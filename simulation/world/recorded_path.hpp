#pragma once

#include <Eigen/Core>
#include <vector>

namespace gsv::simulation {

/// Position along the road and its derivatives [m, m/s, m/s^2].
struct LongitudinalState {
  double s, v, a;
};

/// A uniform cubic B-spline: twice continuously differentiable, linear beyond both ends. It
/// approximates its control values, and smooths them with a standard deviation of 0.58 steps.
class UniformSpline {
 public:
  UniformSpline() = default;
  /// values: at least two control values, of start, start + step, ...
  UniformSpline(double start, double step, std::vector<double> values);
  double value(double x) const;
  double derivative(double x) const;
  double secondDerivative(double x) const;

 private:
  struct Span {
    double t;     // position in the span, 0 to 1
    double c[4];  // control values that act in it
  };
  Span spanAt(double x) const;
  double start_ = 0, step_ = 1;
  std::vector<double> values_;
};

/// A drive along recorded positions: the course of a road through them and the motion along it.
/// Recorded positions have noise that a road and a car do not have, so what follows from them is
/// smoothed, with Gaussian kernels of these standard deviations: the heading 1.5 m, the slope 10 m,
/// the speed 0.3 s. A position that advances by less than 2 cm is a standstill.
///
/// s: length along the plan from the first position [m]. Beyond both ends the road goes
/// straight on.
class RecordedPath {
 public:
  /// positions: of the camera at equal intervals [m], x right, y down, z forward. Throws
  /// OptionError: a position is not finite, a path shorter than 20 m or longer than 12 km, a jump
  /// of more than 20 m, or a curve with a radius below 3.3 m.
  RecordedPath(const std::vector<Eigen::Vector3d>& positions, double rate_hz);

  double length() const { return length_; }       ///< [m]
  double topSpeed() const { return top_speed_; }  ///< [m/s]
  /// Direction in the plan, positive to the left, relative to the first camera [rad].
  double heading(double s) const { return heading_.value(s); }
  double curvature(double s) const { return heading_.derivative(s); }  ///< [1/m]
  double elevation(double s) const { return elevation_.value(s); }     ///< up to a constant [m]
  double slope(double s) const { return elevation_.derivative(s); }
  /// t: since the first position [s].
  LongitudinalState at(double t) const {
    return {motion_.value(t), motion_.derivative(t), motion_.secondDerivative(t)};
  }

 private:
  UniformSpline heading_, elevation_;  // over s
  UniformSpline motion_;               // s over time
  double length_ = 0, top_speed_ = 0;
};

}  // namespace gsv::simulation
