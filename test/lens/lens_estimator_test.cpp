#include "ground_scale_vo/lens/lens_estimator.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/lens/lens_refinement.hpp"
#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

using Status = LensEstimator::Status;

constexpr int kFrames = 60;
constexpr double kNoise_px = 0.2;

const PinholeCamera kCamera{1241, 376, 718.9, 718.9, 607.2, 185.2};

/// A camera that drives along a street with a turn to the left and one to the right.
struct Drive {
  Lens lens{kCamera};       ///< of the images
  double step = 1;          ///< [m] per frame
  int straight = 10;        ///< frames before the first turn
  double turn = 0.045;      ///< largest change of the heading per frame [rad]
  double moving_share = 0;  ///< of the points, on vehicles that drive ahead
  double noise_px = kNoise_px;
  double field_px = 0;  ///< amplitude of displacements that no lens of the model has
  unsigned seed = 1;
};

Eigen::Isometry3d poseOf(const Drive& drive, int frame) {
  double x = 0, z = 0, heading = 0;
  for (int i = 0; i < frame; ++i) {
    if (i >= drive.straight && i < drive.straight + 20) heading += drive.turn;
    if (i >= drive.straight + 25 && i < drive.straight + 45) heading -= drive.turn;
    x += drive.step * std::sin(heading);
    z += drive.step * std::cos(heading);
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitY()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(x, 0, z);
  return T;
}

/// The tracks that an odometry without errors of the poses would give, a frame after the other.
void feed(const Drive& drive, const std::function<void(const VoFrame& frame)>& add) {
  std::mt19937 random(drive.seed);
  std::normal_distribution<double> noise(0, drive.noise_px);
  const PinholeCamera& camera = drive.lens.camera;
  const double phase = std::uniform_real_distribution<double>(0, 2 * M_PI)(random);
  const auto field = [&](const Eigen::Vector2d& at) {
    const double x = 2 * M_PI * at.x() / camera.width, y = 2 * M_PI * at.y() / camera.height;
    return Eigen::Vector2d(drive.field_px * std::sin(x + 0.5 * y + phase),
                           drive.field_px * std::cos(0.5 * x - 0.5 * y + phase));
  };
  std::uniform_real_distribution<double> u(0, camera.width - 1), v(0, camera.height - 1),
      depth(5, 40), share(0, 1);
  struct Point {
    std::uint64_t id;
    Eigen::Vector3d p_w, velocity;
    int last_frame;
  };
  std::vector<Point> points;
  std::uint64_t next_id = 1;
  for (int i = 0; i < kFrames; ++i) {
    const Eigen::Isometry3d T_w_c = poseOf(drive, i);
    VoFrame frame;
    frame.status = VoStatus::kTracking;
    frame.camera = camera;
    frame.T_w_c = T_w_c;
    while (points.size() < 150) {
      const double d = depth(random);
      const Eigen::Vector2d x = drive.lens.unproject({u(random), v(random)});
      const bool moves = share(random) < drive.moving_share;
      const Eigen::Vector3d velocity =
          moves ? Eigen::Vector3d(T_w_c.linear() * Eigen::Vector3d(0.1, 0, 0.7))
                : Eigen::Vector3d(0, 0, 0);
      points.push_back({next_id++, T_w_c * (d * x.homogeneous()), velocity, i + 12});
    }
    std::vector<Point> visible;
    for (Point& point : points) {
      const Eigen::Vector3d p_c = T_w_c.inverse() * point.p_w;
      point.p_w += point.velocity;
      if (p_c.z() < 2 || i > point.last_frame) continue;
      Eigen::Vector2d pixel = drive.lens.project(p_c.hnormalized());
      pixel += field(pixel) + Eigen::Vector2d(noise(random), noise(random));
      if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > camera.width - 1 ||
          pixel.y() > camera.height - 1) {
        continue;
      }
      TrackedFeature feature;
      feature.id = point.id;
      feature.u = pixel.cast<float>();
      frame.features.push_back(feature);
      visible.push_back(point);
    }
    points = visible;
    if (i == 0) frame.continuity = Continuity::kNewTrajectory;
    add(frame);
  }
}

void feed(const Drive& drive, LensEstimator* estimator) {
  feed(drive, [=](const VoFrame& frame) { estimator->add(frame); });
}

