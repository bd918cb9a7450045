// camera_info: the intrinsics taken from it, the rectification by it, and what is refused.

#include "ground_scale_vo/ros/calibrated_camera.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/message_error.hpp"

namespace ground_scale_vo {
namespace {

using Info = sensor_msgs::CameraInfo;

/// 640 x 200, undistorted, the same intrinsics in K and P.
Info goodInfo() {
  PinholeCamera camera;
  camera.width = 640;
  camera.height = 200;
  camera.fx = 400;
  camera.fy = 410;
  camera.cx = 320;
  camera.cy = 100;
  return toCameraInfo(camera);
}

/// The error message; empty if the info is accepted.
std::string refusal(const Info& info, bool image_is_rectified = false) {
  try {
    CalibratedCamera(info, "/cam/info", image_is_rectified);
  } catch (const MessageError& error) {
    EXPECT_EQ(std::string(error.what()).find("camera_info on topic /cam/info "), 0u)
        << error.what();
    return error.what();
  }
  return "";
}

TEST(CalibratedCamera, UsesKUnlessItIsZero) {
  Info info = goodInfo();
  info.P[0] = 999;
  const CalibratedCamera calibrated(info, "/cam/info", false);
  EXPECT_EQ(calibrated.camera().fx, 400);
  EXPECT_EQ(calibrated.camera().fy, 410);
  EXPECT_EQ(calibrated.camera().cx, 320);
  EXPECT_EQ(calibrated.camera().cy, 100);
  EXPECT_EQ(calibrated.camera().width, 640);
  EXPECT_EQ(calibrated.camera().height, 200);
  EXPECT_FALSE(calibrated.isDistorted());
  EXPECT_TRUE(calibrated.isSameAs(CalibratedCamera(info, "/cam/info", false)));
}

TEST(CalibratedCamera, UsesPOfARectifiedCamera) {
  Info info = goodInfo();
  info.P[0] = 500;
  info.K.fill(0);
  EXPECT_EQ(CalibratedCamera(info, "/cam/info", false).camera().fx, 500);
  // KITTI's raw drives: K and D of the raw camera beside rectified images.
  info = goodInfo();
  info.P[0] = 500;
  info.D = {-0.37, 0.2, 0.001, 0.001, -0.07};
  const CalibratedCamera calibrated(info, "/cam/info", true);
  EXPECT_EQ(calibrated.camera().fx, 500);
  EXPECT_FALSE(calibrated.isDistorted());
}

TEST(CalibratedCamera, IsDescribedByItsIntrinsicsAndDistortion) {
  Info info = goodInfo();
  info.D = {-0.3, 0.1, 0, 0.02, 0.05};
  EXPECT_EQ(CalibratedCamera(info, "/t", false).describe(),
            "640 x 200, fx 400, fy 410, cx 320, cy 100, plumb_bob, D (-0.3, 0.1, 0, 0.02, 0.05)");
}

// The right camera of a stereo pair has its baseline in P, a stereo calibration has an R; neither
// changes the rays of the pixels of this camera.
TEST(CalibratedCamera, IgnoresTheStereoCalibration) {
  const CalibratedCamera alone(goodInfo(), "/t", true);
  Info info = goodInfo();
  info.P[3] = -386.1;
  info.P[7] = 2;
  EXPECT_TRUE(CalibratedCamera(info, "/t", true).isSameAs(alone));
  for (const double r : {0.0, 7.0}) {
    info.R.fill(r);
    EXPECT_TRUE(CalibratedCamera(info, "/t", true).isSameAs(alone));
    EXPECT_TRUE(
        CalibratedCamera(info, "/t", false).isSameAs(CalibratedCamera(goodInfo(), "/t", false)));
  }
}

struct Distortion {
  const char* model;
  std::vector<double> coefficients;
};

const std::vector<Distortion>& distortions() {
  static const std::vector<Distortion> all = {
      {"plumb_bob", {-0.3, 0.1, 0.01, -0.02}},
      {"plumb_bob", {-0.35, 0.15, 0.001, 0.002, -0.03}},
      {"rational_polynomial", {0.3, 0.05, 0.002, -0.001, 0.01, 0.6, 0.1, 0.02}},
      {"rational_polynomial", {0.3, 0.05, 0, 0, 0.01, 0.6, 0.1, 0.02, 0.01, -0.005, 0.02, 0.01}},
      {"rational_polynomial",
       {0.3, 0.05, 0, 0, 0.01, 0.6, 0.1, 0.02, 0.01, 0, 0.02, 0, 0.03, -0.02}},
      {"equidistant", {0, 0, 0, 0}},
      {"equidistant", {0.1, -0.05, 0.02, -0.01}},
      {"fisheye", {0.1, -0.05, 0.02, -0.01}},
      {"plumb_bob", {}},
      {"plumb_bob", {0, 0, 0, 0, 0}},
      {"", {}},
      {"", {0, 0, 0, 0, 0}},
  };
  return all;
}

/// Where the ray (x, y, 1) appears in the raw image of the full resolution, by OpenCV's projection.
cv::Point2d distorted(const Info& info, double x, double y) {
  const cv::Matx33d K(info.K.data());
  std::vector<cv::Point2d> pixels;
  if (info.distortion_model == "equidistant" || info.distortion_model == "fisheye") {
    cv::fisheye::distortPoints(std::vector<cv::Point2d>{{x, y}}, pixels, K, info.D);
  } else {
    cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}}, cv::Vec3d(), cv::Vec3d(), K, info.D,
                      pixels);
  }
  return pixels[0];
}

