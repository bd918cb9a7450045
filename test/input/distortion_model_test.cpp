#include "input/distortion_model.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <string>
#include <vector>

namespace ground_scale_vo {
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
    model.distort(points, c.coefficients, &distorted);
    model.undistort(distorted, c.coefficients, &undistorted);
    EXPECT_NEAR(cv::norm(distorted[0]), 0, 1e-9);
    EXPECT_NEAR(cv::norm(distorted[1] - c.distorted), 0, 1e-6);
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_NEAR(cv::norm(undistorted[i] - points[i]), 0, 1e-3) << i;
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
