#include "simulation/synthetic_drive.hpp"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "simulation/scenarios.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Options = SyntheticDrive::Options;
using Frame = SyntheticDrive::Frame;

/// Where the road pixel u of frame a is seen in frame b.
Eigen::Vector2d warp(const PinholeCamera& camera, const Frame& a, const Frame& b,
                     const Eigen::Vector2d& u) {
  const Eigen::Vector3d ray = camera.ray(u);
  const Eigen::Vector3d p_a = -a.height / a.n_c.dot(ray) * ray;  // n.x + height = 0
  return camera.project(b.T_c0_c.inverse() * a.T_c0_c * p_a);
}

double quantile(std::vector<double> values, double q) {
  const auto k = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}

/// The part of the image that shows the lane 6 to 12 m ahead, without other vehicles.
cv::Rect laneAhead(const PinholeCamera& camera) {
  return {camera.width * 2 / 5, camera.height * 31 / 40, camera.width / 5, camera.height / 5};
}

// Poses, normals and heights are consistent: the translation along the normal is the change of
// height, up to the curvature of the road, and to ramps and bumps, which the axles climb one after
// the other.
TEST(SyntheticDrive, HeightAndNormalAgreeWithThePoses) {
  for (const Scenario& scenario : allScenarios()) {
    SCOPED_TRACE(scenario.name);
    const Options& o = scenario.options;
    const SyntheticDrive drive(o);
    EXPECT_TRUE(drive.frame(0).T_c0_c.matrix().isIdentity(0));
    const bool has_edges = o.ramp_slope != 0 || o.bump_height != 0;
    for (std::size_t i = 0; i + 1 < drive.size(); ++i) {
      const Frame &a = drive.frame(i), &b = drive.frame(i + 1);
      const Eigen::Isometry3d T_a_b = a.T_c0_c.inverse() * b.T_c0_c;
      const double change_of_normal = (T_a_b.linear() * b.n_c - a.n_c).norm();
      // For a constant vertical curvature the factor of the second term would be 0.5.
      const double tolerance = has_edges
                                   ? std::max(0.025, 0.31 * o.bump_height)
                                   : 1e-3 + 0.6 * change_of_normal * T_a_b.translation().norm();
      EXPECT_NEAR(a.n_c.norm(), 1, 1e-12);
      EXPECT_LT(a.n_c.y(), 0);  // up
      EXPECT_NEAR(a.height, o.camera_height, 0.05);
      EXPECT_NEAR(a.height + a.n_c.dot(T_a_b.translation()), b.height, tolerance) << i;
    }
  }
}

TEST(SyntheticDrive, ASeedOfTheNoiseChangesNothingElse) {
  Options o;
  o.frames = 1;
  const cv::Mat image = SyntheticDrive(o).image(0);
  o.noise_seed = 2;
  cv::Mat difference, mean, deviation;
  cv::subtract(SyntheticDrive(o).image(0), image, difference, cv::noArray(), CV_32F);
  cv::meanStdDev(difference, mean, deviation);
  EXPECT_NEAR(mean.at<double>(0), 0, 0.02);
  EXPECT_NEAR(deviation.at<double>(0), std::sqrt(2 * o.noise_sigma * o.noise_sigma + 2 / 12.0),
              0.2);
}

TEST(SyntheticDrive, YawTurnsTheCameraOnTheSameVehicle) {
  Options options;
  options.frames = 40;
  options.pitch_rad = 0;
  const SyntheticDrive forward(options);
  options.yaw_rad = 0.5 * M_PI;
  const SyntheticDrive left(options);
  Eigen::Matrix3d R_forward_left;  // looks to the left: x ahead, z to the left
  R_forward_left << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    EXPECT_LT((R_forward_left * left.frame(i).n_c - forward.frame(i).n_c).norm(), 1e-4);
    EXPECT_LT((R_forward_left * left.frame(i).T_c0_c.translation() -
               forward.frame(i).T_c0_c.translation())
                  .norm(),
              2e-3 * (1 + forward.frame(i).T_c0_c.translation().norm()));
  }
  EXPECT_GT(left.frame(39).T_c0_c.translation().x(), 10);
}

/// A frame of a drive, and the largest allowed distance between corners of its road and their
/// prediction from the plane below the camera.
struct Place {
  std::size_t frame;
  double slope;                    ///< Options::slope
  double median_px;                ///< median distance
  double bias_px;                  ///< median offset in y
  const char* scenario = nullptr;  ///< nullptr: the default drive
  bool recorded = false;           ///< along a recorded path: a left turn uphill
};

/// Positions 0.8 m apart: 40 m straight on, then a left turn with a radius of 20 m.
std::vector<Eigen::Vector3d> leftTurn(int frames, double slope) {
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < frames; ++i) {
    const double s = 0.8 * i, angle = std::max(s - 40, 0.0) / 20;
    positions.emplace_back(-20 * (1 - std::cos(angle)), -slope * s,
                           std::min(s, 40.0) + 20 * std::sin(angle));
  }
  return positions;
}

/// Frame i, warped into frame i + 1 by the homography of the true road plane.
class SyntheticRoad : public testing::TestWithParam<Place> {
 protected:
  void SetUp() override {
    Options options = GetParam().scenario ? findScenario(GetParam().scenario).options : Options();
    options.slope = GetParam().slope;
    options.moving_cars = false;
    if (GetParam().recorded) options.path = leftTurn(options.frames, GetParam().slope);
    const SyntheticDrive drive(options);
    const std::size_t i = GetParam().frame;
    const cv::Mat before = drive.image(i);
    after_ = drive.image(i + 1);
    lane_ = laneAhead(drive.camera());
    cv::Mat map(after_.size(), CV_32FC2, cv::Scalar(-9, -9));
    for (int y = lane_.y - 20; y < after_.rows; ++y) {
      for (int x = 0; x < after_.cols; ++x) {
        const Eigen::Vector2d u = warp(drive.camera(), drive.frame(i + 1), drive.frame(i), {x, y});
        map.at<cv::Vec2f>(y, x) = {static_cast<float>(u.x()), static_cast<float>(u.y())};
      }
    }
    cv::remap(before, aligned_, map, cv::noArray(), cv::INTER_CUBIC);
  }
  cv::Mat after_, aligned_;
  cv::Rect lane_;
};

