#include "lens/lens_segment.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace gsv {
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

/// Cholesky factorisation in place of the lower part of a matrix of 6x6 blocks, of which only
/// `band` rows below the blocks on the diagonal are not zero.
void factoriseBand(Eigen::Index band, Eigen::MatrixXd* A) {
  for (Eigen::Index k = 0; k < A->rows(); k += 6) {
    const Eigen::Index below = std::min(band, A->rows() - k - 6);
    Matrix6d L = A->block<6, 6>(k, k).llt().matrixL();
    A->block<6, 6>(k, k) = L;
    auto panel = A->block(k + 6, k, below, 6);
    L.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(panel);
    A->block(k + 6, k + 6, below, below).selfadjointView<Eigen::Lower>().rankUpdate(panel, -1);
  }
}

/// Solves L L^T X = B in place.
void solveBand(const Eigen::MatrixXd& L, Eigen::Index band, Eigen::MatrixXd* B) {
  for (Eigen::Index k = 0; k < L.rows(); k += 6) {
    const Eigen::Index below = std::min(band, L.rows() - k - 6);
    auto x = B->middleRows<6>(k);
    L.block<6, 6>(k, k).triangularView<Eigen::Lower>().solveInPlace(x);
    B->middleRows(k + 6, below).noalias() -= L.block(k + 6, k, below, 6) * x;
  }
  for (Eigen::Index k = L.rows() - 6; k >= 0; k -= 6) {
    const Eigen::Index below = std::min(band, L.rows() - k - 6);
    auto x = B->middleRows<6>(k);
    x.noalias() -= L.block(k + 6, k, below, 6).transpose() * B->middleRows(k + 6, below);
    L.block<6, 6>(k, k).transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  }
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
    band_ = std::max(band_, row(track.observations.back().keyframe + 1) - row(track.frame + 1));
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

double LensSegment::turned() const {
  double angle = 0;
  for (const Eigen::Isometry3d& T : T_c_w_) {
    angle = std::max(angle,
                     Eigen::AngleAxisd(T_c_w_.front().linear().transpose() * T.linear()).angle());
  }
  return angle;
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

/// False for a point behind a camera.
template <int kParameters>
bool LensSegment::linearise(const Lens& lens, const TrackNoise& noise, const LensTrack& track,
                            Linearisation<kParameters>* result) const {
  const auto n = static_cast<Eigen::Index>(track.observations.size());
  const Eigen::Isometry3d& frame = initial_T_w_c_[track.frame];
  const Eigen::Vector2d f(lens.camera.fx, lens.camera.fy);
  result->J_c.resize(track.observations.size());
  result->J.resize(2 * n, Eigen::NoChange);
  for (Eigen::Index i = 0; i < n; ++i) {
    const LensObservation& o = track.observations[static_cast<std::size_t>(i)];
    const Eigen::Vector3d q = inCamera(track, o.keyframe);
    if (!(q.z() > kMinDepthRatio * q.norm())) return false;
    const Eigen::Vector2d x = q.hnormalized();
    Eigen::Matrix2d d_distorted;
    const Eigen::Vector2d by_model = lens.distortByModel(x, &d_distorted);
    const Eigen::Vector2d distorted = lens.distortRest(by_model, &d_distorted);
    Matrix23 d_x;
    d_x << 1, 0, -x.x(), 0, 1, -x.y();
    const Matrix23 J_q = f.asDiagonal() * d_distorted * (d_x / q.z());
    // The pose changes to (exp([w]x) R, exp([w]x) t + v).
    result->J_c[static_cast<std::size_t>(i)] << -J_q * skew(q), track.point.z() * J_q;
    Eigen::Matrix3d d_point;
    d_point << T_c_w_[o.keyframe].linear() * frame.linear().leftCols<2>(),
        T_c_w_[o.keyframe] * frame.translation();
    const double r2 = by_model.squaredNorm();
    const Eigen::Vector2d cubic = r2 * f.cwiseProduct(by_model);
    Eigen::Matrix<double, 2, 3 + kParameters + 1> J;
    J.template leftCols<3 + kLensParameters>() << J_q * d_point, f.cwiseProduct(distorted),
        Eigen::Matrix2d::Identity(), cubic, r2 * cubic;
    if constexpr (kParameters > kLensParameters) {
      const auto terms = fieldTerms(lens, o.u);
      J.template middleCols<kFieldParameters>(3 + kLensParameters) << terms, 0 * terms, 0 * terms,
          terms;
    }
    J.template rightCols<1>() = lens.camera.project(distorted.homogeneous()) - o.u;
    result->J.row(i) = J.row(0);
    result->J.row(n + i) = J.row(1);
  }
  result->WJ.resize(2 * n, Eigen::NoChange);
  result->WJ.topRows(n) = track.information.lazyProduct(result->J.topRows(n));
  result->WJ.bottomRows(n) = track.information.lazyProduct(result->J.bottomRows(n));
  const double information = 1 / (noise.sigma_px * noise.sigma_px);
  const double chi2 =
      information * result->J.template rightCols<1>().dot(result->WJ.template rightCols<1>());
  result->weight = information * noise.weight(chi2, track.redundancy());
  result->WJ *= result->weight;
  return true;
}

/// Adds a track, without its point, to the normal equations of poses, lens and field.
template <int kParameters>
void LensSegment::eliminate(std::size_t index, const Linearisation<kParameters>& system,
                            double damping) {
  constexpr int kColumns = kParameters + 1;
  const LensTrack& track = tracks_[index];
  const auto n = static_cast<Eigen::Index>(track.observations.size());
  const auto WJ_p = system.WJ.template leftCols<3>();
  const Eigen::Matrix<double, 3, 3 + kColumns> H =
      system.J.template leftCols<3>().transpose().lazyProduct(system.WJ);
  Eigen::Matrix3d H_pp = H.template leftCols<3>();
  H_pp.diagonal() *= 1 + damping;
  H_pp.diagonal().array() += kRidge * H_pp.trace();
  const Eigen::Matrix3d inverse = H_pp.inverse();
  eliminations_.push_back({index, observations_.size(), inverse, H.template rightCols<1>(),
                           H.template middleCols<kLensParameters>(3)});

  // The information of the track after the elimination of the point is W - gain WJ_p^T; Q is its
  // product with the Jacobian by the lens and with the error.
  const Rows<3> gain = WJ_p.lazyProduct(inverse);
  const Rows<kColumns> Q =
      system.WJ.template rightCols<kColumns>() - gain.lazyProduct(H.template rightCols<kColumns>());
  schur_.ll.noalias() += system.J.template middleCols<kParameters>(3).transpose() * Q;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Jacobian26& J_c = system.J_c[static_cast<std::size_t>(i)];
    Observation observation{J_c, {}};
    observation.WJ_p << WJ_p.row(i), WJ_p.row(n + i);
    observations_.push_back(observation);
  }
  const Observation* observations = &observations_[eliminations_.back().first_observation];
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::size_t keyframe = track.observations[static_cast<std::size_t>(i)].keyframe;
    if (keyframe == 0) continue;
    const Jacobian26& J_c = observations[i].J_c;
    Eigen::Matrix<double, 2, kColumns> Q_i;
    Q_i << Q.row(i), Q.row(n + i);
    schur_.cl.middleRows<6>(row(keyframe)) += J_c.transpose().lazyProduct(Q_i);
    Matrix23 gain_i;
    gain_i << gain.row(i), gain.row(n + i);
    for (Eigen::Index j = 0; j <= i; ++j) {  // the lower triangle
      const std::size_t other = track.observations[static_cast<std::size_t>(j)].keyframe;
      if (other == 0) continue;
      Eigen::Matrix2d P = -gain_i * observations[j].WJ_p.transpose();
      P.diagonal().array() += system.weight * track.information(i, j);
      const Jacobian26 PJ = P * observations[j].J_c;
      schur_.cc.block<6, 6>(row(keyframe), row(other)) += J_c.transpose().lazyProduct(PJ);
    }
    schur_.diagonal.segment<6>(row(keyframe)) +=
        system.weight * track.information(i, i) * J_c.colwise().squaredNorm();
  }
}

