#include "ground_scale_vo/scale/pose_covariance.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <vector>

#include "ground_scale_vo/vo/pose_estimation.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kScale = 3;  // [m per VO unit]

/// Points in front of a camera, observed with noise, and the pose estimated from them. The true
/// pose is the identity.
class NoisyFrame {
 public:
  NoisyFrame(unsigned seed, double noise_px, int points = 200) : random_(seed) {
    camera_ = {1241, 376, 718.0, 718.0, 607.0, 185.0};
    for (int i = 0; i < points; ++i) {
      const Eigen::Vector2d u(uniform(0, 1240), uniform(0, 375));
      points_.push_back(camera_.ray(u) * uniform(2, 20));
    }
    observe(noise_px);
  }

  const VoFrame& frame() const { return frame_; }
  VoFrame& frame() { return frame_; }
  /// Position [m], then rotation, in camera axes.
  Vector6d error() const {
    Vector6d error;
    error << kScale * frame_.T_w_c.translation(), rotationVector(frame_.T_w_c.linear());
    return error;
  }

 private:
  double uniform(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random_);
  }
  void observe(double noise_px) {
    std::normal_distribution<double> noise(0, noise_px);
    std::vector<PointObservation> observations;
    for (const Eigen::Vector3d& p : points_) {
      TrackedFeature feature;
      feature.has_point = true;
      const Eigen::Vector2d u =
          camera_.project(p) + Eigen::Vector2d(noise(random_), noise(random_));
      feature.u = u.cast<float>();
      frame_.features.push_back(feature);
      observations.push_back(
          {p, Eigen::Vector3d::Zero(), camera_.ray(u).head<2>(), noise_px / camera_.fx});
    }
    frame_.status = VoStatus::kTracking;
    frame_.camera = camera_;
    frame_.T_w_c = PoseEstimation({}).estimate(Eigen::Isometry3d::Identity(), observations).T_w_c;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      frame_.features[i].p_c = (frame_.T_w_c.inverse() * points_[i]).cast<float>();
    }
  }

  std::mt19937 random_;
  PinholeCamera camera_;
  std::vector<Eigen::Vector3d> points_;
  VoFrame frame_;
};

TEST(PoseCovariance, IsConsistentWithTheErrorOfTheEstimatedPose) {
  constexpr int kRuns = 200;
  for (const double noise_px : {0.1, 1.0}) {
    double nees = 0;
    for (unsigned seed = 0; seed < kRuns; ++seed) {
      const NoisyFrame noisy(seed, noise_px);
      const Matrix6d P = poseCovariance(noisy.frame(), kScale);
      nees += noisy.error().dot(P.ldlt().solve(noisy.error())) / 6 / kRuns;
    }
    // The robust weights of PoseEstimation cost some of the efficiency of least squares.
    EXPECT_GT(nees, 0.8) << noise_px;
    EXPECT_LT(nees, 1.5) << noise_px;
  }
}

TEST(PoseCovariance, IsRobustAgainstWrongPoints) {
  NoisyFrame noisy(1, 0.3);
  const Matrix6d before = poseCovariance(noisy.frame(), kScale);
  noisy.frame().features[20].u.x() = std::numeric_limits<float>::quiet_NaN();
  for (int i = 0; i < 20; ++i) {
    noisy.frame().features[static_cast<std::size_t>(i)].p_c *= 0.01f;
    noisy.frame().features[static_cast<std::size_t>(i)].p_c.x() += 0.1f;
  }
  const Matrix6d after = poseCovariance(noisy.frame(), kScale);
  for (int k = 0; k < 6; ++k) EXPECT_NEAR(after(k, k) / before(k, k), 1.2, 0.3) << k;
}

TEST(PoseCovariance, IsZeroWithoutEnoughPointsAndFiniteForCoincidentOnes) {
  EXPECT_EQ(poseCovariance({}, kScale).norm(), 0);
  NoisyFrame noisy(1, 0.3);
  for (TrackedFeature& feature : noisy.frame().features) {
    feature.p_c = Eigen::Vector3f(0, 0, 5);
    feature.u = Eigen::Vector2f(608, 185);
  }
  const Matrix6d P = poseCovariance(noisy.frame(), kScale);
  EXPECT_TRUE(P.allFinite());
  EXPECT_GE(P.diagonal().minCoeff(), 0);
  noisy.frame().features.resize(kMinPosePoints - 1);
  EXPECT_EQ(poseCovariance(noisy.frame(), kScale).norm(), 0);
}

}  // namespace
}  // namespace ground_scale_vo