TEST_P(SyntheticRoad, PixelsAndCornersMoveWithTheRoadPlane) {
  cv::Mat difference, smooth, texture;
  cv::absdiff(aligned_(lane_), after_(lane_), difference);
  cv::GaussianBlur(after_(lane_), smooth, {}, 4);
  cv::absdiff(after_(lane_), smooth, texture);
  EXPECT_GT(cv::mean(texture)[0], 3);  // the lane is textured [grey levels]
  EXPECT_LT(cv::mean(difference)[0], 4);
  EXPECT_LT(cv::mean(difference)[0], 0.7 * cv::mean(texture)[0]);

  cv::Mat mask = cv::Mat::zeros(after_.size(), CV_8U);
  mask(lane_) = 255;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(after_, corners, 150, 0.02, 5, mask);
  ASSERT_GT(corners.size(), 40u);
  std::vector<cv::Point2f> tracked = corners;
  std::vector<uchar> found;
  cv::calcOpticalFlowPyrLK(after_, aligned_, corners, tracked, found, cv::noArray(), {11, 11}, 0,
                           {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.001},
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<double> errors, x, y;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    if (!found[k]) continue;
    const cv::Point2f off = tracked[k] - corners[k];
    errors.push_back(std::hypot(off.x, off.y));
    x.push_back(off.x);
    y.push_back(off.y);
  }
  ASSERT_GT(errors.size(), 40u);
  EXPECT_LT(quantile(errors, 0.5), GetParam().median_px);
  EXPECT_LT(quantile(errors, 0.95), 0.7);
  EXPECT_LT(std::abs(quantile(x, 0.5)), 0.06);
  EXPECT_LT(std::abs(quantile(y, 0.5)), GetParam().bias_px);
}

INSTANTIATE_TEST_SUITE_P(StraightAndCurves, SyntheticRoad,
                         testing::Values(Place{0, 0, 0.2, 0.06}, Place{35, 0, 0.2, 0.06}));
// On slopes the road ten metres ahead is some centimetres off the plane below the camera.
INSTANTIATE_TEST_SUITE_P(Slope, SyntheticRoad, testing::Values(Place{150, 0.025, 0.5, 0.4}));
// Extreme mountings, ramps and curves: the plane below still describes the lane ahead.
INSTANTIATE_TEST_SUITE_P(Scenarios, SyntheticRoad,
                         testing::Values(Place{20, 0, 0.2, 0.06, "rolled"},
                                         Place{20, 0, 0.2, 0.06, "pitched"},
                                         Place{20, 0, 0.2, 0.06, "camera_low"},
                                         Place{60, 0, 0.2, 0.06, "tight_bends"},
                                         Place{33, 0, 0.2, 0.15, "slope_edges"}));
INSTANTIATE_TEST_SUITE_P(RecordedPath, SyntheticRoad,
                         testing::Values(Place{70, 0.06, 0.3, 0.25, nullptr, true}));

TEST(ImageFaults, ActInTheirFramesOfADrive) {
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && a.type() == b.type() && cv::countNonZero(a != b) == 0;
  };
  Options options;
  options.camera = {160, 50, 93, 93, 80, 25};
  options.frames = 8;
  const SyntheticDrive faultless(options);
  options.faults = {{FaultKind::kBlack, {2, 3}}, {FaultKind::kFrozen, {5, 6}}};
  const SyntheticDrive drive(options);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (i == 2 || i == 3) {
      EXPECT_EQ(cv::countNonZero(drive.image(i)), 0) << i;
    } else {
      EXPECT_TRUE(same(drive.image(i), faultless.image(i == 5 || i == 6 ? 4 : i))) << i;
    }
  }
}

/// Mean absolute difference of one row [grey levels].
double rowDifference(const cv::Mat& a, const cv::Mat& b, int row) {
  return cv::norm(a.row(row), b.row(row), cv::NORM_L1) / a.cols;
}

TEST(RollingShutter, ExposesEachRowAtItsOwnTime) {
  constexpr double kReadoutTime = 0.03;
  Options options;
  options.frames = 3;
  options.speed = 20;
  options.suspension = 2;
  options.stop_s = options.noise_sigma = 0;
  options.readout_time = kReadoutTime;
  const SyntheticDrive rolling(options);
  options.readout_time = 0;
  options.frame_rate_hz = 1000;
  options.frames = 201;  // the same road: its texture depends on its length
  const SyntheticDrive every_ms(options);
  constexpr std::size_t kStamp = 100;  // of the second image [ms]
  const cv::Mat image = rolling.image(1), at_stamp = every_ms.image(kStamp);
  const int height = rolling.camera().height;
  for (const int delay_ms : {-12, -6, 0, 6, 12}) {
    const int row = static_cast<int>(height * (0.5 + 1e-3 * delay_ms / kReadoutTime));
    const cv::Mat exposed = every_ms.image(kStamp + static_cast<std::size_t>(delay_ms));
    const double difference = rowDifference(image, exposed, row);
    EXPECT_LT(difference, 1) << delay_ms;
    if (delay_ms != 0) {
      EXPECT_GT(rowDifference(image, at_stamp, row), 3 * difference) << delay_ms;
    }
  }
}

}  // namespace
}  // namespace gsv