template <int kParameters>
void LensSegment::assemble(const Lens& lens, const TrackNoise& noise, double damping) {
  const Eigen::Index n = row(T_c_w_.size());
  schur_.cc.resize(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    schur_.cc.col(i).segment(i, std::min(band_ + 6, n - i)).setZero();
  }
  schur_.cl = Eigen::MatrixXd::Zero(n, kParameters + 1);
  schur_.ll = Eigen::MatrixXd::Zero(kParameters, kParameters + 1);
  schur_.diagonal = Eigen::VectorXd::Zero(n);
  observations_.clear();
  eliminations_.clear();
  Linearisation<kParameters> system;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    if (tracks_[i].used && linearise(lens, noise, tracks_[i], &system)) {
      eliminate(i, system, damping);
    }
  }
  schur_.cc.diagonal() += damping * schur_.diagonal;
  schur_.cc.diagonal().array() += kRidge * schur_.diagonal.maxCoeff();
  fixGauge();
}

/// A stiff prior on the distance of the farthest keyframe.
void LensSegment::fixGauge() {
  if (farthest_ == 0) return;
  const Eigen::Vector3d direction = T_c_w_[farthest_].translation().normalized();
  schur_.cc.block<3, 3>(row(farthest_) + 3, row(farthest_) + 3) +=
      direction * direction.transpose() / (kScaleSigma * kScaleSigma);
}