/// Rectifies two images whose grey value is the column and the row: a rectified pixel then holds
/// the coordinates of the raw pixel that it shows, which must be those of distorted(). scale,
/// origin: pixel of the full resolution = scale * pixel + origin (binning and ROI).
void expectRectified(const Info& info, int scale, cv::Point origin, const std::string& name) {
  const CalibratedCamera rectifier(info, "/t", false);
  const PinholeCamera& camera = rectifier.camera();
  ASSERT_LE(camera.width, 256);
  cv::Mat along_x(camera.height, camera.width, CV_8U), along_y = along_x.clone();
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      along_x.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(u);
      along_y.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(v);
    }
  }
  const cv::Mat x = rectifier.rectify(along_x), y = rectifier.rectify(along_y);
  int compared = 0;
  for (int v = 0; v < camera.height; v += 3) {
    for (int u = 0; u < camera.width; u += 3) {
      const cv::Point2d raw = distorted(info, (scale * u + origin.x - info.K[2]) / info.K[0],
                                        (scale * v + origin.y - info.K[5]) / info.K[4]);
      const cv::Point2d pixel((raw.x - origin.x) / scale, (raw.y - origin.y) / scale);
      if (pixel.x < 0 || pixel.y < 0 || pixel.x > camera.width - 1 || pixel.y > camera.height - 1) {
        continue;
      }
      ++compared;
      // Half a grey level, and the 1/32 of a pixel by which OpenCV's maps are rounded.
      ASSERT_NEAR(x.at<std::uint8_t>(v, u), pixel.x, 0.55) << name << " at " << u << ", " << v;
      ASSERT_NEAR(y.at<std::uint8_t>(v, u), pixel.y, 0.55) << name << " at " << u << ", " << v;
    }
  }
  EXPECT_GT(compared, camera.width * camera.height / 9 / 2) << name;
}

/// An image of less than 256 x 256 pixels, whose coordinates fit a grey value.
Info smallInfo(const Distortion& distortion) {
  Info info = goodInfo();
  info.width = 250;
  info.height = 120;
  info.K = {130, 0, 121, 0, 133, 63, 0, 0, 1};
  info.distortion_model = distortion.model;
  info.D = distortion.coefficients;
  return info;
}

TEST(Rectification, FollowsEveryDistortionModel) {
  for (const Distortion& distortion : distortions()) {
    expectRectified(
        smallInfo(distortion), 1, {0, 0},
        std::string(distortion.model) + " " + std::to_string(distortion.coefficients.size()));
  }
}

