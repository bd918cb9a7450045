#include "input/distortion_model.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

namespace gsv {
namespace {

TEST(DistortionModel, DistortsAndUndistorts) {
  const struct {
    std::string name;
    DistortionModel::Coefficients coefficients;
    cv::Point2d distorted;  ///< of (0.6, -0.8)
  } kCases[] = {
      {"plumb_bob", {-0.05, 0, 0, 0}, {0.57, -0.76}},
      {"rational_polynomial", {0, 0, 0, 0, 0, 0.1, 0, 0}, {0.54545455, -0.72727273}},
      {"equidistant", {0, 0, 0, 0}, {0.47123890, -0.62831853}},
  };
  for (const auto& c : kCases) {
    SCOPED_TRACE(c.name);
    const DistortionModel& model = modelNamed(c.name, &DistortionModel::names, "");
    const DistortionModel::Points points{{0, 0}, {0.6, -0.8}};
    DistortionModel::Points distorted, undistorted;
    model.validate(c.coefficients);
    for (const cv::Point2d& x : points) {
      const Eigen::Vector2d d = model.distort({x.x, x.y}, c.coefficients, nullptr);
      distorted.emplace_back(d.x(), d.y());
    }
    model.undistort(distorted, c.coefficients, &undistorted);
    EXPECT_NEAR(cv::norm(distorted[0]), 0, 1e-9);
    EXPECT_NEAR(cv::norm(distorted[1] - c.distorted), 0, 1e-6);
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_NEAR(cv::norm(undistorted[i] - points[i]), 0, 1e-3) << i;
    }
  }
}

// All coefficients, as OpenCV has them; with the derivative.
TEST(DistortionModel, DistortsAsOpenCv) {
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
    }
  }
}

}  // namespace
}  // namespace gsv
