#include "input/distortion_model.hpp"

#include <opencv2/calib3d.hpp>

#include "support/test.hpp"

namespace gsv {
namespace {

// All coefficients, as OpenCV has them; with the derivative and the inverse.
TEST(DistortionModel, DistortsAsOpenCvAndUndistorts) {
  const DistortionModel::Coefficients all{0.2,  -0.1, 1e-3,  2e-3, 0.05, 0.1,  -0.03,
                                          0.02, 3e-3, -2e-3, 1e-3, 4e-3, 0.03, -0.02};
  const Eigen::Vector2d x(0.6, -0.8);
  for (const DistortionModel& model : distortionModels()) {
    for (const std::size_t count : model.counts) {
      const DistortionModel::Coefficients k(all.begin(), all.begin() + count);
      DistortionModel::Points expected;
      if (model.is_brown_conrady) {
        cv::projectPoints(std::vector<cv::Point3d>{{x.x(), x.y(), 1}}, cv::Vec3d(), cv::Vec3d(),
                          cv::Matx33d::eye(), k, expected);
      } else {
        cv::fisheye::distortPoints(DistortionModel::Points{{x.x(), x.y()}}, expected,
                                   cv::Matx33d::eye(), k);
      }
      Eigen::Matrix2d jacobian;
      const Eigen::Vector2d distorted = model.distort(x, k, &jacobian);
      EXPECT_NEAR(distorted.x(), expected[0].x, 1e-12) << count;
      EXPECT_NEAR(distorted.y(), expected[0].y, 1e-12) << count;
      for (int i = 0; i < 2; ++i) {
        const Eigen::Vector2d h = 1e-6 * Eigen::Vector2d::Unit(i);
        const Eigen::Vector2d numeric =
            (model.distort(x + h, k, nullptr) - model.distort(x - h, k, nullptr)) / 2e-6;
        EXPECT_LT((numeric - jacobian.col(i)).norm(), 1e-8) << count;
      }
      EXPECT_LT(model.distort({0, 0}, k, &jacobian).norm(), 1e-9) << count;
      DistortionModel::Coefficients mild = k;  // of a lens
      for (double& coefficient : mild) coefficient /= 4;
      const Eigen::Vector2d seen = model.distort(x, mild, nullptr);
      DistortionModel::Points undistorted;
      model.undistort({{seen.x(), seen.y()}}, mild, &undistorted);
      EXPECT_NEAR(cv::norm(undistorted[0] - cv::Point2d(x.x(), x.y())), 0, 1e-3) << count;
    }
  }
}

}  // namespace
}  // namespace gsv