LensEstimator::Options widePrior() {
  LensEstimator::Options options;
  options.prior_focal_sigma = 0.02;
  options.prior_centre_sigma_px = 10;
  return options;
}

LensEstimator::Options allTracks() {
  LensEstimator::Options options;
  options.tracks_per_cell = 1000;
  return options;
}

LensEstimator::Result estimate(const Drive& drive, const LensEstimator::Options& options = {},
                               const Lens& calibration = Lens{kCamera}) {
  LensEstimator estimator(options);
  feed(drive, &estimator);
  return estimator.estimate(estimator.priorOf(calibration));
}

LensVector error(const LensEstimator::Result& result, const Lens& truth) {
  return boxminus(result.estimate.lens, truth);
}

/// Normalised estimation error squared per parameter.
double nees(const LensVector& e, const LensMatrix& covariance) {
  return e.dot(covariance.ldlt().solve(e)) / kLensParameters;
}

void expectRecovered(const LensEstimator::Result& result, const Lens& truth) {
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  const LensVector e = error(result, truth), sigmas = result.estimate.sigmas();
  EXPECT_NEAR(e[0], 0, 0.002);
  EXPECT_NEAR(e[1], 0, 1.5);
  EXPECT_NEAR(e[2], 0, 1.5);
  EXPECT_NEAR(e[3], 0, 0.003);
  for (int i = 0; i < kLensParameters; ++i) EXPECT_LT(std::abs(e[i]), 2.5 * sigmas[i]) << i;
}

TEST(Lens, ProjectsAsOpenCvAndInverts) {
  const Lens lens{kCamera, -0.3, 0.1, -0.01, 0.001, -0.002};
  const Eigen::Vector2d x(0.5, -0.2), d = lens.distort(x);
  const double r2 = 0.29, radial = 1 - 0.3 * r2 + 0.1 * r2 * r2 - 0.01 * r2 * r2 * r2;
  EXPECT_NEAR(d.x(), radial * 0.5 + 2 * 0.001 * 0.5 * -0.2 - 0.002 * (r2 + 2 * 0.25), 1e-12);
  EXPECT_NEAR(d.y(), radial * -0.2 + 0.001 * (r2 + 2 * 0.04) + 2 * -0.002 * 0.5 * -0.2, 1e-12);
  EXPECT_LT((lens.unproject(lens.project(x)) - x).norm(), 1e-10);
  Eigen::Matrix2d jacobian;
  lens.distort(x, &jacobian);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d h = 1e-6 * Eigen::Vector2d::Unit(i);
    const Eigen::Vector2d numeric = (lens.distort(x + h) - lens.distort(x - h)) / 2e-6;
    EXPECT_LT((numeric - jacobian.col(i)).norm(), 1e-8);
  }
}

CameraCalibration calibrationWith(const std::string& model, const std::vector<double>& d) {
  CameraCalibration calibration{752, 480, 420, 425, 380, 235};
  calibration.setDistortion(model, d);
  return calibration;
}

const LensVector kLeft = (LensVector() << -0.003, -1, 1.5, 0.021, -0.007).finished();

class LensOfModel : public TemporaryFolder,
                    public testing::WithParamInterface<CameraCalibration> {};
INSTANTIATE_TEST_SUITE_P(
    All, LensOfModel,
    testing::Values(
        calibrationWith("", {}), calibrationWith("plumb_bob", {-0.28, 0.07, 1e-3, -2e-4}),
        calibrationWith("rational_polynomial", {0.4, 0.2, 1e-4, -2e-4, 0.05, 0.7, 0.3, 0.09}),
        calibrationWith("rational_polynomial", {0.4, 0.2, 1e-4, -2e-4, 0.05, 0.7, 0.3, 0.09, 1e-3,
                                                -1e-3, 2e-3, 0, 0.01, 0.02}),
        calibrationWith("equidistant", {-0.02, 0.015, -0.012, 0.002})));

