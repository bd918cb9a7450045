#include "lens/lens_segment.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace ground_scale_vo {
namespace {

/// [px] A track with a larger error at the initial poses is an outlier.
constexpr double kMaxInitialError_px = 20;
/// Least depth of a point in front of a camera, relative to its distance.
constexpr double kMinDepthRatio = 1e-3;
/// Standard deviation that fixes the unit of length, relative to that length.
constexpr double kScaleSigma = 1e-4;
/// Damping of parameters that no observation determines, relative to the largest diagonal element.
constexpr double kRidge = 1e-9;
/// chi2 of a track with a point behind a camera.
constexpr double kBehindCamera = 1e8;

Eigen::Index row(std::size_t keyframe) { return static_cast<Eigen::Index>(6 * (keyframe - 1)); }

/// d(pixel) / d(lens); x: normalised coordinates without distortion.
Eigen::Matrix<double, 2, kLensParameters> lensJacobian(const Lens& lens, const Eigen::Vector2d& x) {
  const Eigen::Vector2d f(lens.camera.fx, lens.camera.fy);
  const double r2 = x.squaredNorm();
  Eigen::Matrix<double, 2, kLensParameters> J;
  J << f.cwiseProduct(lens.distort(x)), Eigen::Matrix2d::Identity(), f.cwiseProduct(r2 * x),
      f.cwiseProduct(r2 * r2 * x);
  return J;
}

/// The terms of the field at a pixel.
Eigen::Matrix<double, 1, LensSegment::kFieldTerms> fieldTerms(const Lens& lens,
                                                              const Eigen::Vector2d& u) {
  constexpr int kDegree = LensSegment::kFieldDegree;
  const double x = 2 * u.x() / lens.camera.width - 1, y = 2 * u.y() / lens.camera.height - 1;
  double along_x[kDegree + 1] = {1, x}, along_y[kDegree + 1] = {1, y};
  for (int i = 2; i <= kDegree; ++i) {
    along_x[i] = 2 * x * along_x[i - 1] - along_x[i - 2];
    along_y[i] = 2 * y * along_y[i - 1] - along_y[i - 2];
  }
  Eigen::Matrix<double, 1, LensSegment::kFieldTerms> terms;
  int n = 0;
  for (int i = 0; i <= kDegree; ++i) {
    for (int j = 0; i + j <= kDegree; ++j) terms[n++] = along_x[i] * along_y[j];
  }
  return terms;
}

std::vector<std::size_t> keyframesOf(const LensTrack& track) {
  std::vector<std::size_t> keyframes;
  for (const LensObservation& o : track.observations) keyframes.push_back(o.keyframe);
  return keyframes;
}

}  // namespace

LensSegment::LensSegment(const std::vector<Eigen::Isometry3d>& T_w_c, std::vector<LensTrack> tracks,
                         const Lens& lens, const TrackNoise& noise)
    : tracks_(std::move(tracks)) {
  // The first camera is the origin, the distance of the farthest one the unit of length.
  double unit = 0;
  for (std::size_t k = 0; k < T_w_c.size(); ++k) {
    initial_T_w_c_.push_back(T_w_c.front().inverse() * T_w_c[k]);
    const double distance = initial_T_w_c_.back().translation().norm();
    if (distance <= unit) continue;
    unit = distance;
    farthest_ = k;
  }
  for (Eigen::Isometry3d& T : initial_T_w_c_) {
    T.translation() /= unit;
    T_c_w_.push_back(T.inverse());
  }
  for (LensTrack& track : tracks_) {
    track.frame = track.observations.front().keyframe;
    track.information = noise.information(keyframesOf(track));
    triangulate(lens, &track);
  }
}

/// The inverse depth along the ray of the first observation that minimises the algebraic error.
void LensSegment::triangulate(const Lens& lens, LensTrack* track) const {
  track->point.head<2>() = lens.unproject(track->observations.front().u);
  const Eigen::Isometry3d& frame = initial_T_w_c_[track->frame];
  const Eigen::Vector3d ray = frame.linear() * track->point.head<2>().homogeneous();
  double ab = 0, bb = 0;
  for (const LensObservation& o : track->observations) {
    const Eigen::Vector3d at_infinity = T_c_w_[o.keyframe].linear() * ray;
    const Eigen::Vector3d parallax = T_c_w_[o.keyframe] * frame.translation();
    const Eigen::Vector2d x = lens.unproject(o.u);
    const Eigen::Vector2d a = at_infinity.head<2>() - x * at_infinity.z();
    const Eigen::Vector2d b = parallax.head<2>() - x * parallax.z();
    ab += a.dot(b);
    bb += b.squaredNorm();
  }
  track->point.z() = bb > 0 ? std::max(0.0, -ab / bb) : 0;
  const Eigen::MatrixX2d e = errors(lens, *track);
  track->used = e.rows() > 0 && e.rowwise().norm().maxCoeff() < kMaxInitialError_px;
}

