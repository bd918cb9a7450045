#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

#include "common/simd.hpp"
#include "vo/projection_jacobian.hpp"

namespace gsv {

/// The residuals of a bundle adjustment: e = q_xy / q_z - x with q = R ray + rho t, where R and t
/// are the pose of the landmark's anchor in the observer's axes. Residuals with this pose in common
/// follow each other, so that kSimdDoubles of them are computed at once.
class Reprojections {
 public:
  /// [numbers] in a row of linearise().
  static constexpr std::size_t kRow = 8;
  /// The padding of the groups is written to this row, which has no meaning.
  static constexpr std::size_t kPaddingRow = 0;

  /// A residual to be added.
  struct Residual {
    std::size_t group;  // of residuals with the same relative pose
    std::size_t landmark, row;
    Eigen::Vector2d x;
    double weight;  // 1 / sigma
  };
  struct Group;
  /// Replaces all residuals. rays: of the landmarks, z = 1.
  void assign(const std::vector<Residual>& residuals, const std::vector<Eigen::Vector3d>& rays,
              std::size_t groups);

  /// Half the sum of squares of a group with Huber's loss; infinite when a landmark has less than
  /// min_depth, q_z, in the observer.
  double cost(std::size_t group, const Eigen::Isometry3d& T_o_a,
              const std::vector<double>& inverse_depths, double huber, double min_depth);

  /// Normal equations of a group, whose cost was computed last with the same pose and depths:
  /// Hessian and minus the gradient over the observer's pose (boxplus). rows: of each residual,
  /// H_pl (over the observer's pose and the inverse depth; 6), H_ll and gradient over the inverse
  /// depth. anchor_sums, three numbers per landmark: adds R^T b, where b is H_pl of the translation
  /// without its factor -rho.
  ProjectionSums linearise(std::size_t group, const Eigen::Isometry3d& T_o_a, double* rows,
                           double* anchor_sums);

 private:
  Group at(std::size_t group);

  std::vector<std::size_t> begin_;  // of each group, in whole vectors, and the end of the last one
  std::vector<std::size_t> landmark_, row_;
  std::vector<double> numbers_;
};

/// Adds rows^T rows / h to `sum`, a matrix of blocks of 6 rows and Reprojections::kRow columns, of
/// which it uses the lower triangle of blocks. rows: `count` blocks. scaled: buffer for as many.
void addOuterProduct(const double* rows, std::size_t count, double h, std::size_t stride,
                     double* scaled, double* sum);

}  // namespace gsv