// What the calibration has left can be saved in its own model.
TEST_P(LensOfModel, IsSavedInItsOwnModel) {
  const Lens refined = boxplus(lensOf(GetParam()), kLeft);
  const CameraCalibration read =
      readCameraFile(write("camera.yaml", cameraYaml(calibrationOf(refined), "")));
  EXPECT_EQ(read.model, GetParam().model);
  const Lens saved = lensOf(read);
  double largest = 0, change = 0;
  for (int u = 0; u < read.width; u += 10) {
    for (int v = 0; v < read.height; v += 10) {
      const Eigen::Vector2d x = refined.unproject({u, v});
      largest = std::max(largest, (saved.project(x) - refined.project(x)).norm());
      change = std::max(change, (lensOf(GetParam()).project(x) - refined.project(x)).norm());
    }
  }
  EXPECT_LT(largest, 0.1);
  EXPECT_GT(change, 2);
}

TEST_P(LensOfModel, IsFoundWhateverTheModel) {
  Drive drive;
  drive.lens = boxplus(lensOf(GetParam()), kLeft);
  const auto result = estimate(drive, {}, lensOf(GetParam()));
  expectRecovered(result, drive.lens);
}

TEST(LensEstimator, FindsAPlantedLens) {
  for (const double sign : {-1.0, 1.0}) {
    Drive drive;
    LensVector planted;
    planted << sign * 0.015, 6, -5, sign * 0.03, sign * -0.01;
    drive.lens = boxplus(drive.lens, planted);
    const auto result = estimate(drive, widePrior());
    expectRecovered(result, drive.lens);
    EXPECT_LT(result.rms_after_px, 0.35);
    EXPECT_GT(result.rms_before_px, 1.05 * result.rms_after_px);
  }
}

TEST(LensEstimator, KeepsAnExactLens) {
  const auto result = estimate({});
  expectRecovered(result, Lens{kCamera});
  EXPECT_LT(result.model_error_px, 0.05);
  // The field of residuals has a cell for each part of the image.
  ASSERT_EQ(result.field.size(), 96u);
  int observations = 0;
  for (const auto& cell : result.field) observations += cell.observations;
  EXPECT_GT(observations, 1000);
}

TEST(LensEstimator, ReportsAnUnobservableLens) {
  Drive still, rotation, straight;
  still.step = still.turn = 0;
  rotation.step = 0;
  straight.turn = 0;
  EXPECT_EQ(estimate(still).status, Status::kTooFew);
  for (const Drive& drive : {rotation, straight}) {
    const auto result = estimate(drive);
    EXPECT_EQ(result.status, Status::kUnobservable) << result.reason;
    EXPECT_FALSE(result.reason.empty());
    EXPECT_EQ(result.reason.find("degrees more") != std::string::npos, drive.step > 0);
    EXPECT_EQ(error(result, Lens{kCamera}), LensVector::Zero());  // the prior stays
  }
  EXPECT_EQ(LensEstimator({}).estimate({Lens{kCamera}, LensMatrix::Identity()}).status,
            Status::kTooFew);
}

TEST(LensEstimator, RejectsMovingObjects) {
  Drive drive;
  drive.moving_share = 0.15;
  expectRecovered(estimate(drive, allTracks()), drive.lens);
}

TEST(LensEstimator, OutweighsAWrongPrior) {
  // Three standard deviations of the principal point; its distortion is unknown.
  LensVector wrong;
  wrong << 0, 9, 0, 0.05, 0;
  expectRecovered(estimate({}, {}, boxplus(Lens{kCamera}, wrong)), Lens{kCamera});
}

TEST(LensEstimate, ContradictsACalibrationThatNobodyPublishes) {
  const Lens given(PinholeCamera{640, 480, 400, 400, 320, 240});
  LensEstimate prior{given, LensMatrix::Identity()};
  prior.covariance(0, 0) = 0.003 * 0.003;
  const double r2 = 0.64;  // at the border of the image
  LensVector variances;
  variances << 1e-6, 9, 16, 1e-4, 2e-4;
  LensEstimate estimate{given, variances.asDiagonal()};
  EXPECT_EQ(estimate.contradiction(prior), "");
  estimate.lens.k1 = -0.09;
  EXPECT_EQ(estimate.contradiction(prior), "");
  estimate.lens.k1 = -0.28;
  EXPECT_EQ(estimate.contradiction(prior).find("its radial distortion"), 0u);
  estimate.lens.k2 = 0.28 / r2;  // k1 and k2 compensate each other
  EXPECT_EQ(estimate.contradiction(prior), "");
  estimate.lens.k2 = 0;
  estimate.covariance *= 100;  // it is not significant
  EXPECT_EQ(estimate.contradiction(prior), "");
  estimate.lens.camera.fx = estimate.lens.camera.fy = 396;
  EXPECT_EQ(estimate.contradiction(prior), "");
  estimate.lens.camera.fx = estimate.lens.camera.fy = 390;
  EXPECT_EQ(estimate.contradiction(prior).find("its focal length"), 0u);
  EXPECT_EQ(LensEstimate{estimate.lens}.contradiction(prior), "");
}