/// The point times rho, in the axes of the keyframe's camera.
Eigen::Vector3d LensSegment::inCamera(const LensTrack& track, std::size_t keyframe) const {
  const Eigen::Isometry3d& frame = initial_T_w_c_[track.frame];
  const Eigen::Isometry3d& T_c_w = T_c_w_[keyframe];
  return T_c_w.linear() * (frame.linear() * track.point.head<2>().homogeneous() +
                           track.point.z() * frame.translation()) +
         track.point.z() * T_c_w.translation();
}

/// False for a point behind the camera.
bool LensSegment::project(const Lens& lens, const LensTrack& track, const LensObservation& o,
                          Eigen::Vector2d* error) const {
  const Eigen::Vector3d q = inCamera(track, o.keyframe);
  if (!(q.z() > kMinDepthRatio * q.norm())) return false;
  *error = lens.project(q.hnormalized()) - o.u;
  return true;
}

Eigen::MatrixX2d LensSegment::errors(const Lens& lens, const LensTrack& track) const {
  Eigen::MatrixX2d result(track.observations.size(), 2);
  for (std::size_t i = 0; i < track.observations.size(); ++i) {
    Eigen::Vector2d error;
    if (!project(lens, track, track.observations[i], &error)) return Eigen::MatrixX2d(0, 2);
    result.row(static_cast<Eigen::Index>(i)) = error.transpose();
  }
  return result;
}

/// Stacks the Jacobians of a track in *M: rows x of all observations, then y; columns point, lens,
/// field, error. False for a point behind a camera.
bool LensSegment::stack(const Lens& lens, const LensTrack& track, Eigen::MatrixXd* M,
                        std::vector<Jacobian26>* J_c) const {
  const auto n = static_cast<Eigen::Index>(track.observations.size());
  const Eigen::Isometry3d& frame = initial_T_w_c_[track.frame];
  const Eigen::Vector2d f(lens.camera.fx, lens.camera.fy);
  const bool with_field = M->cols() > 3 + kLensParameters + 1;
  M->setZero();
  J_c->clear();
  for (Eigen::Index i = 0; i < n; ++i) {
    const LensObservation& o = track.observations[static_cast<std::size_t>(i)];
    const Eigen::Vector3d q = inCamera(track, o.keyframe);
    if (!(q.z() > kMinDepthRatio * q.norm())) return false;
    const Eigen::Vector2d x = q.hnormalized();
    Eigen::Matrix2d d_distorted;
    lens.distort(x, &d_distorted);
    Eigen::Matrix<double, 2, 3> d_x;
    d_x << 1 / q.z(), 0, -x.x() / q.z(), 0, 1 / q.z(), -x.y() / q.z();
    const Eigen::Matrix<double, 2, 3> J_q = f.asDiagonal() * d_distorted * d_x;
    // The pose changes to (exp([w]x) R, exp([w]x) t + v).
    Jacobian26 J_pose;
    J_pose << -J_q * skew(q), track.point.z() * J_q;
    J_c->push_back(J_pose);
    Eigen::Matrix3d d_point;
    d_point << T_c_w_[o.keyframe].linear() * frame.linear().leftCols<2>(),
        T_c_w_[o.keyframe] * frame.translation();
    Eigen::Matrix<double, 2, 3 + kLensParameters> J;
    J << J_q * d_point, lensJacobian(lens, x);
    const Eigen::Vector2d error = lens.project(x) - o.u;
    for (int axis = 0; axis < 2; ++axis) {
      auto row_of_M = M->row(axis * n + i);
      row_of_M.head<3 + kLensParameters>() = J.row(axis);
      row_of_M(M->cols() - 1) = error[axis];
      if (!with_field) continue;
      row_of_M.segment<kFieldTerms>(3 + kLensParameters + axis * kFieldTerms) =
          fieldTerms(lens, o.u);
    }
  }
  return true;
}

