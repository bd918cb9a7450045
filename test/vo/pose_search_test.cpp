#include "vo/pose_search.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::pose;

const PinholeCamera kCamera = test::testCamera();
constexpr double kDistance = 20;               // of the wall from the previous camera [VO units]
constexpr std::int64_t kPeriod = 100'000'000;  // [ns]
constexpr std::int64_t kGap = 20 * kPeriod;    // between the two images
const Eigen::Vector3d kStep(0, 0, 0.15);       // in each period before the gap

/// Image of a wall with a random texture, orthogonal to the z axis of v.
cv::Mat wallFrom(const Eigen::Isometry3d& T_v_c, std::uint64_t seed) {
  constexpr double kScale = 20;  // [px of the texture per VO unit]
  cv::Mat texture(1200, 3000, CV_8UC1), image;
  cv::RNG(seed).fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {0, 0}, 4);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  const Eigen::Vector3d& t = T_v_c.translation();
  Eigen::Matrix3d M, K;
  M << kScale * (kDistance - t.z()), 0, kScale * t.x() + 1500, 0, kScale * (kDistance - t.z()),
      kScale * t.y() + 600, 0, 0, 1;
  K << kCamera.fx, 0, kCamera.cx, 0, kCamera.fy, kCamera.cy, 0, 0, 1;
  const Eigen::Matrix3d H = M * T_v_c.linear() * K.inverse();
  const cv::Matx33d homography(H(0, 0), H(0, 1), H(0, 2), H(1, 0), H(1, 1), H(1, 2), H(2, 0),
                               H(2, 1), H(2, 2));
  cv::warpPerspective(texture, image, homography, {kCamera.width, kCamera.height},
                      cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  return image;
}

/// The previous camera v is somewhere in the map.
class PoseSearchTest : public testing::Test {
 protected:
  PoseSearchTest() {
    std::vector<LocalMap::Corner> corners;
    for (int v = 20; v < kCamera.height - 20; v += 16) {
      for (int u = 20; u < kCamera.width - 20; u += 16) {
        Feature feature;
        feature.id = features_.size();
        feature.age = 3;
        feature.u = {u, v};
        features_.push_back(feature);
        corners.push_back({feature.id, kCamera.ray(feature.u).head<2>(), 0.001});
      }
    }
    map_.addKeyframe(T_w_v_, corners);
    for (auto& [id, landmark] : map_.landmarks()) {
      landmark.depth = InverseDepth{1 / kDistance, 1e-4};
    }
    motion_.reset(T_w_v_ * pose({0, 0, 0}, -kStep), 0);
    motion_.update(T_w_v_, kPeriod);
  }

  std::optional<PoseSearch::Result> locate(const cv::Mat& image) const {
    return PoseSearch(kCamera, {}, {})
        .locate(map_, motion_, features_, wallFrom(Eigen::Isometry3d::Identity(), 1), image,
                kPeriod + kGap);
  }

  const Eigen::Isometry3d T_w_v_ = pose({0.1, 0.5, -0.2}, {5, 6, 7});
  LocalMap map_{{}};
  MotionModel motion_;
  std::vector<Feature> features_;
};

TEST_F(PoseSearchTest, FindsThePoseAfterATurn) {
  for (const double yaw : {-0.2, 0.3}) {
    // Along an arc of the length of 20 steps.
    const Eigen::Isometry3d T_v_c =
        pose({0, yaw, 0}, {3 * std::sin(yaw / 2), 0, 3 * std::cos(yaw / 2)});
    const auto result = locate(wallFrom(T_v_c, 1));
    ASSERT_TRUE(result) << yaw;
    const Eigen::Isometry3d found = T_w_v_.inverse() * result->T_w_c;
    EXPECT_LT(test::angleBetween(found, T_v_c), 0.003) << yaw;
    EXPECT_LT((found.translation() - T_v_c.translation()).norm(), 0.1) << yaw;
    EXPECT_GT(result->rotation_sigma, 1e-5);
    EXPECT_LT(result->rotation_sigma, 1e-2);
    EXPECT_GT(result->features.size(), 100u);
    for (const Feature& feature : result->features) {
      EXPECT_EQ(feature.age, 4u);
      const Eigen::Vector3d p_v = kDistance * kCamera.ray(features_[feature.id].u);
      EXPECT_LT((feature.u - kCamera.project(T_v_c.inverse() * p_v)).norm(), 6);
    }
  }
}

TEST_F(PoseSearchTest, FindsNoneInAnImageOfAnotherPlace) {
  EXPECT_FALSE(locate(wallFrom(Eigen::Isometry3d::Identity(), 2)));
}

}  // namespace
}  // namespace ground_scale_vo