TEST(Rectification, AppliesRoiAndBinning) {
  for (const Distortion& distortion : distortions()) {
    Info info = smallInfo(distortion);
    info.width = 500;
    info.height = 240;
    info.K = {260, 0, 242, 0, 266, 126, 0, 0, 1};
    info.binning_x = info.binning_y = 2;
    expectRectified(info, 2, {0, 0}, "binned");
    info.roi.x_offset = 100;
    info.roi.y_offset = 40;
    info.roi.width = 301;
    info.roi.height = 160;
    EXPECT_EQ(CalibratedCamera(info, "/t", false).camera().width, 150);
    EXPECT_EQ(CalibratedCamera(info, "/t", false).camera().height, 80);
    expectRectified(info, 2, {100, 40}, "binned part");
    info.roi.width = 200;
    info.binning_x = info.binning_y = 1;
    expectRectified(info, 1, {100, 40}, "part");
  }
  // The same with P; an ROI of the whole image has no effect.
  Info info = goodInfo();
  info.roi.x_offset = 100;
  info.roi.width = 540;
  info.roi.height = 200;
  info.binning_x = 2;
  const PinholeCamera part = CalibratedCamera(info, "/t", true).camera();
  EXPECT_EQ(part.width, 270);
  EXPECT_EQ(part.height, 200);
  EXPECT_EQ(part.fx, 200);
  EXPECT_EQ(part.fy, 410);
  EXPECT_EQ(part.cx, 110);
  EXPECT_EQ(part.cy, 100);
  info = goodInfo();
  info.roi.width = 640;
  info.roi.height = 200;
  info.roi.do_rectify = true;
  EXPECT_TRUE(
      CalibratedCamera(info, "/t", false).isSameAs(CalibratedCamera(goodInfo(), "/t", false)));
}

/// 800 x 248 with this distortion.
Info wideInfo(const std::string& model, const std::vector<double>& coefficients) {
  PinholeCamera camera;
  camera.width = 800;
  camera.height = 248;
  camera.fx = camera.fy = 464;
  camera.cx = 400;
  camera.cy = 119;
  Info info = toCameraInfo(camera);
  info.distortion_model = model;
  info.D = coefficients;
  return info;
}

TEST(Rectification, WithoutDistortionIsTheImageItself) {
  const CalibratedCamera calibrated(wideInfo("plumb_bob", {0, 0, 0, 0, 0}), "/t", false);
  const cv::Mat raw(248, 800, CV_8UC1, cv::Scalar(7));
  EXPECT_EQ(calibrated.rectify(raw).data, raw.data);
}

TEST(Rectification, MovesASpotFromItsDistortedToItsPinholePixel) {
  const double k1 = -0.3;
  const CalibratedCamera calibrated(wideInfo("plumb_bob", {k1, 0, 0, 0, 0}), "/t", false);
  const PinholeCamera& camera = calibrated.camera();
  const Eigen::Vector2d x(0.4, 0.1);  // the spot in normalised, undistorted coordinates
  const Eigen::Vector2d raw_x = x * (1 + k1 * x.squaredNorm());
  cv::Mat raw(camera.height, camera.width, CV_8UC1, cv::Scalar(0));
  const Eigen::Vector2d at = camera.project(raw_x.homogeneous());
  raw.at<std::uint8_t>(static_cast<int>(std::lround(at.y())),
                       static_cast<int>(std::lround(at.x()))) = 255;
  cv::Point brightest;
  cv::minMaxLoc(calibrated.rectify(raw), nullptr, nullptr, nullptr, &brightest);
  const Eigen::Vector2d expected = camera.project(x.homogeneous());
  EXPECT_NEAR(brightest.x, expected.x(), 1.5);
  EXPECT_NEAR(brightest.y, expected.y(), 1.5);
}

TEST(Rectification, OfAFisheyeFollowsTheAngleFromTheAxis) {
  const CalibratedCamera calibrated(wideInfo("equidistant", {0, 0, 0, 0}), "/t", false);
  const PinholeCamera& camera = calibrated.camera();
  const double theta = std::atan(0.5);
  cv::Mat raw(camera.height, camera.width, CV_8UC1, cv::Scalar(0));
  raw.at<std::uint8_t>(119, static_cast<int>(std::lround(camera.cx + camera.fx * theta))) = 255;
  cv::Point brightest;
  cv::minMaxLoc(calibrated.rectify(raw), nullptr, nullptr, nullptr, &brightest);
  EXPECT_NEAR(brightest.x, camera.cx + camera.fx * 0.5, 1.5);
}

TEST(Rectification, OfAMaskWithoutDistortionIsTheMaskItself) {
  const CalibratedCamera calibrated(wideInfo("plumb_bob", {0, 0, 0, 0, 0}), "/t", false);
  const cv::Mat mask(248, 800, CV_8UC1, cv::Scalar(1));
  EXPECT_EQ(calibrated.rectifyMask(mask).data, mask.data);
  EXPECT_TRUE(calibrated.rectifyMask({}).empty());
}