/// False for a point behind a camera.
bool LensSegment::linearise(const Lens& lens, const TrackNoise& noise, const LensTrack& track,
                            bool with_field, TrackSystem* system) const {
  const auto n = static_cast<Eigen::Index>(track.observations.size());
  const Eigen::Index parameters = kLensParameters + (with_field ? kFieldParameters : 0);
  Eigen::MatrixXd M(2 * n, 3 + parameters + 1);
  if (!stack(lens, track, &M, &system->J_c)) return false;
  system->information = track.information / (noise.sigma_px * noise.sigma_px);
  Eigen::MatrixXd WM(M.rows(), M.cols());
  WM.topRows(n).noalias() = system->information * M.topRows(n);
  WM.bottomRows(n).noalias() = system->information * M.bottomRows(n);
  const double weight = noise.weight(M.rightCols<1>().dot(WM.rightCols<1>()), track.redundancy());
  system->information *= weight;
  WM *= weight;
  const auto J_p = M.leftCols<3>();
  const auto J_l = M.middleCols(3, parameters);
  system->H_pp = J_p.transpose() * WM.leftCols<3>();
  system->H_lp = J_l.transpose() * WM.leftCols<3>();
  system->H_ll = J_l.transpose() * WM.middleCols(3, parameters);
  system->g_p = J_p.transpose() * WM.rightCols<1>();
  system->g_l = J_l.transpose() * WM.rightCols<1>();
  system->H_cp.clear();
  system->H_cl.clear();
  system->g_c.clear();
  for (Eigen::Index i = 0; i < n; ++i) {
    const Jacobian26& J_c = system->J_c[static_cast<std::size_t>(i)];
    Eigen::MatrixXd weighted(2, M.cols());
    weighted << WM.row(i), WM.row(n + i);
    system->H_cp.push_back(J_c.transpose() * weighted.leftCols<3>());
    system->H_cl.push_back(J_c.transpose() * weighted.middleCols(3, parameters));
    system->g_c.push_back(J_c.transpose() * weighted.rightCols<1>());
  }
  return true;
}

/// Adds a track, without its point, to the normal equations of poses and lens.
void LensSegment::eliminate(const LensTrack& track, const TrackSystem& system,
                            const Elimination& elimination, Schur* schur) {
  const Eigen::Matrix3d& inverse = elimination.H_pp_inverse;
  const Eigen::MatrixXd lens_gain = system.H_lp * inverse;
  schur->ll += system.H_ll - lens_gain * system.H_lp.transpose();
  schur->g_l += system.g_l - lens_gain * system.g_p;
  for (std::size_t i = 0; i < track.observations.size(); ++i) {
    const std::size_t keyframe = track.observations[i].keyframe;
    if (keyframe == 0) continue;
    const Matrix63 gain = system.H_cp[i] * inverse;
    schur->cl.middleRows<6>(row(keyframe)) += system.H_cl[i] - gain * system.H_lp.transpose();
    schur->g_c.segment<6>(row(keyframe)) += system.g_c[i] - gain * system.g_p;
    for (std::size_t j = 0; j <= i; ++j) {  // the lower triangle
      const std::size_t other = track.observations[j].keyframe;
      if (other == 0) continue;
      const double w =
          system.information(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      schur->cc.block<6, 6>(row(keyframe), row(other)) +=
          system.J_c[i].transpose() * (w * system.J_c[j]) - gain * system.H_cp[j].transpose();
    }
    const double w = system.information(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i));
    schur->diagonal.segment<6>(row(keyframe)) += w * system.J_c[i].colwise().squaredNorm();
  }
}

LensSegment::Schur LensSegment::assemble(const Lens& lens, const TrackNoise& noise, double damping,
                                         bool with_field) {
  const Eigen::Index n = row(T_c_w_.size());
  const Eigen::Index parameters = kLensParameters + (with_field ? kFieldParameters : 0);
  Schur schur{Eigen::MatrixXd::Zero(n, n),
              Eigen::MatrixXd::Zero(n, parameters),
              Eigen::MatrixXd::Zero(parameters, parameters),
              Eigen::VectorXd::Zero(n),
              Eigen::VectorXd::Zero(parameters),
              Eigen::VectorXd::Zero(n)};
  eliminations_.clear();
  TrackSystem system;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    if (!tracks_[i].used || !linearise(lens, noise, tracks_[i], with_field, &system)) continue;
    Eigen::Matrix3d H_pp = system.H_pp;
    H_pp.diagonal() *= 1 + damping;
    H_pp.diagonal().array() += kRidge * H_pp.trace();
    Elimination elimination{i, H_pp.inverse(), system.g_p, system.H_lp, system.H_cp};
    eliminate(tracks_[i], system, elimination, &schur);
    eliminations_.push_back(std::move(elimination));
  }
  schur.cc.diagonal() += damping * schur.diagonal;
  schur.cc.diagonal().array() += kRidge * schur.diagonal.maxCoeff();
  fixGauge(&schur.cc);
  return schur;
}

/// A stiff prior on the distance of the farthest keyframe.
void LensSegment::fixGauge(Eigen::MatrixXd* S_cc) const {
  if (farthest_ == 0) return;
  const Eigen::Vector3d direction = T_c_w_[farthest_].translation().normalized();
  S_cc->block<3, 3>(row(farthest_) + 3, row(farthest_) + 3) +=
      direction * direction.transpose() / (kScaleSigma * kScaleSigma);
}

