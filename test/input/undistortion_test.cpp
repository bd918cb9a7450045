// camera_info: the intrinsics taken from it, the rectification by it, and what is refused.

#include <opencv2/calib3d.hpp>

#include "ground_scale_vo/input/image.hpp"
#include "input/camera_info.hpp"
#include "support/camera_info.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Info = CameraInfo;

CameraCalibration cameraOf(const Info& info, bool is_rectified = false) {
  return readCameraInfo(info, "/t", is_rectified);
}

/// Undistorted, the same intrinsics in K and P.
Info goodInfo() { return cameraInfo({640, 200, 400, 410, 320, 100}); }

void setRoi(Info* info, std::uint32_t x, std::uint32_t y, std::uint32_t width,
            std::uint32_t height) {
  info->roi.x_offset = x;
  info->roi.y_offset = y;
  info->roi.width = width;
  info->roi.height = height;
}

TEST(CameraInfo, TakesKOfRawAndPOfRectifiedImages) {
  // KITTI's raw drives: K and D of the raw camera beside rectified images.
  Info info = goodInfo();
  info.P[0] = 500;
  info.D = {-0.37, 0.2, 0.001, 0.001, -0.07};
  const CameraCalibration raw = cameraOf(info), rectified = cameraOf(info, true);
  EXPECT_TRUE(isSameCamera(pinholeOf(raw), {640, 200, 400, 410, 320, 100}));
  EXPECT_TRUE(raw.isDistorted());
  EXPECT_EQ(rectified.fx, 500);
  EXPECT_FALSE(rectified.isDistorted());
  info.K.fill(0);
  EXPECT_EQ(cameraOf(info).fx, 500) << "without K";
}

// The right camera of a stereo pair has its baseline in P, a stereo calibration has an R; neither
// changes the rays of the pixels of this camera.
TEST(CameraInfo, AppliesRoiAndBinningToPAndIgnoresTheStereoCalibration) {
  Info info = goodInfo();
  setRoi(&info, 100, 0, 540, 200);
  info.binning_x = 2;
  info.P[3] = -386.1;
  info.R.fill(7);
  EXPECT_TRUE(isSameCamera(pinholeOf(cameraOf(info, true)), {270, 200, 200, 410, 110, 100}));
  setRoi(&info, 0, 0, 640, 200);
  info.binning_x = 0;
  EXPECT_TRUE(isSameCalibration(cameraOf(info), cameraOf(goodInfo())));
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
/// the coordinates of the raw pixel that it shows, which must be those of distorted().
void expectRectified(const Info& info, int binning) {
  const Undistortion undistortion(cameraOf(info));
  const PinholeCamera camera = undistortion.camera();
  ASSERT_LE(camera.width, 256);
  cv::Mat along_x(camera.height, camera.width, CV_8U), along_y = along_x.clone();
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      along_x.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(u);
      along_y.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(v);
    }
  }
  const cv::Mat x = undistortion.image(along_x).grey, y = undistortion.image(along_y).grey;
  const cv::Point2d origin(info.roi.x_offset, info.roi.y_offset);
  int compared = 0;
  for (int v = 0; v < camera.height; v += 3) {
    for (int u = 0; u < camera.width; u += 3) {
      const cv::Point2d raw = distorted(info, (binning * u + origin.x - info.K[2]) / info.K[0],
                                        (binning * v + origin.y - info.K[5]) / info.K[4]);
      const cv::Point2d pixel = (raw - origin) / binning;
      if (pixel.x < 0 || pixel.y < 0 || pixel.x > camera.width - 1 || pixel.y > camera.height - 1) {
        continue;
      }
      ++compared;
      // Half a grey level, and the 1/32 of a pixel by which OpenCV's maps are rounded.
      ASSERT_NEAR(x.at<std::uint8_t>(v, u), pixel.x, 0.55) << u << ", " << v;
      ASSERT_NEAR(y.at<std::uint8_t>(v, u), pixel.y, 0.55) << u << ", " << v;
    }
  }
  EXPECT_GT(compared, camera.width * camera.height / 9 / 2);
}

TEST(Rectification, FollowsEveryDistortionModelWithRoiAndBinning) {
  const struct {
    const char* model;
    std::vector<double> D;
  } kDistortions[] = {
      {"plumb_bob", {-0.3, 0.1, 0.01, -0.02}},
      {"plumb_bob", {-0.35, 0.15, 0.001, 0.002, -0.03}},
      {"rational_polynomial", {0.3, 0.05, 0.002, -0.001, 0.01, 0.6, 0.1, 0.02}},
      {"rational_polynomial",
       {0.3, 0.05, 0, 0, 0.01, 0.6, 0.1, 0.02, 0.01, 0, 0.02, 0, 0.03, -0.02}},
      {"equidistant", {0.1, -0.05, 0.02, -0.01}},
      {"fisheye", {0.1, -0.05, 0.02, -0.01}},
      {"plumb_bob", {}},
      {"", {0, 0, 0, 0, 0}},
      {"", {-0.3, 0.1, 0.002, -0.003, -0.01}},
  };
  for (const auto& distortion : kDistortions) {
    SCOPED_TRACE(std::string(distortion.model) + " " + std::to_string(distortion.D.size()));
    // Images of less than 256 x 256 pixels, whose coordinates fit a grey value.
    const auto infoOf = [&](const PinholeCamera& camera) {
      Info info = cameraInfo(camera);
      info.distortion_model = distortion.model;
      info.D = distortion.D;
      return info;
    };
    expectRectified(infoOf({250, 120, 130, 133, 121, 63}), 1);
    Info info = infoOf({500, 240, 260, 266, 242, 126});
    info.binning_x = info.binning_y = 2;
    expectRectified(info, 2);
    setRoi(&info, 100, 40, 301, 160);
    EXPECT_EQ(cameraOf(info).width, 150);
    EXPECT_EQ(cameraOf(info).height, 80);
    expectRectified(info, 2);
    setRoi(&info, 100, 40, 200, 160);
    info.binning_x = info.binning_y = 1;
    expectRectified(info, 1);
  }
}