TEST(LensEstimator, HasATrueCovariance) {
  constexpr int kDrives = 20;
  for (const double field_px : {0.0, 0.1}) {
    double sum = 0;
    for (unsigned seed = 1; seed <= kDrives; ++seed) {
      Drive drive;
      drive.seed = seed;
      drive.field_px = field_px;
      const auto result = estimate(drive, widePrior());
      ASSERT_EQ(result.status, Status::kOk);
      sum += result.estimate.significance(drive.lens) / kLensParameters;
    }
    EXPECT_GT(sum / kDrives, 0.8) << field_px;
    EXPECT_LT(sum / kDrives, 1.3) << field_px;
  }
}

TEST(LensEstimator, UsesFewTracksInEachCell) {
  const auto every = estimate({}, allTracks()), few = estimate({});
  EXPECT_LT(10 * few.tracks, 7 * every.tracks);
  // The difference agrees with the covariances: the few are a part of all.
  EXPECT_LT(few.estimate.significance(every.estimate.lens), 15);
  expectRecovered(few, Lens{kCamera});
}

TEST(LensEstimator, AccumulatesDrives) {
  LensVector planted;
  planted << 0.01, 4, -4, 0.02, -0.005;
  const Lens truth = boxplus(Lens{kCamera}, planted);
  LensEstimate estimate = LensEstimator(widePrior()).priorOf(Lens{kCamera});
  LensVector sigmas = estimate.sigmas();
  for (unsigned seed = 1; seed <= 2; ++seed) {
    Drive drive;
    drive.lens = truth;
    drive.seed = seed;
    LensEstimator estimator({});
    feed(drive, &estimator);
    const auto result = estimator.estimate(estimate);
    ASSERT_EQ(result.status, Status::kOk) << result.reason;
    estimate = result.estimate;
    EXPECT_TRUE((estimate.sigmas().array() < 0.85 * sigmas.array()).all());
    sigmas = estimate.sigmas();
  }
  EXPECT_LT(nees(boxminus(estimate.lens, truth), estimate.covariance), 3);
}

TEST(LensEstimator, SeparatesMapsAndRefusesWrongOptions) {
  LensEstimator estimator({});
  feed({}, &estimator);
  Drive second;
  second.seed = 2;
  VoFrame lost;
  lost.status = VoStatus::kLost;
  estimator.add(lost);
  feed(second, &estimator);  // the same ids, other points
  const auto result = estimator.estimate(estimator.priorOf(Lens{kCamera}));
  EXPECT_EQ(result.status, Status::kOk);
  EXPECT_GT(result.keyframes, 90u);
  EXPECT_LT(result.rms_after_px, 0.35);
  LensEstimator::Options options;
  options.min_observations = 1;
  EXPECT_THROW(LensEstimator{options}, OptionError);
}

TEST(LensRefinement, StartsAnewAfterTheChangeOfTheLens) {
  Drive drive;
  drive.lens = Lens{kCamera, 0.1};
  drive.step = 1.5;
  drive.straight = 24;  // there are keyframes enough before the turn
  LensRefinement refinement(Lens{kCamera}, {});
  std::vector<int> changes;
  std::vector<LensEstimate> estimates;
  for (int run = 0; run < 2; ++run) {
    int frames = 0;
    feed(drive, [&](const VoFrame& frame) {
      ++frames;
      if (changes.size() > static_cast<std::size_t>(run)) return;
      const auto better = refinement.add(frame, Lens{kCamera});
      if (!better) return;
      changes.push_back(frames);
      estimates.push_back(*better);
    });
    ASSERT_EQ(changes.size(), run + 1u);
    refinement.restart();
  }
  EXPECT_GT(changes[0], 48);
  EXPECT_EQ(changes[1], changes[0]);
  EXPECT_EQ(boxminus(estimates[1].lens, estimates[0].lens), LensVector::Zero());
}

}  // namespace
}  // namespace gsv
