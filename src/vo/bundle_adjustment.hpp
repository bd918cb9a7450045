#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "vo/map.hpp"
#include "vo/reprojections.hpp"

namespace gsv {

constexpr int kMaxAdjustmentIterations = 6;  ///< of Levenberg-Marquardt: more change little
/// [standard deviations] residual above which Huber's loss is linear.
constexpr double kHuberSigma = 1;

/// Optimises the poses of the newest keyframes and the inverse depths of the landmarks that they
/// observe: reprojection error with Huber's loss, Levenberg-Marquardt. Older keyframes are fixed,
/// which fixes the gauge (7 degrees of freedom). While fewer than two keyframes are older than the
/// window, the first keyframe of the map and its distance to the newest one are fixed instead.
/// The inverse depths are eliminated by the Schur complement. Residuals: Reprojections.
///
/// The flat arrays keep their memory from one adjustment to the next. A keyframe is numbered by its
/// position in the map; those from `first_free_` on have six rows each in the normal equations.
class BundleAdjustment {
 public:
  /// window: [keyframes] newest ones that are optimised.
  explicit BundleAdjustment(int window) : window_(static_cast<std::size_t>(window)) {}

  /// Copies poses, inverse depths and observations from the map.
  void load(const LocalMap& map);
  /// Does not access the map, so it can run on another thread. Takes nearly all of the time. False
  /// if there are too few landmarks, the result is not finite, or no step can be computed: store()
  /// then leaves the map unchanged.
  bool solve();
  /// Writes the poses and inverse depths of the last solve() to the map. Precondition: it has the
  /// keyframes and landmarks that it had in load().
  void store(LocalMap* map) const;

 private:
  /// Its rows (Reprojections) are those of its fixed observers, then one per free keyframe from the
  /// first to the last that observes it, so that sums over them need no indices. The anchor has no
  /// residual; a keyframe between these that does not observe the landmark has a row of zeros.
  struct Unknown {
    std::uint64_t id;
    bool free_anchor;
    std::size_t begin, free_begin, end;  // of its rows
    std::size_t first_block;             // free keyframe of the row free_begin
    double H_ll, gradient;               // over its inverse depth

    std::size_t blocks() const { return end - free_begin; }
  };
  /// Relative pose of an observer o and an anchor a, shared by all landmarks of the anchor that the
  /// observer observes: a group of residuals.
  struct RelativePose {
    std::size_t observer, anchor;
    Eigen::Isometry3d T_o_a;
  };

  void addLandmark(const Landmark& landmark, const LocalMap& map);
  std::size_t addRow(std::size_t keyframe, Unknown* landmark) const;
  std::size_t relativePose(std::size_t observer, std::size_t anchor);

  double cost(const std::vector<Eigen::Isometry3d>& T_w_c,
              const std::vector<double>& inverse_depths);
  void linearise();
  void addPoseBlocks(const RelativePose& relative, const Matrix6d& H_oo,
                     const Vector6d& gradient_o);
  void finishLandmark(std::size_t i);

  void minimise(double now);
  std::optional<double> makeStep(double damping);
  void eliminateLandmarks(double damping);
  void padStep();
  double gradientAfterPoseStep(const Unknown& landmark) const;

  double baseline() const;
  void rescale(double factor);

  std::size_t keyframes() const { return T_w_c_.size(); }
  bool isFixed(std::size_t keyframe) const { return keyframe < first_free_; }
  std::size_t freeKeyframes() const { return keyframes() - first_free_; }
  /// First row of the keyframe in the normal equations.
  Eigen::Index row(std::size_t keyframe) const {
    return static_cast<Eigen::Index>(6 * (keyframe - first_free_));
  }

  const std::size_t window_;
  std::size_t first_free_ = 0;
  std::vector<Unknown> landmarks_;
  std::vector<Eigen::Vector3d> rays_;  // of the landmarks, in the anchor, z = 1
  std::vector<Reprojections::Residual> residuals_;
  std::vector<RelativePose> relative_poses_;
  std::vector<std::size_t> relative_pose_of_;  // [observer * keyframes + anchor]; kNone: not needed
  std::vector<Eigen::Isometry3d> T_w_c_, candidate_T_w_c_;         // of the keyframes
  std::vector<double> inverse_depths_, candidate_inverse_depths_;  // of the landmarks
  bool usable_ = false;

  Reprojections reprojections_;
  std::vector<double> rows_;         // of the landmarks
  std::vector<double> anchor_sums_;  // three numbers per landmark

  // Normal equations of the poses; lower triangles.
  Eigen::MatrixXd H_pp_;
  Eigen::VectorXd gradient_;
  Eigen::MatrixXd schur_complement_;  // H_pp - H_pl H_ll^-1 H_lp, damped
  Eigen::VectorXd step_;
  // Sum over the landmarks of H_pl H_ll^-1 H_lp, in rows of kRow numbers per free keyframe.
  std::vector<double> eliminated_;
  std::vector<double> padded_;  // one row per free keyframe
};

}  // namespace gsv