// Wherever the image's content comes, even in part, from a masked pixel or from outside the image.
TEST(Rectification, OfAMaskCoversAllThatDependsOnIt) {
  for (const double k1 : {-0.3, 0.1}) {
    const CalibratedCamera calibrated(wideInfo("plumb_bob", {k1, 0, 0, 0, 0}), "/t", false);
    const cv::Rect region(550, 120, 100, 60);
    cv::Mat mask(248, 800, CV_8UC1, cv::Scalar(1)), image(248, 800, CV_8UC1, cv::Scalar(200));
    mask(region).setTo(0);
    const cv::Mat without = calibrated.rectify(image);
    image(region).setTo(0);
    const cv::Mat with = calibrated.rectify(image);
    const cv::Mat rectified = calibrated.rectifyMask(mask);
    ASSERT_EQ(rectified.size(), mask.size());
    int depending = 0, masked = 0;
    for (int v = 0; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        const bool depends = with.at<std::uint8_t>(v, u) != without.at<std::uint8_t>(v, u) ||
                             without.at<std::uint8_t>(v, u) != 200;
        depending += depends;
        masked += rectified.at<std::uint8_t>(v, u) == 0;
        ASSERT_TRUE(!depends || rectified.at<std::uint8_t>(v, u) == 0) << u << ", " << v;
      }
    }
    EXPECT_GT(depending, 3000);
    EXPECT_LT(masked, depending + 100);  // 1/255 of a masked pixel masks, 1/200 changes the image
    EXPECT_FALSE(calibrated.rectifyMask(mask.clone()).empty());
  }
}

TEST(Rectification, RefusesMasksOfAnotherSize) {
  const CalibratedCamera calibrated(wideInfo("plumb_bob", {-0.3, 0, 0, 0, 0}), "/t", false);
  EXPECT_THROW(calibrated.rectifyMask(cv::Mat(10, 10, CV_8UC1)), OptionError);
}

TEST(Rectification, RefusesImagesOfAnotherSizeOrType) {
  for (const double k1 : {0.0, -0.3}) {
    const CalibratedCamera calibrated(wideInfo("plumb_bob", {k1, 0, 0, 0, 0}), "/t", false);
    EXPECT_THROW(calibrated.rectify(cv::Mat(10, 10, CV_8UC1)), OptionError);
    EXPECT_THROW(calibrated.rectify(cv::Mat(248, 800, CV_8UC3)), OptionError);
    EXPECT_THROW(calibrated.rectify(cv::Mat()), OptionError);
  }
}

struct Refused {
  const char* name;
  std::function<void(Info*)> change;  ///< makes goodInfo() invalid
  const char* message_part;
};

