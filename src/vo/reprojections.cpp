#include "vo/reprojections.hpp"

#include <limits>

#include "common/vector_loop.hpp"

namespace ground_scale_vo {
/// Arrays of a group, padded to whole vectors: parts of the members of Reprojections.
struct Reprojections::Group {
  std::size_t count;
  const double *ray_x, *ray_y, *x, *y, *weight;
  double *rho, *u_x, *u_y, *inverse_z, *e_x, *e_y, *information;
  const std::size_t *landmark, *row;
};

namespace {

GSV_VECTOR_LOOP void project(const Reprojections::Group& group, const Eigen::Isometry3d& T_o_a,
                             double huber, double min_depth, double* loss, bool* too_close) {
  const Reprojections::Group g = group;  // not changed by what is written to the arrays
  const Eigen::Matrix4d& T = T_o_a.matrix();
  const Doubles one = {1, 1, 1, 1};
  Doubles sum = {};
  decltype(one < one) close = {};
  for (std::size_t i = 0; i < g.count; i += kSimdDoubles) {
    const Doubles &ray_x = simd(g.ray_x + i), &ray_y = simd(g.ray_y + i);
    const Doubles& rho = simd(g.rho + i);
    const Doubles q_x = T(0, 0) * ray_x + T(0, 1) * ray_y + T(0, 2) + rho * T(0, 3);
    const Doubles q_y = T(1, 0) * ray_x + T(1, 1) * ray_y + T(1, 2) + rho * T(1, 3);
    const Doubles q_z = T(2, 0) * ray_x + T(2, 1) * ray_y + T(2, 2) + rho * T(2, 3);
    close |= q_z < min_depth;
    const Doubles inverse_z = 1 / q_z;
    simd(g.inverse_z + i) = inverse_z;
    const Doubles u_x = q_x * inverse_z, u_y = q_y * inverse_z;
    simd(g.u_x + i) = u_x;
    simd(g.u_y + i) = u_y;
    const Doubles e_x = u_x - simd(g.x + i), e_y = u_y - simd(g.y + i);
    simd(g.e_x + i) = e_x;
    simd(g.e_y + i) = e_y;
    const Doubles squared_weight = simd(g.weight + i) * simd(g.weight + i);
    const Doubles squares = squared_weight * (e_x * e_x + e_y * e_y);
    Doubles r = squares;
    takeSquareRoots(&r);
    const auto outlier = r > huber;
    sum += outlier ? huber * (2 * r - huber) : squares;
    simd(g.information + i) = squared_weight * (outlier ? huber / r : one);
  }
  *loss = total(sum);
  *too_close = close[0] || close[1] || close[2] || close[3];
}

/// The normal equations of the inverse depths of kSimdDoubles residuals. weighted: derivative of
/// the residuals with respect to rho, times their information.
inline void lineariseDepth(const Reprojections::Group& in, std::size_t i, const Eigen::Matrix4d& T,
                           Doubles weighted[2], Doubles* H_ll, Doubles* gradient) {
  const Doubles &inverse_z = simd(in.inverse_z + i), &w = simd(in.information + i);
  const Doubles x = inverse_z * (T(0, 3) - simd(in.u_x + i) * T(2, 3));
  const Doubles y = inverse_z * (T(1, 3) - simd(in.u_y + i) * T(2, 3));
  weighted[0] = w * x;
  weighted[1] = w * y;
  *H_ll = weighted[0] * x + weighted[1] * y;
  *gradient = weighted[0] * simd(in.e_x + i) + weighted[1] * simd(in.e_y + i);
}

GSV_VECTOR_LOOP void sumDepths(const Reprojections::Group& group, const Eigen::Isometry3d& T_o_a,
                               double* rows) {
  const Reprojections::Group in = group;
  for (std::size_t i = 0; i < in.count; i += kSimdDoubles) {
    Doubles weighted[2], H_ll, gradient;
    lineariseDepth(in, i, T_o_a.matrix(), weighted, &H_ll, &gradient);
    for (std::size_t l = 0; l < kSimdDoubles; ++l) {
      double* const to = rows + Reprojections::kRow * in.row[i + l];
      to[6] = H_ll[l];
      to[7] = gradient[l];
    }
  }
}

GSV_VECTOR_LOOP void sumBlocks(const Reprojections::Group& group, const Eigen::Isometry3d& T_o_a,
                               double* rows, double* anchor_sums, ProjectionSums* sums) {
  const Reprojections::Group in = group;
  const Eigen::Matrix4d& T = T_o_a.matrix();
  for (std::size_t i = 0; i < in.count; i += kSimdDoubles) {
    const Doubles &inverse_z = simd(in.inverse_z + i), &w = simd(in.information + i);
    const ProjectionJacobian J{simd(in.u_x + i), simd(in.u_y + i), simd(in.rho + i) * inverse_z};
    sums->add(J, w, Doubles{}, w, simd(in.e_x + i), simd(in.e_y + i));

    Doubles weighted[2], values[Reprojections::kRow];
    lineariseDepth(in, i, T, weighted, &values[6], &values[7]);
    J.multiplyTransposed(-weighted[0], -weighted[1], values);  // the observer moves: -J
    const Doubles b_x = inverse_z * weighted[0], b_y = inverse_z * weighted[1];
    const Doubles b_z = -(J.ux * b_x + J.uy * b_y);
    const Doubles a_x = T(0, 0) * b_x + T(1, 0) * b_y + T(2, 0) * b_z;
    const Doubles a_y = T(0, 1) * b_x + T(1, 1) * b_y + T(2, 1) * b_z;
    const Doubles a_z = T(0, 2) * b_x + T(1, 2) * b_y + T(2, 2) * b_z;
    for (std::size_t l = 0; l < kSimdDoubles; ++l) {
      double* const to = rows + Reprojections::kRow * in.row[i + l];
      for (std::size_t k = 0; k < Reprojections::kRow; ++k) to[k] = values[k][l];
      double* const anchor_sum = anchor_sums + 3 * in.landmark[i + l];
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
    begin_[g + 1] = begin_[g] + padded(begin_[g + 1], kSimdDoubles);
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
    const std::size_t end = padded(i + 1, kSimdDoubles);
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

Reprojections::Group Reprojections::at(std::size_t group) {
  const std::size_t at = begin_[group];
  return {begin_[group + 1] - at,   ray_x_.data() + at,     ray_y_.data() + at, x_.data() + at,
          y_.data() + at,           weight_.data() + at,    rho_.data() + at,   u_x_.data() + at,
          u_y_.data() + at,         inverse_z_.data() + at, e_x_.data() + at,   e_y_.data() + at,
          information_.data() + at, landmark_.data() + at,  row_.data() + at};
}

double Reprojections::cost(std::size_t group, const Eigen::Isometry3d& T_o_a,
                           const std::vector<double>& inverse_depths, double huber,
                           double min_depth) {
  const Group g = at(group);
  for (std::size_t i = 0; i < g.count; ++i) g.rho[i] = inverse_depths[g.landmark[i]];
  double loss = 0;
  bool too_close = false;
  project(g, T_o_a, huber, min_depth, &loss, &too_close);
  return too_close ? std::numeric_limits<double>::infinity() : 0.5 * loss;
}

ProjectionSums Reprojections::linearise(std::size_t group, const Eigen::Isometry3d& T_o_a,
                                        double* rows, double* anchor_sums) {
  ProjectionSums sums;
  sumBlocks(at(group), T_o_a, rows, anchor_sums, &sums);
  return sums;
}

void Reprojections::lineariseDepths(std::size_t group, const Eigen::Isometry3d& T_o_a,
                                    double* rows) {
  sumDepths(at(group), T_o_a, rows);
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