/// 800 x 248.
CameraCalibration wideCamera(double k1) {
  Info info = cameraInfo({800, 248, 464, 464, 400, 119});
  info.D[0] = k1;
  return cameraOf(info);
}

TEST(Rectification, KeepsImagesWithoutDistortionAndRefusesThoseOfAnotherSize) {
  const cv::Mat image(248, 800, CV_8UC1, cv::Scalar(7));
  const Undistortion undistortion(wideCamera(0));
  EXPECT_EQ(undistortion.image(image).grey.data, image.data);
  EXPECT_TRUE(undistortion.mask().empty());
  EXPECT_THROW(Undistortion(wideCamera(0.1)).image(image.rowRange(0, 100)), OptionError);
}

// Wherever the image's content comes, even in part, from a masked pixel or from outside the image.
TEST(Rectification, OfAMaskCoversAllThatDependsOnIt) {
  for (const double k1 : {-0.3, 0.1}) {
    const cv::Rect region(550, 120, 100, 60);
    cv::Mat mask(248, 800, CV_8UC1, cv::Scalar(1)), image(248, 800, CV_8UC1, cv::Scalar(200));
    mask(region).setTo(0);
    const Undistortion undistortion(wideCamera(k1), mask);
    const cv::Mat without = undistortion.image(image).grey;
    image(region).setTo(0);
    const cv::Mat masked = undistortion.mask() == 0;
    const cv::Mat depends = (undistortion.image(image).grey != without) | (without != 200);
    EXPECT_EQ(cv::countNonZero(depends & ~masked), 0) << k1;
    EXPECT_GT(cv::countNonZero(depends), 3000);
    // 1/255 of a masked pixel masks, 1/200 changes the image.
    EXPECT_LT(cv::countNonZero(masked), cv::countNonZero(depends) + 100);
  }
}

TEST(CameraInfo, RefusesInvalidCalibrationsAndNamesTopicAndReason) {
  const struct {
    std::function<void(Info*)> change;  ///< makes goodInfo() invalid
    const char* reason;
    bool is_rectified = false;
  } kCases[] = {
      {[](Info* i) { i->K[0] = kNan; }, "not finite"},
      {[](Info* i) { i->D[4] = kInfinity; }, "not finite"},
      {[](Info* i) { i->R[8] = kNan; }, "not finite"},
      {[](Info* i) { i->K.fill(0), i->P.fill(0); }, "all zeros: the camera is not calibrated"},
      {[](Info* i) { i->P.fill(0); }, "has no P, which image_is_rectified requires", true},
      {[](Info* i) { i->K[0] = -400; }, "fx [px] is -400"},
      {[](Info* i) { i->K[0] = i->K[4] = 2; }, "fx [image widths] is 0.003125"},
      {[](Info* i) { i->K[4] = 4001; }, "fy / fx is 10.0025"},
      {[](Info* i) { i->K[2] = 6500; }, "cx [image widths]"},
      {[](Info* i) { i->K = {400, 0, 0, 0, 410, 0, 320, 100, 1}; }, "K is not of the form"},
      {[](Info* i) { i->P[10] = 0; }, "P is not of the form", true},
      {[](Info* i) { i->width = 0; }, "width [px] is 0"},
      {[](Info* i) { i->width = i->height = 100000, i->K[0] = i->K[4] = 5e4; },
       "width * height [px] is 1e+10"},
      {[](Info* i) { i->distortion_model = "thin_prism"; },
       "\"thin_prism\"; supported are plumb_bob, rational_polynomial"},
      {[](Info* i) {
         i->distortion_model.clear(), i->D = {0.1, 0, 0, 0};
       },
       "distortion model is \"\""},  // of a fisheye lens?
      {[](Info* i) { i->D = {0.1}; }, "coefficients, not 1"},
      {[](Info* i) { i->distortion_model = "equidistant"; }, "has 4 coefficients, not 5"},
      {[](Info* i) { setRoi(i, 641, 0, 10, 10); }, "ROI of 10x10 at (641, 0) is not inside"},
      {[](Info* i) { setRoi(i, 100, 0, kMaxUint32 - 50, 200); }, "ROI of 4294967245x200"},
      {[](Info* i) { setRoi(i, 4, 0, 0, 0); }, "no pixel of the ROI of 0x0 at (4, 0)"},
      {[](Info* i) { i->binning_y = 201; }, "a binning of 1x201 leaves no pixel of the image"},
      {[](Info* i) { setRoi(i, 0, 0, 10, 10), i->binning_x = 11; },
       "a binning of 11x1 leaves no pixel of the ROI of 10x10"},
  };
  for (const auto& refused : kCases) {
    Info info = goodInfo();
    refused.change(&info);
    const auto construct = [&] { readCameraInfo(info, "/cam/info", refused.is_rectified); };
    expectThrows<DataError>(construct, refused.reason);
    expectThrows<DataError>(construct, "camera_info on topic /cam/info ");
  }
}

}  // namespace
}  // namespace gsv
