#pragma once

#include "common/simd.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace gsv {

/// Derivative of the projections u = p_xy / p_z of kSimdDoubles points by a small motion (w, v)
/// that moves the points, p -> exp([w]x) p + factor v:
///   J = [ -ux uy,    1 + ux^2, -uy, s, 0, -ux s ]
///       [ -1 - uy^2, ux uy,     ux, 0, s, -uy s ],  s = factor / p_z.
struct ProjectionJacobian {
  Doubles ux, uy, s;

  /// J^T v. v: one number per row of J.
  void multiplyTransposed(const Doubles& v_x, const Doubles& v_y, Doubles product[6]) const {
    const Doubles along = ux * v_x + uy * v_y;
    product[0] = -v_y - uy * along;
    product[1] = v_x + ux * along;
    product[2] = ux * v_y - uy * v_x;
    product[3] = s * v_x;
    product[4] = s * v_y;
    product[5] = -s * along;
  }
};

/// Sums over residuals r of projections with information matrices W = [xx, xy; xy, yy].
struct ProjectionSums {
  Doubles H[21] = {};        // of J^T W J: lower triangle, row by row
  Doubles gradient[6] = {};  // of J^T W r

  void add(const ProjectionJacobian& J, const Doubles& xx, const Doubles& xy, const Doubles& yy,
           const Doubles& r_x, const Doubles& r_y) {
    Doubles product[6];
    J.multiplyTransposed(xx * r_x + xy * r_y, xy * r_x + yy * r_y, product);
    for (int i = 0; i < 6; ++i) gradient[i] += product[i];
    // Column by column, J^T (W J).
    const Doubles xy_u = J.ux * J.uy, x_1 = 1 + J.ux * J.ux, y_1 = 1 + J.uy * J.uy;
    J.multiplyTransposed(-xx * xy_u - xy * y_1, -xy * xy_u - yy * y_1, product);
    addColumn(0, product);
    J.multiplyTransposed(xx * x_1 + xy * xy_u, xy * x_1 + yy * xy_u, product);
    addColumn(1, product);
    J.multiplyTransposed(xy * J.ux - xx * J.uy, yy * J.ux - xy * J.uy, product);
    addColumn(2, product);
    J.multiplyTransposed(xx * J.s, xy * J.s, product);
    addColumn(3, product);
    J.multiplyTransposed(xy * J.s, yy * J.s, product);
    addColumn(4, product);
    J.multiplyTransposed(-J.s * (xx * J.ux + xy * J.uy), -J.s * (xy * J.ux + yy * J.uy), product);
    addColumn(5, product);
  }

  Matrix6d hessian() const {
    Matrix6d sum;
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column <= row; ++column) {
        sum(row, column) = sum(column, row) = total(H[index(row, column)]);
      }
    }
    return sum;
  }
  Vector6d gradientSum() const {
    Vector6d sum;
    for (int i = 0; i < 6; ++i) sum(i) = total(gradient[i]);
    return sum;
  }

 private:
  static constexpr int index(int row, int column) { return row * (row + 1) / 2 + column; }
  void addColumn(int column, const Doubles product[6]) {
    for (int row = column; row < 6; ++row) H[index(row, column)] += product[row];
  }
};

}  // namespace gsv