LensSegment::Reduced LensSegment::solve() {
  const Eigen::Index parameters = schur_.ll.rows();
  factoriseBand(band_, &schur_.cc);
  Eigen::MatrixXd X = schur_.cl;
  solveBand(schur_.cc, band_, &X);
  poses_per_lens_ = X.leftCols(parameters);
  poses_ = X.rightCols<1>();
  const Eigen::MatrixXd reduced = schur_.ll - poses_per_lens_.transpose() * schur_.cl;
  return {reduced.leftCols(parameters), reduced.rightCols<1>(), {}};
}

LensSegment::Reduced LensSegment::reduce(const Lens& lens, const TrackNoise& noise,
                                         double damping) {
  assemble<kLensParameters>(lens, noise, damping);
  return solve();
}

LensSegment::Reduced LensSegment::reduceWithField(const Lens& lens, const TrackNoise& noise) {
  assemble<kLensParameters + kFieldParameters>(lens, noise, 0);
  Reduced result = solve();
  Linearisation<kLensParameters> system;
  for (const Elimination& elimination : eliminations_) {
    const LensTrack& track = tracks_[elimination.track];
    linearise(lens, noise, track, &system);
    const Eigen::Vector3d point = elimination.H_pp_inverse * elimination.g_p;
    const auto n = static_cast<Eigen::Index>(track.observations.size());
    const Rows<1> error = system.WJ.rightCols<1>() - system.WJ.leftCols<3>() * point;
    LensVector score = system.J.middleCols<kLensParameters>(3).transpose() * error;
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::size_t keyframe = track.observations[static_cast<std::size_t>(i)].keyframe;
      if (keyframe == 0) continue;
      const Vector6d pose = system.J_c[static_cast<std::size_t>(i)].transpose() *
                            Eigen::Vector2d(error[i], error[n + i]);
      score -= poses_per_lens_.block<6, kLensParameters>(row(keyframe), 0).transpose() * pose;
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
    Eigen::Vector3d g = elimination.g_p + elimination.H_pl * lens_delta;
    const Observation* observation = &observations_[elimination.first_observation];
    for (const LensObservation& o : track.observations) {
      if (o.keyframe > 0) {
        const Eigen::Vector2d moved = observation->J_c * poses.segment<6>(row(o.keyframe));
        g += observation->WJ_p.transpose() * moved;
      }
      ++observation;
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

}  // namespace gsv
