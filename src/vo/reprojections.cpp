#include "vo/reprojections.hpp"

#include <limits>

#include "common/vector_loop.hpp"

namespace gsv {
namespace {

/// Arrays of a group, padded to whole vectors. From kRho on, from the last cost(): rho, q_xy / q_z,
/// 1 / q_z, e, and the squared weight times Huber's.
constexpr std::size_t kRayX = 0, kRayY = 1, kX = 2, kY = 3, kWeight = 4, kRho = 5, kUX = 6, kUY = 7,
                      kInverseZ = 8, kEX = 9, kEY = 10, kInformation = 11, kArrays = 12;

}  // namespace

/// A part of the members of Reprojections.
struct Reprojections::Group {
  std::size_t count;
  double* numbers;
  const std::size_t *landmark, *row;

  double* operator[](std::size_t array) const { return numbers + array * count; }
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
    const Doubles &ray_x = simd(g[kRayX] + i), &ray_y = simd(g[kRayY] + i);
    const Doubles& rho = simd(g[kRho] + i);
    const Doubles q_x = T(0, 0) * ray_x + T(0, 1) * ray_y + T(0, 2) + rho * T(0, 3);
    const Doubles q_y = T(1, 0) * ray_x + T(1, 1) * ray_y + T(1, 2) + rho * T(1, 3);
    const Doubles q_z = T(2, 0) * ray_x + T(2, 1) * ray_y + T(2, 2) + rho * T(2, 3);
    close |= q_z < min_depth;
    const Doubles inverse_z = 1 / q_z;
    simd(g[kInverseZ] + i) = inverse_z;
    const Doubles u_x = q_x * inverse_z, u_y = q_y * inverse_z;
    simd(g[kUX] + i) = u_x;
    simd(g[kUY] + i) = u_y;
    const Doubles e_x = u_x - simd(g[kX] + i), e_y = u_y - simd(g[kY] + i);
    simd(g[kEX] + i) = e_x;
    simd(g[kEY] + i) = e_y;
    const Doubles squared_weight = simd(g[kWeight] + i) * simd(g[kWeight] + i);
    const Doubles squares = squared_weight * (e_x * e_x + e_y * e_y);
    Doubles r = squares;
    takeSquareRoots(&r);
    const auto outlier = r > huber;
    sum += outlier ? huber * (2 * r - huber) : squares;
    simd(g[kInformation] + i) = squared_weight * (outlier ? huber / r : one);
  }
  *loss = total(sum);
  *too_close = close[0] || close[1] || close[2] || close[3];
}

GSV_VECTOR_LOOP void sumBlocks(const Reprojections::Group& group, const Eigen::Isometry3d& T_o_a,
                               double* rows, double* anchor_sums, ProjectionSums* sums) {
  const Reprojections::Group in = group;
  const Eigen::Matrix4d& T = T_o_a.matrix();
  for (std::size_t i = 0; i < in.count; i += kSimdDoubles) {
    const Doubles &inverse_z = simd(in[kInverseZ] + i), &w = simd(in[kInformation] + i);
    const ProjectionJacobian J{simd(in[kUX] + i), simd(in[kUY] + i),
                               simd(in[kRho] + i) * inverse_z};
    sums->add(J, w, Doubles{}, w, simd(in[kEX] + i), simd(in[kEY] + i));

    // By the inverse depth, and this times the information.
    const Doubles d_x = inverse_z * (T(0, 3) - J.ux * T(2, 3));
    const Doubles d_y = inverse_z * (T(1, 3) - J.uy * T(2, 3));
    const Doubles weighted_x = w * d_x, weighted_y = w * d_y;
    Doubles values[Reprojections::kRow];
    values[6] = weighted_x * d_x + weighted_y * d_y;
    values[7] = weighted_x * simd(in[kEX] + i) + weighted_y * simd(in[kEY] + i);
    J.multiplyTransposed(-weighted_x, -weighted_y, values);  // the observer moves: -J
    const Doubles b_x = inverse_z * weighted_x, b_y = inverse_z * weighted_y;
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
  numbers_.resize(kArrays * size);
  landmark_.resize(size);
  row_.resize(size);
  // The last residual of a group also fills its last vector; the copies have no weight.
  std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
  for (const Residual& residual : residuals) {
    const Group g = at(residual.group);
    const Eigen::Vector3d& ray = rays[residual.landmark];
    const std::size_t begin = begin_[residual.group], i = next[residual.group]++ - begin;
    for (std::size_t k = i; k < padded(i + 1, kSimdDoubles); ++k) {
      landmark_[begin + k] = residual.landmark;
      row_[begin + k] = k == i ? residual.row : kPaddingRow;
      g[kRayX][k] = ray.x();
      g[kRayY][k] = ray.y();
      g[kX][k] = residual.x.x();
      g[kY][k] = residual.x.y();
      g[kWeight][k] = k == i ? residual.weight : 0;
    }
  }
}

Reprojections::Group Reprojections::at(std::size_t group) {
  const std::size_t begin = begin_[group];
  return {begin_[group + 1] - begin, numbers_.data() + kArrays * begin, landmark_.data() + begin,
          row_.data() + begin};
}

double Reprojections::cost(std::size_t group, const Eigen::Isometry3d& T_o_a,
                           const std::vector<double>& inverse_depths, double huber,
                           double min_depth) {
  const Group g = at(group);
  for (std::size_t i = 0; i < g.count; ++i) g[kRho][i] = inverse_depths[g.landmark[i]];
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

}  // namespace gsv
