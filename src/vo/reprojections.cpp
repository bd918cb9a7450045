#include "vo/reprojections.hpp"

#include <limits>

#include "common/vector_loop.hpp"
#include "vo/projection_jacobian.hpp"

namespace ground_scale_vo {
namespace {

/// Arrays of a group, padded to whole vectors.
struct Inputs {
  const double *ray_x, *ray_y, *x, *y, *weight, *rho;
  std::size_t count;
};
template <typename Number>  // double or const double
struct Projections {
  Number *u_x, *u_y, *inverse_z, *e_x, *e_y, *information;
};

GSV_VECTOR_LOOP void project(const Inputs& in, const Eigen::Isometry3d& T_o_a, double huber,
                             double min_depth, const Projections<double>& out, double* loss,
                             bool* too_close) {
  const Eigen::Matrix4d& T = T_o_a.matrix();
  const Doubles one = {1, 1, 1, 1};
  Doubles sum = {};
  decltype(one < one) close = {};
  for (std::size_t i = 0; i < in.count; i += kSimdDoubles) {
    const Doubles &ray_x = simd(in.ray_x + i), &ray_y = simd(in.ray_y + i);
    const Doubles& rho = simd(in.rho + i);
    const Doubles q_x = T(0, 0) * ray_x + T(0, 1) * ray_y + T(0, 2) + rho * T(0, 3);
    const Doubles q_y = T(1, 0) * ray_x + T(1, 1) * ray_y + T(1, 2) + rho * T(1, 3);
    const Doubles q_z = T(2, 0) * ray_x + T(2, 1) * ray_y + T(2, 2) + rho * T(2, 3);
    close |= q_z < min_depth;
    const Doubles inverse_z = 1 / q_z;
    simd(out.inverse_z + i) = inverse_z;
    const Doubles u_x = q_x * inverse_z, u_y = q_y * inverse_z;
    simd(out.u_x + i) = u_x;
    simd(out.u_y + i) = u_y;
    const Doubles e_x = u_x - simd(in.x + i), e_y = u_y - simd(in.y + i);
    simd(out.e_x + i) = e_x;
    simd(out.e_y + i) = e_y;
    const Doubles squared_weight = simd(in.weight + i) * simd(in.weight + i);
    const Doubles squares = squared_weight * (e_x * e_x + e_y * e_y);
    Doubles r = squares;
    takeSquareRoots(&r);
    const auto outlier = r > huber;
    sum += outlier ? huber * (2 * r - huber) : squares;
    simd(out.information + i) = squared_weight * (outlier ? huber / r : one);
  }
  *loss = total(sum);
  *too_close = close[0] || close[1] || close[2] || close[3];
}

/// Derivative of the residuals with respect to rho, and its products with their information.
struct DepthJacobian {
  Doubles x, y, weighted_x, weighted_y;

