#include "ground_scale_vo/lens/lens_estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
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
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  for (int i = 0; i < kFrames; ++i) {
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
    const int turning = i - drive.straight;  // to the left for 20 frames, later to the right
    const double turn = turning < 0 ? 0 : turning < 20 ? 1 : turning >= 25 && turning < 45 ? -1 : 0;
    T_w_c.rotate(Eigen::AngleAxisd(turn * drive.turn, Eigen::Vector3d::UnitY()));
    T_w_c.translate(drive.step * Eigen::Vector3d::UnitZ());
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

/// kCamera with other parameters.
Lens lensWith(double focal, double x, double y, double k1, double k2) {
  return boxplus(Lens{kCamera}, (LensVector() << focal, x, y, k1, k2).finished());
}

LensEstimator::Result estimate(const Drive& drive, const LensEstimator::Options& options = {},
                               const Lens& calibration = Lens{kCamera}) {
  LensEstimator estimator(options);
  feed(drive, &estimator);
  return estimator.estimate(estimator.priorOf(calibration));
}

/// Normalised estimation error squared per parameter.
double nees(const LensEstimate& estimate, const Lens& truth) {
  return estimate.significance(truth) / kLensParameters;
}

void expectRecovered(const LensEstimator::Result& result, const Lens& truth) {
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  const LensVector e = boxminus(result.estimate.lens, truth), sigmas = result.estimate.sigmas();
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
  expectRecovered(estimate(drive, {}, lensOf(GetParam())), drive.lens);
}

TEST(LensEstimator, FindsAPlantedLens) {
  for (const double sign : {-1.0, 1.0}) {
    Drive drive;
    drive.lens = lensWith(sign * 0.015, 6, -5, sign * 0.03, sign * -0.01);
    const auto result = estimate(drive, widePrior());
    expectRecovered(result, drive.lens);
    EXPECT_LT(result.rms_after_px, 0.35);
    EXPECT_GT(result.rms_before_px, 1.05 * result.rms_after_px);
  }
}

TEST(LensEstimator, KeepsAnExactLensWithFewTracksInEachCellOrWithAllAlsoOfMovingObjects) {
  LensEstimator::Options all_tracks;
  all_tracks.tracks_per_cell = 1000;
  Drive traffic;
  traffic.moving_share = 0.15;
  expectRecovered(estimate(traffic, all_tracks), Lens{kCamera});
  const auto few = estimate({}), every = estimate({}, all_tracks);
  expectRecovered(few, Lens{kCamera});
  EXPECT_LT(few.model_error_px, 0.05);
  // The field of residuals has a cell for each part of the image.
  ASSERT_EQ(few.field.size(), 96u);
  int observations = 0;
  for (const auto& cell : few.field) observations += cell.observations;
  EXPECT_GT(observations, 1000);
  EXPECT_LT(10 * few.tracks, 7 * every.tracks);
  // The difference agrees with the covariances: the few are a part of all.
  EXPECT_LT(few.estimate.significance(every.estimate.lens), 15);
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
    EXPECT_EQ(boxminus(result.estimate.lens, Lens{kCamera}), LensVector::Zero());  // of the prior
  }
  EXPECT_EQ(LensEstimator({}).estimate({Lens{kCamera}, LensMatrix::Identity()}).status,
            Status::kTooFew);
}

// Wrong by three standard deviations of the principal point; its distortion is unknown.
TEST(LensEstimator, OutweighsAWrongPrior) {
  expectRecovered(estimate({}, {}, lensWith(0, 9, 0, 0.05, 0)), Lens{kCamera});
}

TEST(LensEstimate, ContradictsACalibrationThatNobodyPublishes) {
  const PinholeCamera camera{640, 480, 400, 400, 320, 240};
  LensEstimate prior{Lens{camera}, LensMatrix::Identity()};
  prior.covariance(0, 0) = 0.003 * 0.003;
  LensVector variances;
  variances << 1e-6, 9, 16, 1e-4, 2e-4;
  constexpr double r2 = 0.64;  // at the border of the image
  const struct Case {
    double focal_length, k1, k2, covariance_factor;
    const char* contradicted;
  } kCases[] = {{400, 0, 0, 1, ""},
                {400, -0.09, 0, 1, ""},
                {400, -0.28, 0, 1, "its radial distortion"},
                {400, -0.28, 0.28 / r2, 1, ""},  // k1 and k2 compensate each other
                {400, -0.28, 0, 100, ""},        // it is not significant
                {396, -0.28, 0, 100, ""},
                {390, -0.28, 0, 100, "its focal length"},
                {390, -0.28, 0, 0, ""}};  // no estimate
  for (const Case& each : kCases) {
    LensEstimate estimate{Lens{camera, each.k1, each.k2},
                          each.covariance_factor * LensMatrix(variances.asDiagonal())};
    estimate.lens.camera.fx = estimate.lens.camera.fy = each.focal_length;
    const std::string text = estimate.contradiction(prior);
    EXPECT_EQ(text.substr(0, std::strlen(each.contradicted)), each.contradicted) << text;
    EXPECT_EQ(text.empty(), *each.contradicted == '\0') << text;
  }
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
      sum += nees(result.estimate, drive.lens);
    }
    EXPECT_GT(sum / kDrives, 0.8) << field_px;
    EXPECT_LT(sum / kDrives, 1.3) << field_px;
  }
}

TEST(LensEstimator, AccumulatesDrives) {
  const Lens truth = lensWith(0.01, 4, -4, 0.02, -0.005);
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
  EXPECT_LT(nees(estimate, truth), 3);
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
    feed(drive, [&](VoFrame frame) {
      if (run == 1 && frames == 0) frame.continuity = Continuity::kOtherLens;
      ++frames;
      if (changes.size() > static_cast<std::size_t>(run)) return;
      const auto better = refinement.add(frame, Lens{kCamera});
      if (!better) return;
      changes.push_back(frames);
      estimates.push_back(*better);
    });
    ASSERT_EQ(changes.size(), run + 1u);
  }
  EXPECT_GT(changes[0], 48);
  EXPECT_EQ(changes[1], changes[0]);
  EXPECT_EQ(boxminus(estimates[1].lens, estimates[0].lens), LensVector::Zero());
}

}  // namespace
}  // namespace gsv