LensSegment::Reduced LensSegment::solve(const Schur& schur) {
  const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> factor(schur.cc);
  poses_per_lens_ = factor.solve(schur.cl);
  poses_ = factor.solve(schur.g_c);
  return {schur.ll - schur.cl.transpose() * poses_per_lens_,
          schur.g_l - poses_per_lens_.transpose() * schur.g_c,
          {}};
}

LensSegment::Reduced LensSegment::reduce(const Lens& lens, const TrackNoise& noise,
                                         double damping) {
  return solve(assemble(lens, noise, damping, false));
}

LensSegment::Reduced LensSegment::reduceWithField(const Lens& lens, const TrackNoise& noise) {
  Reduced result = solve(assemble(lens, noise, 0, true));
  const auto X = poses_per_lens_.leftCols<kLensParameters>();
  TrackSystem system;
  for (const Elimination& elimination : eliminations_) {
    const LensTrack& track = tracks_[elimination.track];
    linearise(lens, noise, track, false, &system);
    const Eigen::Vector3d point = elimination.H_pp_inverse * system.g_p;
    LensVector score = system.g_l - system.H_lp * point;
    for (std::size_t i = 0; i < track.observations.size(); ++i) {
      const std::size_t keyframe = track.observations[i].keyframe;
      if (keyframe == 0) continue;
      score -=
          X.middleRows<6>(row(keyframe)).transpose() * (system.g_c[i] - system.H_cp[i] * point);
    }
    result.scores.push_back(score);
  }
  return result;
}

void LensSegment::update(const LensVector& lens_delta) {
  previous_poses_ = T_c_w_;
  previous_points_.clear();
  for (const LensTrack& track : tracks_) previous_points_.push_back(track.point);
  const Eigen::VectorXd poses =
      -(poses_ + poses_per_lens_.leftCols<kLensParameters>() * lens_delta);
  for (std::size_t k = 1; k < T_c_w_.size(); ++k) {
    T_c_w_[k] = motionFrom(poses.segment<6>(row(k))) * T_c_w_[k];
    T_c_w_[k].linear() = renormalised(T_c_w_[k].linear());
  }
  for (const Elimination& elimination : eliminations_) {
    LensTrack& track = tracks_[elimination.track];
    Eigen::Vector3d g =
        elimination.g_p + elimination.H_lp.topRows<kLensParameters>().transpose() * lens_delta;
    for (std::size_t i = 0; i < track.observations.size(); ++i) {
      const std::size_t keyframe = track.observations[i].keyframe;
      if (keyframe == 0) continue;
      g += elimination.H_cp[i].transpose() * poses.segment<6>(row(keyframe));
    }
    track.point -= elimination.H_pp_inverse * g;
  }
}

void LensSegment::undo() {
  T_c_w_ = previous_poses_;
  for (std::size_t i = 0; i < tracks_.size(); ++i) tracks_[i].point = previous_points_[i];
}

std::vector<double> LensSegment::variances(const Lens& lens) const {
  std::vector<double> result;
  for (const LensTrack& track : tracks_) {
    if (!track.used) continue;
    const Eigen::MatrixX2d e = errors(lens, track);
    const double chi2 =
        e.rows() > 0 ? (track.information * e).cwiseProduct(e).sum() : kBehindCamera;
    result.push_back(chi2 / track.redundancy());
  }
  return result;
}

double LensSegment::cost(const Lens& lens, const TrackNoise& noise) const {
  const std::vector<double> variance = variances(lens);
  double sum = 0;
  std::size_t i = 0;
  for (const LensTrack& track : tracks_) {
    if (!track.used) continue;
    const int redundancy = track.redundancy();
    sum += noise.cost(redundancy * variance[i++] / (noise.sigma_px * noise.sigma_px), redundancy);
  }
  return sum;
}

std::vector<LensResidual> LensSegment::residuals(const Lens& lens) const {
  std::vector<LensResidual> result;
  for (const LensTrack& track : tracks_) {
    if (!track.used) continue;
    const Eigen::MatrixX2d e = errors(lens, track);
    for (Eigen::Index i = 0; i < e.rows(); ++i) {
      result.push_back({track.observations[static_cast<std::size_t>(i)].u, e.row(i)});
    }
  }
  return result;
}

void LensSegment::rejectOutliers(const Lens& lens, const TrackNoise& noise, double max_error_px,
                                 std::size_t min_observations) {
  for (LensTrack& track : tracks_) {
    if (!track.used) continue;
    std::vector<LensObservation> inliers;
    for (const LensObservation& o : track.observations) {
      Eigen::Vector2d error;
      if (project(lens, track, o, &error) && error.norm() <= max_error_px) inliers.push_back(o);
    }
    track.used =
        inliers.size() >= min_observations && 2 * inliers.size() >= track.observations.size();
    if (!track.used || inliers.size() == track.observations.size()) continue;
    track.observations = std::move(inliers);
    track.information = noise.information(keyframesOf(track));
  }
}

}  // namespace ground_scale_vo