  DepthJacobian(const Projections<const double>& in, std::size_t i, const Eigen::Matrix4d& T) {
    const Doubles &inverse_z = simd(in.inverse_z + i), &w = simd(in.information + i);
    x = inverse_z * (T(0, 3) - simd(in.u_x + i) * T(2, 3));
    y = inverse_z * (T(1, 3) - simd(in.u_y + i) * T(2, 3));
    weighted_x = w * x;
    weighted_y = w * y;
  }
  /// H_ll and gradient.
  void multiply(const Projections<const double>& in, std::size_t i, Doubles* H_ll,
                Doubles* gradient) const {
    *H_ll = weighted_x * x + weighted_y * y;
    *gradient = weighted_x * simd(in.e_x + i) + weighted_y * simd(in.e_y + i);
  }
};

GSV_VECTOR_LOOP void sumDepths(const Projections<const double>& in, const Eigen::Isometry3d& T_o_a,
                               std::size_t count, const std::size_t* row, double* rows) {
  for (std::size_t i = 0; i < count; i += kSimdDoubles) {
    const DepthJacobian j(in, i, T_o_a.matrix());
    Doubles H_ll, gradient;
    j.multiply(in, i, &H_ll, &gradient);
    for (std::size_t l = 0; l < kSimdDoubles; ++l) {
      double* const to = rows + Reprojections::kRow * row[i + l];
      to[6] = H_ll[l];
      to[7] = gradient[l];
    }
  }
}

/// row, landmark: indices of each residual.
GSV_VECTOR_LOOP void sumBlocks(const Projections<const double>& in, const double* rho,
                               const Eigen::Isometry3d& T_o_a, std::size_t count,
                               const std::size_t* row, const std::size_t* landmark, double* rows,
                               double* anchor_sums, ProjectionSums* sums) {
  const Eigen::Matrix4d& T = T_o_a.matrix();
  for (std::size_t i = 0; i < count; i += kSimdDoubles) {
    const Doubles &inverse_z = simd(in.inverse_z + i), &w = simd(in.information + i);
    const ProjectionJacobian J{simd(in.u_x + i), simd(in.u_y + i), simd(rho + i) * inverse_z};
    sums->add(J, w, Doubles{}, w, simd(in.e_x + i), simd(in.e_y + i));

    const DepthJacobian j(in, i, T);
    Doubles values[Reprojections::kRow];
    J.multiplyTransposed(-j.weighted_x, -j.weighted_y, values);  // the observer moves: -J
    j.multiply(in, i, &values[6], &values[7]);
    const Doubles b_x = inverse_z * j.weighted_x, b_y = inverse_z * j.weighted_y;
    const Doubles b_z = -(J.ux * b_x + J.uy * b_y);
    const Doubles a_x = T(0, 0) * b_x + T(1, 0) * b_y + T(2, 0) * b_z;
    const Doubles a_y = T(0, 1) * b_x + T(1, 1) * b_y + T(2, 1) * b_z;
    const Doubles a_z = T(0, 2) * b_x + T(1, 2) * b_y + T(2, 2) * b_z;
    for (std::size_t l = 0; l < kSimdDoubles; ++l) {
      double* const to = rows + Reprojections::kRow * row[i + l];
      for (std::size_t k = 0; k < Reprojections::kRow; ++k) to[k] = values[k][l];
      double* const anchor_sum = anchor_sums + 3 * landmark[i + l];
      anchor_sum[0] += a_x[l];
      anchor_sum[1] += a_y[l];
      anchor_sum[2] += a_z[l];
    }
  }
}

}  // namespace

void Reprojections::assign(const std::vector<Residual>& residuals,
                           const std::vector<Eigen::Vector3d>& rays, std::size_t groups) {
  begin_.assign(groups + 1, 0);
  for (const Residual& residual : residuals) ++begin_[residual.group + 1];
  for (std::size_t g = 0; g < groups; ++g) {
    begin_[g + 1] = begin_[g] + paddedDoubles(begin_[g + 1]);
  }
  const std::size_t size = begin_.back();
  for (auto* array : {&ray_x_, &ray_y_, &x_, &y_, &weight_, &rho_, &u_x_, &u_y_, &inverse_z_, &e_x_,
                      &e_y_, &information_}) {
    array->resize(size);
  }
  landmark_.resize(size);
  row_.resize(size);
  // The last residual of a group also fills its last vector; the copies have no weight.
  std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
  for (const Residual& residual : residuals) {
    const std::size_t i = next[residual.group]++;
    const std::size_t end = paddedDoubles(i + 1);
    for (std::size_t k = i; k < end; ++k) {
      landmark_[k] = residual.landmark;
      row_[k] = k == i ? residual.row : kPaddingRow;
      ray_x_[k] = rays[residual.landmark].x();
      ray_y_[k] = rays[residual.landmark].y();
      x_[k] = residual.x.x();
      y_[k] = residual.x.y();
      weight_[k] = k == i ? residual.weight : 0;
    }
  }
}

double Reprojections::cost(std::size_t group, const Eigen::Isometry3d& T_o_a,
                           const std::vector<double>& inverse_depths, double huber,
                           double min_depth) {
  const std::size_t at = begin_[group], end = begin_[group + 1];
  for (std::size_t i = at; i < end; ++i) rho_[i] = inverse_depths[landmark_[i]];
  double loss = 0;
  bool too_close = false;
  project({ray_x_.data() + at, ray_y_.data() + at, x_.data() + at, y_.data() + at,
           weight_.data() + at, rho_.data() + at, end - at},
          T_o_a, huber, min_depth,
          {u_x_.data() + at, u_y_.data() + at, inverse_z_.data() + at, e_x_.data() + at,
           e_y_.data() + at, information_.data() + at},
          &loss, &too_close);
  return too_close ? std::numeric_limits<double>::infinity() : 0.5 * loss;
}

Reprojections::Blocks Reprojections::linearise(std::size_t group, const Eigen::Isometry3d& T_o_a,
                                               double* rows, double* anchor_sums) const {
  const std::size_t at = begin_[group];
  ProjectionSums sums;
  sumBlocks({u_x_.data() + at, u_y_.data() + at, inverse_z_.data() + at, e_x_.data() + at,
             e_y_.data() + at, information_.data() + at},
            rho_.data() + at, T_o_a, begin_[group + 1] - at, row_.data() + at,
            landmark_.data() + at, rows, anchor_sums, &sums);
  return {sums.hessian(), -sums.gradientSum()};
}

void Reprojections::lineariseDepths(std::size_t group, const Eigen::Isometry3d& T_o_a,
                                    double* rows) const {
  const std::size_t at = begin_[group];
  sumDepths({u_x_.data() + at, u_y_.data() + at, inverse_z_.data() + at, e_x_.data() + at,
             e_y_.data() + at, information_.data() + at},
            T_o_a, begin_[group + 1] - at, row_.data() + at, rows);
}

GSV_VECTOR_LOOP void addOuterProduct(const double* rows, std::size_t count, double h,
                                     std::size_t stride, double* scaled, double* sum) {
  constexpr std::size_t kRow = Reprojections::kRow;
  for (std::size_t i = 0; i < kRow * count; i += kSimdDoubles) {
    simd(scaled + i) = simd(rows + i) / h;
  }
  for (std::size_t block = 0; block < count; ++block) {
    const double* const factors = rows + kRow * block;
    double* const to = sum + 6 * block * stride;
    for (std::size_t i = 0; i < kRow * (block + 1); i += kSimdDoubles) {
      const Doubles column = simd(scaled + i);
      for (std::size_t k = 0; k < 6; ++k) simd(to + k * stride + i) += factors[k] * column;
    }
  }
}

}  // namespace ground_scale_vo
