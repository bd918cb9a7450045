#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"
#include "simulation/tools/distortion.hpp"
#include "support/drive_run.hpp"
#include "support/twist_errors.hpp"

namespace gsv {
namespace {

/// A drive through curves, in images of this lens.
class SelfCalibration : public testing::Test {
 protected:
  static SyntheticDrive::Options curves(int frames) {
    SyntheticDrive::Options options = mediumImages();
    options.frames = frames;
    options.stop_s = 0;
    options.road_shift_m = 25;
    return options;
  }

  /// The outputs for the images of `lens`, of an odometry that is given the exact lens without
  /// distortion. given_sigma: of its k1, of a lens that was estimated from drives.
  static std::vector<MetricOdometry::Output> run(const SyntheticDrive& drive, const Lens& lens,
                                                 bool refine, LensEstimate* refined = nullptr,
                                                 double given_sigma = 0,
                                                 std::string* contradiction = nullptr) {
    MetricOdometry::Options options = optionsFor(drive.cameraHeight());
    options.odometry.refine_camera = refine;
    PinholeCamera camera = drive.camera();
    camera.lens_is_estimated = given_sigma > 0;
    camera.k1_sigma = given_sigma;
    MetricOdometry odometry(camera, options);
    std::vector<MetricOdometry::Output> outputs;
    const Distortion distortion(drive.camera(), lens);
    for (std::size_t i = 0; i < drive.size(); ++i) {
      const bool is_exact = lens.k1 == 0;
      outputs.push_back(odometry.process(
          is_exact ? drive.image(i) : distortion.image(drive.image(i)), drive.frame(i).stamp_ns));
    }
    if (refined) *refined = odometry.lens();
    if (contradiction) *contradiction = odometry.finalLensContradiction();
    return outputs;
  }
};

TEST_F(SelfCalibration, FindsThePlantedDistortionAndContinuesTheMap) {
  const SyntheticDrive drive(curves(130));
  const Lens planted{drive.camera(), 0.05, -0.01};
  LensEstimate refined;
  const auto outputs = run(drive, planted, true, &refined);
  EXPECT_NEAR(refined.lens.k1, planted.k1, 0.015);
  EXPECT_EQ(refined.lens.camera.k1_sigma, refined.sigmas()[3]);
  EXPECT_TRUE(refined.lens.camera.lens_is_estimated);
  std::set<std::uint64_t> before;
  bool has_changed = false;
  std::uint64_t first_new = 0;  // id of a feature
  TwistErrors after_change;
  for (std::size_t i = 1; i < outputs.size(); ++i) {
    const VoFrame& frame = outputs[i].vo.frame;
    EXPECT_EQ(frame.sequence, i);
    EXPECT_EQ(frame.map_id, 0u);
    if (outputs[i].vo.frame.continuity == Continuity::kOtherLens && !has_changed) {
      has_changed = true;
      first_new = frame.features.front().id;
      EXPECT_TRUE(frame.keyframe);
      EXPECT_NE(outputs[i].vo.image.grey.data, outputs[i - 1].vo.image.grey.data);
      for (const TrackedFeature& feature : frame.features) {
        EXPECT_EQ(before.count(feature.id), 0u);
      }
    }
    for (const TrackedFeature& feature : frame.features) before.insert(feature.id);
    for (const RejectedFeature& rejected : outputs[i].vo.rejected) {
      EXPECT_GE(rejected.id, first_new) << i;
    }
    if (!outputs[i].pose() || !outputs[i - 1].pose()) continue;
    const Eigen::Isometry3d step =
        outputs[i - 1].pose()->T_o_c.inverse() * outputs[i].pose()->T_o_c;
    const Eigen::Isometry3d truth = drive.frame(i - 1).T_c0_c.inverse() * drive.frame(i).T_c0_c;
    EXPECT_LT((step.translation() - truth.translation()).norm(), 0.1) << i;
    EXPECT_LT(Eigen::AngleAxisd(step.linear().transpose() * truth.linear()).angle(), 0.01) << i;
    if (has_changed) after_change.add(drive, i, *outputs[i].pose());
  }
  EXPECT_TRUE(outputs.back().pose());
  ASSERT_GT(after_change.count, 30);
  EXPECT_GT(after_change.rms().minCoeff(), 0.25) << after_change.rms().transpose();
  EXPECT_LT(after_change.rms().maxCoeff(), 2) << after_change.rms().transpose();
}

// A dash cam whose images are taken as those of a pinhole, and one with its own calibration.
TEST_F(SelfCalibration, FindsThatTheCalibrationIsOfAnotherLens) {
  SyntheticDrive::Options straight = mediumImages();
  straight.frames = 60;
  for (const SyntheticDrive::Options& options : {curves(60), straight}) {
    const SyntheticDrive drive(options);
    for (const double k1 : {0.0, -0.28}) {
      std::string contradiction;
      run(drive, Lens(drive.camera(), k1), true, nullptr, 0, &contradiction);
      EXPECT_EQ(contradiction.find("the motion contradicts the calibration") == 0, k1 != 0)
          << contradiction;
      EXPECT_EQ(contradiction.empty(), k1 == 0);
    }
  }
}

TEST(VoFrame, AllItsLengthsAreInOneUnit) {
  VoFrame frame;
  frame.T_w_c.translation() = Eigen::Vector3d(1, 2, 3);
  frame.pose_covariance = Matrix6d::Identity();
  frame.readout_motion << 1, 2, 3, 4, 5, 6;
  TrackedFeature feature;
  feature.p_c = Eigen::Vector3f(1, 2, 3);
  feature.depth_sigma = 0.5F;
  frame.features = {feature};
  scaleLengths(2, &frame);
  EXPECT_EQ(frame.T_w_c.translation(), Eigen::Vector3d(2, 4, 6));
  EXPECT_EQ(frame.pose_covariance.diagonal().sum(), 15);  // 4 * 3 of the position
  EXPECT_EQ(frame.pose_covariance.bottomRightCorner(3, 3).trace(), 3);
  EXPECT_EQ(frame.readout_motion.head<3>(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(frame.readout_motion.tail<3>(), Eigen::Vector3d(8, 10, 12));
  EXPECT_EQ(frame.features[0].p_c, Eigen::Vector3f(2, 4, 6));
  EXPECT_EQ(frame.features[0].depth_sigma, 1.0F);
}

TEST_F(SelfCalibration, AMapAfterTheChangeOfTheLensStartsAnew) {
  const SyntheticDrive drive(curves(130));
  const Distortion distortion(drive.camera(), Lens{drive.camera(), 0.05, -0.01});
  MetricOdometry odometry(drive.camera(), optionsFor(drive.cameraHeight()));
  std::int64_t stamp_ns = 0;
  const auto process = [&](const cv::Mat& image) {
    stamp_ns += 100000000;
    return odometry.process(image, stamp_ns).vo.frame;
  };
  for (std::size_t i = 0; i < drive.size(); ++i) process(distortion.image(drive.image(i)));
  ASSERT_TRUE(odometry.lens().isEstimate());
  for (int i = 0; i < 15; ++i) process(cv::Mat::zeros(drive.image(0).size(), CV_8U));
  const std::int64_t black_ns = stamp_ns;
  int tracked = 0;
  for (std::size_t i = 0; i < 20; ++i) {
    const VoFrame frame = process(distortion.image(drive.image(i)));
    if (frame.status != VoStatus::kTracking) continue;
    EXPECT_GT(frame.map_start.stamp_ns, black_ns);
    ++tracked;
    EXPECT_LT(frame.T_w_c.translation().norm(), 30) << "not in its own frame";
  }
  EXPECT_GT(tracked, 10);
}

TEST_F(SelfCalibration, RefinesAnEstimatedLensFurther) {
  const SyntheticDrive drive(curves(130));
  LensEstimate refined;
  run(drive, Lens{drive.camera(), 0.03, -0.006}, true, &refined, 0.006);
  EXPECT_NEAR(refined.lens.k1, 0.03, 0.01);
  EXPECT_LT(refined.lens.camera.k1_sigma, 0.006);
  // A lens that was estimated from more drives holds against this one.
  LensEstimate held;
  run(drive, Lens{drive.camera(), 0.03, -0.006}, true, &held, 0.0005);
  EXPECT_LT(std::abs(held.lens.k1), 0.01);
}

// What is left after another model, in the pixels of the images as they come.
TEST_F(SelfCalibration, RefinesAFisheye) {
  const SyntheticDrive drive(curves(130));
  CameraCalibration fisheye = withoutDistortion(drive.camera());
  // Nearly tan(theta): its images show what those of the drive show.
  fisheye.setDistortion("equidistant", {0.32, 0.14, 0.03, 0});
  LensVector left = LensVector::Zero();
  left[3] = 0.05;
  left[4] = -0.01;
  const Lens lens = boxplus(lensOf(fisheye), left);
  const Distortion distortion(drive.camera(), lens);
  MetricOdometry odometry(fisheye, optionsFor(drive.cameraHeight()));
  for (std::size_t i = 0; i < drive.size(); ++i) {
    odometry.process(distortion.image(drive.image(i)), drive.frame(i).stamp_ns);
  }
  ASSERT_TRUE(odometry.lens().isEstimate());
  const Lens saved = lensOf(calibrationOf(odometry.lens().lens));
  const Eigen::Vector2d x(0.7, 0.15);
  EXPECT_LT((saved.project(x) - lens.project(x)).norm(),
            0.4 * (lensOf(fisheye).project(x) - lens.project(x)).norm());
}

// The second odometry, which has the better lens, is prepared when the zoom ends its map.
TEST_F(SelfCalibration, AZoomEndsThePreparationOfAnotherLens) {
  constexpr std::size_t kZoomed = 10, kPrepared = 4;  // images
  const SyntheticDrive drive(curves(130));
  const Distortion distortion(drive.camera(), Lens{drive.camera(), 0.05, -0.01});
  const CameraCalibration camera = withoutDistortion(drive.camera());
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) images.push_back(distortion.image(drive.image(i)));
  std::vector<std::size_t> changes;  // the images from which on another lens is used
  std::vector<double> zooms;
  const auto run = [&] {
    changes.clear();
    zooms.clear();
    SelfCalibratingOdometry odometry(camera, optionsFor(drive.cameraHeight()).odometry);
    for (std::size_t i = 0; i < images.size(); ++i) {
      const VoFrame frame = odometry.process(images[i], drive.frame(i).stamp_ns).frame;
      if (frame.continuity == Continuity::kOtherLens) changes.push_back(i);
      zooms.push_back(frame.zoom);
    }
  };
  run();
  ASSERT_FALSE(changes.empty());
  const std::size_t first = changes.front() - kPrepared;
  for (std::size_t i = first; i < first + kZoomed; ++i) {
    images[i] = zoomed(images[i], drive.camera(), 1.2);
  }
  run();
  EXPECT_NEAR(zooms[first], 1.2, 0.02);
  EXPECT_EQ(zooms.back(), 1);
  ASSERT_FALSE(changes.empty());
  EXPECT_GE(changes.front(), first + kZoomed);

  for (std::size_t i = first + kZoomed; i < images.size(); ++i) {
    images[i] = zoomed(images[i], drive.camera(), 1.2);
  }
  run();
  EXPECT_TRUE(changes.empty()) << "the lens of a zoomed camera";
}

// Of two runs with the same images, which differ in their tracks.
TEST_F(SelfCalibration, TheScatterOfItsRunsIsInTheCovariance) {
  const SyntheticDrive drive(curves(60));
  const Distortion distortion(drive.camera(), Lens{drive.camera(), 0.05, -0.01});
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) images.push_back(distortion.image(drive.image(i)));
  const RepeatableDrive repeatable = [&](const ImageVisitor& visit) {
    for (std::size_t i = 0; i < drive.size(); ++i) visit(images[i], drive.frame(i).stamp_ns);
  };
  LensCalibration::Options options;
  options.max_runs = 3;  // the first one has another lens
  options.converged_sigmas = 0;
  const auto result = LensCalibration(options).calibrate({repeatable}, Lens{drive.camera()});
  ASSERT_EQ(result.status, LensEstimator::Status::kOk);
  ASSERT_EQ(result.runs, 3);
  const LensEstimate& last = result.drives.back().estimate;
  const LensVector from_mean = boxminus(last.lens, result.estimate.lens);
  EXPECT_GT(from_mean.norm(), 0);
  const LensMatrix scatter = result.estimate.covariance - last.covariance;
  const LensMatrix expected = 2 * from_mean * from_mean.transpose();
  EXPECT_LT((scatter - expected).norm(), 1e-6 * expected.norm());
}

TEST_F(SelfCalibration, KeepsAnExactLens) {
  const SyntheticDrive drive(curves(90));
  const auto fixed = run(drive, Lens{drive.camera()}, false);
  const auto refined = run(drive, Lens{drive.camera()}, true);
  EXPECT_EQ(refined.back().pose()->T_o_c.matrix(), fixed.back().pose()->T_o_c.matrix());
}

}  // namespace
}  // namespace gsv