TEST(CalibratedCamera, RefusesInvalidCalibrationsAndNamesTheTopic) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  constexpr auto kMaxUint32 = std::numeric_limits<std::uint32_t>::max();
  const Refused cases[] = {
      {"NaN in K", [](Info* i) { i->K[0] = kNan; }, "has numbers that are not finite"},
      {"inf in K", [](Info* i) { i->K[5] = kInf; }, "has numbers that are not finite"},
      {"NaN in P", [](Info* i) { i->P[3] = kNan; }, "has numbers that are not finite"},
      {"inf in P", [](Info* i) { i->P[0] = -kInf; }, "has numbers that are not finite"},
      {"NaN in D", [](Info* i) { i->D[1] = kNan; }, "has numbers that are not finite"},
      {"inf in D", [](Info* i) { i->D[4] = kInf; }, "has numbers that are not finite"},
      {"NaN in R", [](Info* i) { i->R[4] = kNan; }, "has numbers that are not finite"},
      {"inf in R", [](Info* i) { i->R[8] = kInf; }, "has numbers that are not finite"},
      {"no K, no P", [](Info* i) { i->K.fill(0), i->P.fill(0); },
       "is all zeros: the camera is not calibrated"},
      {"empty message", [](Info* i) { *i = Info(); }, "is all zeros: the camera is not calibrated"},
      {"negative fx", [](Info* i) { i->K[0] = -400; }, "camera fx [px] is -400"},
      {"negative fy", [](Info* i) { i->K[4] = -410; }, "camera fy [px] is -410"},
      {"zero fx", [](Info* i) { i->K[0] = 0; }, "camera fx [px] is 0"},
      {"zero fy of P", [](Info* i) { i->K.fill(0), i->P[5] = 0; }, "camera fy [px] is 0"},
      {"tiny f", [](Info* i) { i->K[0] = i->K[4] = 2; }, "fx [image widths] is 0.003125"},
      {"huge f", [](Info* i) { i->K[0] = i->K[4] = 5e5; }, "fx [image widths] is 781.25"},
      {"fx of 1e300", [](Info* i) { i->K[0] = 1e300; }, "camera fx [px] is 1e+300"},
      {"fx unlike fy", [](Info* i) { i->K[4] = 4001; }, "fy / fx is 10.0025"},
      {"cx far out", [](Info* i) { i->K[2] = 6500; }, "cx [image widths] is 10.1562"},
      {"cy far out", [](Info* i) { i->K[5] = -2100; }, "cy [image heights] is -10.5"},
      {"K transposed", [](Info* i) { i->K = {400, 0, 0, 0, 410, 0, 320, 100, 1}; },
       "K is not of the form fx 0 cx, 0 fy cy, 0 0 1"},
      {"skew", [](Info* i) { i->K[1] = 3; }, "K is not of the form"},
      {"no 1 in K", [](Info* i) { i->K[8] = 0; }, "K is not of the form"},
      {"no 1 in P", [](Info* i) { i->K.fill(0), i->P[10] = 0; }, "P is not of the form"},
      {"no width", [](Info* i) { i->width = 0; }, "camera width [px] is 0"},
      {"no height", [](Info* i) { i->height = 0; }, "camera height [px] is 0"},
      {"width of 2^32 - 1", [](Info* i) { i->width = kMaxUint32; }, "camera width [px] is 100001"},
      {"more pixels than memory",
       [](Info* i) {
         i->width = i->height = 100000;
         i->K[0] = i->K[4] = 5e4;
         i->D[0] = 0.1;
       },
       "width * height [px] is 1e+10"},
      {"unknown model", [](Info* i) { i->distortion_model = "thin_prism"; },
       "the distortion model is \"thin_prism\"; supported are plumb_bob, rational_polynomial and "
       "equidistant"},
      {"no model but D", [](Info* i) { i->distortion_model.clear(), i->D[0] = 0.1; },
       "the distortion model is \"\""},
      {"1 coefficient", [](Info* i) { i->D = {0.1}; }, "coefficients, not 1"},
      {"6 coefficients", [](Info* i) { i->D = {0.1, 0, 0, 0, 0, 0}; }, "coefficients, not 6"},
      {"100 coefficients", [](Info* i) { i->D.assign(100, 0.1); }, "coefficients, not 100"},
      {"5 coefficients of a fisheye", [](Info* i) { i->distortion_model = "equidistant"; },
       "equidistant distortion has 4 coefficients, not 5"},
      {"huge coefficient", [](Info* i) { i->D[0] = 1e9; }, "distortion coefficient is 1e+09"},
      {"roi beside the image",
       [](Info* i) {
         i->roi.x_offset = 641;
         i->roi.width = i->roi.height = 10;
       },
       "the ROI of 10 x 10 at (641, 0) is not inside the image of 640 x 200"},
      {"roi below the image",
       [](Info* i) {
         i->roi.y_offset = 201;
         i->roi.width = i->roi.height = 10;
       },
       "the ROI of 10 x 10 at (0, 201) is not inside the image of 640 x 200"},
      {"roi over the edge",
       [](Info* i) {
         i->roi.y_offset = 101;
         i->roi.width = 640;
         i->roi.height = 100;
       },
       "the ROI of 640 x 100 at (0, 101)"},
      {"roi size near 2^32",
       [](Info* i) {
         i->roi.x_offset = 100;
         i->roi.width = kMaxUint32 - 50;
         i->roi.height = 200;
       },
       "the ROI of 4294967245 x 200"},
      {"roi without a size", [](Info* i) { i->roi.x_offset = 4; },
       "a binning of 1 x 1 leaves no pixel of the ROI of 0 x 0 at (4, 0)"},
      {"binning beyond the image", [](Info* i) { i->binning_y = 201; },
       "a binning of 1 x 201 leaves no pixel of the image of 640 x 200"},
      {"binning beyond the ROI",
       [](Info* i) {
         i->roi.width = i->roi.height = 10;
         i->binning_x = 11;
       },
       "a binning of 11 x 1 leaves no pixel of the ROI of 10 x 10 at (0, 0)"},
  };
  for (const Refused& refused : cases) {
    Info info = goodInfo();
    refused.change(&info);
    const std::string message = refusal(info);
    EXPECT_NE(message.find(refused.message_part), std::string::npos)
        << refused.name << ": " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << refused.name;
  }
  Info info = goodInfo();
  info.P.fill(0);
  EXPECT_NE(refusal(info, true).find("has no P, which image_is_rectified requires"),
            std::string::npos);
}

}  // namespace
}  // namespace ground_scale_vo
