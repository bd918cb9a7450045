#include "input/camera_info.hpp"

#include <opencv2/calib3d.hpp>

#include "support/camera_info.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

const std::vector<double> kBarrel{-0.3, 0.1, 0, 0, 0}, kNoDistortion(5, 0.0);

/// A raw camera as camera_calibration describes it. alpha: 0 crops the rectified image, 1 keeps all
/// raw pixels.
CameraInfo rawCamera(const std::vector<double>& D, double alpha = 0) {
  CameraInfo info = cameraInfo({640, 480, 400, 400, 320, 240});
  info.D = D;
  const cv::Matx33d P =
      cv::getOptimalNewCameraMatrix(cv::Matx33d(info.K.data()), D, cv::Size(640, 480), alpha);
  info.P = {P(0, 0), 0, P(0, 2), 0, 0, P(1, 1), P(1, 2), 0, 0, 0, 1, 0};
  return info;
}

CameraInfo fisheye() {
  CameraInfo info = rawCamera(kNoDistortion);
  info.distortion_model = "equidistant";
  info.D = {0.01, 0, 0, 0};
  return info;
}

/// camera_info of kitti2bag for a raw drive: K and D of the raw camera of 1392 x 512, size and P of
/// the rectified images.
CameraInfo kittiRaw() {
  CameraInfo info;
  info.width = 1242;
  info.height = 375;
  info.distortion_model = "plumb_bob";
  info.D = {-0.3728755, 0.2037299, 0.002219027, 0.001383707, -0.07233722};
  info.K = {984.2439, 0, 690, 0, 980.8141, 233.1966, 0, 0, 1};
  info.R = {0.9999239,    0.00983776,  -0.007445048, -0.009869795, 0.9999421,
            -0.004278459, 0.007402527, 0.004351614,  0.9999631};
  info.P = {721.5377, 0, 609.5593, 0, 0, 721.5377, 172.854, 0, 0, 0, 1, 0};
  return info;
}

/// P of another focal length.
CameraInfo withFocalLengthOfP(CameraInfo info, double f) {
  info.P[0] = info.P[5] = f;
  return info;
}

/// P equals K but for an offset of an element.
CameraInfo withKAsP(std::size_t element, double offset) {
  CameraInfo info = rawCamera(kBarrel);
  info.P = {info.K[0], 0, info.K[2], 0, 0, info.K[4], info.K[5], 0, 0, 0, 1, 0};
  info.P[element] += offset;
  return info;
}

/// A camera of a stereo pair that looks 20 degrees to the side of the rectified images, whose
/// principal point is moved; direction -1: so that they show the same part of the scene.
CameraInfo ofStereoPair(double direction) {
  const double angle = 20 * M_PI / 180;
  CameraInfo info = rawCamera(kNoDistortion);
  info.R = {std::cos(angle), 0, std::sin(angle), 0, 1, 0, -std::sin(angle), 0, std::cos(angle)};
  info.P[2] = info.K[2] + direction * info.K[0] * std::tan(angle);
  return info;
}

enum Contradiction { kNone, kPossible, kCertain };

TEST(CameraInfo, WithoutASizeHasThatOfTheImages) {
  CameraInfo info = rawCamera(kBarrel);
  info.width = info.height = 0;
  const CameraCalibration camera = readCameraInfo(info, "/info", false);
  EXPECT_FALSE(camera.hasSize());
  EXPECT_EQ(camera.distortion, kBarrel);
  EXPECT_EQ(rectificationContradiction(info, false, "/image").reason, "");
  EXPECT_EQ(checkCalibration(camera, "/info", {640, 480}), "");
  const cv::Size other(640, 400);
  expectThrows<DataError>([&] { checkCalibration(camera, "/info", other); },
                          "/info states no image size, and its principal point (320, 240) is not "
                          "near the centre of images of 640x400");
}

TEST(RectificationCheck, FindsRawImagesTakenForRectifiedAndTheConverse) {
  CameraInfo only_P = kittiRaw(), invalid_R = rawCamera(kBarrel);
  only_P.K.fill(0);
  invalid_R.R.fill(7);
  const struct {
    const char* name;
    CameraInfo info;
    bool image_is_rectified;
    const char* topic;
    Contradiction expected;
  } kCases[] = {
      {"barrel, cropped", rawCamera(kBarrel, 0), false, "/cam/image_raw", kNone},
      {"barrel, all pixels", rawCamera(kBarrel, 1), false, "/cam/image_raw", kNone},
      {"pincushion", rawCamera({0.1, 0, 0, 0, 0}), false, "/image", kNone},
      {"fisheye", fisheye(), false, "/image_raw", kNone},
      {"undistorted, rectified topic", rawCamera(kNoDistortion), false, "/cam/image_rect", kNone},
      {"rectified", rawCamera(kBarrel), true, "/cam/image_rect", kNone},
      {"KITTI", kittiRaw(), true, "/kitti/camera_gray_left/image_raw", kNone},
      {"only P", only_P, false, "/kitti/camera_gray_left/image_rect", kNone},
      {"rect in the namespace", rawCamera(kBarrel), false, "/robot/rectangle/image_raw", kNone},
      {"raw in the namespace", rawCamera(kBarrel), true, "/robot/raw/image_rect/compressed", kNone},
      {"rectified images with the principal point of K",
       withFocalLengthOfP(withKAsP(0, 0), rawCamera(kBarrel).P[0]), true, "/image", kNone},
      {"rectified images with f of K, other cx", withKAsP(2, 10), true, "/image", kNone},
      {"rectified images with f of K, other cy", withKAsP(6, 10), true, "/image", kNone},
      {"stereo", ofStereoPair(-1), false, "/image", kNone},
      {"invalid R", invalid_R, false, "/image", kNone},
      // Rectified images taken for raw; only an impossible P is certain.
      {"KITTI", kittiRaw(), false, "/kitti/camera_gray_left/image_raw", kCertain},
      {"small f", withFocalLengthOfP(rawCamera(kNoDistortion), 300), false, "/image", kCertain},
      {"large f", withFocalLengthOfP(rawCamera(kNoDistortion), 600), false, "/image", kCertain},
      {"stereo, to the other side", ofStereoPair(1), false, "/image", kCertain},
      {"named so", rawCamera(kBarrel), false, "/cam/image_rect_color", kPossible},
      {"centre of a fisheye image", withFocalLengthOfP(fisheye(), 1200), false, "/image_raw",
       kPossible},
      // Raw images taken for rectified.
      {"named so", rawCamera(kBarrel), true, "/cam/image_raw/compressed", kPossible},
      {"P equals K", withKAsP(0, 0), true, "/image", kPossible},
  };
  for (const auto& c : kCases) {
    const auto [reason, is_certain] =
        rectificationContradiction(c.info, c.image_is_rectified, c.topic);
    EXPECT_EQ(reason.empty(), c.expected == kNone) << c.name << ": " << reason;
    EXPECT_EQ(is_certain, c.expected == kCertain) << c.name << ": " << reason;
  }
}

}  // namespace
}  // namespace gsv
