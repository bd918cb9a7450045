#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "vo/tracking.hpp"

namespace ground_scale_vo {
namespace {

/// Blurred noise (grey 50-100), shifted left by shift_px.
cv::Mat scene(int shift_px = 0) {
  cv::Mat noise(24, 80 + 20, CV_8UC1);
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(noise, noise, {}, 1.5);
  cv::normalize(noise, noise, 50, 100, cv::NORM_MINMAX);
  return noise(cv::Rect(shift_px, 0, 80, 24)).clone();
}

TEST(Exposure, FindsAStepInAMovingSceneDespiteBlackAndSaturatedPixels) {
  for (const double gain : {0.4, 0.7, 1.5, 2.4}) {
    EXPECT_NEAR(exposureStep(scene(), applyGain(scene(1), gain)), gain, 0.06 * gain) << gain;
    for (const int grey : {0, 255}) {
      for (const bool in_previous : {false, true}) {
        cv::Mat previous = scene(), current = applyGain(scene(), gain);
        (in_previous ? previous : current).colRange(0, 27) = grey;  // a third of the image
        EXPECT_NEAR(exposureStep(previous, current), gain, 0.06 * gain) << grey << in_previous;
      }
    }
  }
}

TEST(Exposure, ReportsNoStepForOtherChanges) {
  EXPECT_EQ(exposureStep(scene(), scene()), 1);
  EXPECT_EQ(exposureStep(scene(), scene(7)), 1) << "motion";
  EXPECT_EQ(exposureStep(scene(), applyGain(scene(), 1.15)), 1) << "too small";
  EXPECT_EQ(exposureStep(applyGain(scene(), 0.3), applyGain(scene(), 1.8)), 1) << "too large";
  EXPECT_EQ(exposureStep(scene(), applyGain(scene(), 0)), 1) << "black";
  EXPECT_EQ(exposureStep(scene(), cv::Mat(24, 80, CV_8UC1, cv::Scalar(255))), 1) << "white";
  cv::Mat half = scene();
  half.colRange(0, 45) *= 0.4;
  EXPECT_EQ(exposureStep(scene(), half), 1) << "a dark object in front of half of the image";
  cv::Mat other(24, 80, CV_8UC1);
  cv::RNG(8).fill(other, cv::RNG::UNIFORM, 10, 120);
  EXPECT_EQ(exposureStep(scene(), other), 1) << "another scene";
  EXPECT_EQ(applyGain(scene(), 100).at<unsigned char>(5, 5), 255) << "saturates";
}

}  // namespace
}  // namespace ground_scale_vo
