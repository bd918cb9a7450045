#include "ground_scale_vo/input/camera_file.hpp"

#include "input/distortion_model.hpp"
#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using CameraFile = TemporaryFolder;

const CameraCalibration kCamera{640, 480, 500.5, 501, 320.25, 240, {-0.3, 0.1, 1e-3, -2e-3, 0.01}};

void expectIntrinsics(const CameraCalibration& camera, const PinholeCamera& expected) {
  EXPECT_EQ(camera.width, expected.width);
  EXPECT_EQ(camera.height, expected.height);
  EXPECT_EQ(camera.fx, expected.fx);
  EXPECT_EQ(camera.fy, expected.fy);
  EXPECT_EQ(camera.cx, expected.cx);
  EXPECT_EQ(camera.cy, expected.cy);
}

TEST_F(CameraFile, ReadsWhatItWrites) {
  const auto file = write("camera.yaml", cameraYaml(kCamera, "two\nlines"));
  CameraCalibration read = readCameraFile(file);
  expectIntrinsics(read, {640, 480, 500.5, 501, 320.25, 240});
  EXPECT_EQ(read.distortion, kCamera.distortion);
  EXPECT_FALSE(read.estimated);
  EXPECT_EQ(read.readout_time, 0);
  CameraCalibration estimated = kCamera;
  estimated.estimated = true;
  estimated.k1_sigma = 0.0021;
  estimated.readout_time = 0.0213;
  std::string text = cameraYaml(estimated, "");
  text.replace(text.find("plumb_bob"), 9, "\"plumb_bob\"");
  read = readCameraFile(write("camera.yaml", text));
  EXPECT_TRUE(read.estimated);
  EXPECT_EQ(read.k1_sigma, 0.0021);
  EXPECT_EQ(read.readout_time, 0.0213);
}

TEST_F(CameraFile, RefusesWhatIsNotACamera) {
  EXPECT_THROW(readCameraFile(folder_ / "none.yaml"), DataError);
  const std::string good = cameraYaml(kCamera, "") + "readout_time: 0.03\n";
  for (const auto& [part, other] :
       std::vector<std::pair<std::string, std::string>>{{"plumb_bob", "omni"},
                                                        {"image_width: 640", "image_width: -1"},
                                                        {"[500.5", "[nan"},
                                                        {"0.03", "0.21"},
                                                        {"camera_matrix", "matrix"},
                                                        {"data: [-0.3", "data: [7, 8, -0.3"}}) {
    std::string text = good;
    text.replace(text.find(part), part.size(), other);
    EXPECT_THROW(readCameraFile(write("camera.yaml", text)), DataError) << other;
  }
}

// The same camera in every format, in the spelling of its tool.
TEST_F(CameraFile, ReadsTheFormatsOfOtherTools) {
  const std::string ros =
      "image_width: 640\nimage_height: 480\ncamera_name: cam\ncamera_matrix: {rows: 3, cols: 3, "
      "data: [500, 0, 310, 0, 510, 230, 0, 0, 1]}\n";
  const std::string opencv =
      "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nflags: 2\ncamera_matrix: "
      "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., 310., 0., 510.,\n"
      "       230., 0., 0., 1. ]\n";
  const std::string vins_size =
      "%YAML:1.0\n---\ncamera_name: camera\nimage_width: 640\nimage_height: 480\n";
  const std::string kalibr =
      "cam0:\n  cam_overlaps: []\n  camera_model: pinhole\n  distortion_coeffs: [-0.2, 0.05, "
      "0.001, -0.001]\n  intrinsics: [500, 510, 310, 230]\n  resolution: [640, 480]\n  "
      "T_cam_imu:\n  - [1, 0, 0, 0]\n  - [0, 1, 0, 0]\n  rostopic: /cam0/image_raw\n";
  const std::vector<double> D = {-0.2, 0.05, 0.001, -0.001};
  const struct {
    std::string text;
    bool is_fisheye = false, has_size = true;
    std::size_t coefficients = 4;
  } kCases[] = {
      {ros + "camera_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [-0.2, "
             "0.05, 0.001, -0.001, 0]}\n",
       false, true, 5},
      {ros +
           "distortion_model: rational_polynomial\ndistortion_coefficients:\n  data: [-0.2, 0.05, "
           "0.001, -0.001, 0, 0, 0, 0.1]\n",
       false, true, 8},
      {"\xef\xbb\xbf" + ros +
           "distortion_model: 'equidistant'\r\ndistortion_coefficients: {data: "
           "[-0.2, 0.05, 0.001, -0.001]}\r\n",
       true},
      {opencv +
       "distortion_coefficients: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: "
       "[ -2.0e-01, 5.0e-02, 1.0e-03, -1.0e-03 ]\navg_reprojection_error: 0.1\n"},
      {kalibr + "  distortion_model: radtan\n"},
      {kalibr + "  distortion_model: equidistant\n", true},
      {"%YAML:1.0\n# EuRoC\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1]\n"
       "rate_hz: 20\nresolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [500, 510, 310, "
       "230]\ndistortion_model: radial-tangential\ndistortion_coefficients: [-0.2, 0.05, 0.001, "
       "-0.001]\n"},
      {vins_size + "model_type: PINHOLE\ndistortion_parameters:\n   k1: -0.2\n   k2: 0.05\n   p1: "
                   "0.001\n   p2: -0.001\nprojection_parameters:\n   fx: 500\n   fy: 510\n   cx: "
                   "310\n   cy: 230\n"},
      {vins_size +
           "model_type: KANNALA_BRANDT\nprojection_parameters:\n   k2: -0.2\n   k3: 0.05\n   "
           "k4: 0.001\n   k5: -0.001\n   mu: 500\n   mv: 510\n   u0: 310\n   v0: 230\n",
       true},
      {ros + "distortion_model: none\ndistortion_coefficients: {rows: 1, cols: 0, data: []}\n",
       false, true, 0},
      {"%YAML:1.0\n\nCamera.fx: 500\nCamera.fy: 510\nCamera.cx: 310\nCamera.cy: 230\nCamera.k1: "
       "-0.2\nCamera.k2: 0.05\nCamera.p1: 0.001\nCamera.p2: -0.001\nCamera.fps: 10.0\nTracking: "
       "1\n",
       false, false},
      {"%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera1.fx: 500\nCamera1.fy: 510\nCamera1.cx: "
       "310\nCamera1.cy: 230\nCamera1.k1: -0.2\nCamera1.k2: 0.05\nCamera1.k3: 0.001\nCamera1.k4: "
       "-0.001\nCamera.width: 640\nCamera.height: 480\n",
       true},
  };
  for (const auto& c : kCases) {
    SCOPED_TRACE(c.text);
    const CameraCalibration camera = readCameraFile(write("camera.yaml", c.text));
    expectIntrinsics(camera, {c.has_size ? 640 : 0, c.has_size ? 480 : 0, 500, 510, 310, 230});
    EXPECT_EQ(camera.model->names.front() == "equidistant", c.is_fisheye);
    EXPECT_EQ(camera.distortion.size(), c.coefficients);
    for (std::size_t i = 0; i < D.size() && i < camera.distortion.size(); ++i) {
      EXPECT_EQ(camera.distortion[i], D[i]);
    }
  }
  const CameraCalibration orb_slam = readCameraFile(write(
      "camera.yaml",
      "%YAML:1.0\nCamera.fx: 500\nCamera.fy: 510\nCamera.cx: 310\nCamera.cy: 230\n"
      "Camera.k1: -0.2\nCamera.k2: 0.05\nCamera.k3: 0.01\nCamera.p1: 0.001\nCamera.p2: 0.002\n"));
  EXPECT_EQ(orb_slam.distortion, (std::vector<double>{-0.2, 0.05, 0.001, 0.002, 0.01}));
}

TEST_F(CameraFile, RefusesOtherModelsByName) {
  const auto error = [&](const std::string& text) {
    return dataErrorOf([&] { readCameraFile(write("camera.yaml", text)); }, folder_);
  };
  EXPECT_EQ(error("<?xml version=\"1.0\"?>\n<opencv_storage>\n"),
            "/camera.yaml: is OpenCV's XML, which is not read; save it as YAML");
  EXPECT_EQ(
      error("model_type: MEI\nimage_width: 640\nimage_height: 480\nprojection_parameters: {a: 1}"),
      "/camera.yaml cannot be used: the camera model is MEI, supported are PINHOLE and "
      "KANNALA_BRANDT");
  EXPECT_EQ(error("model_type: PINHOLE\nimage_width: 640\nimage_height: 480\n"
                  "projection_parameters: {fx: 500, fy: 510, cx: 310, cy: 230}"),
            "/camera.yaml: has no distortion_parameters");
  EXPECT_EQ(error("cam0: {camera_model: omni}"),
            "/camera.yaml: the camera model is omni, supported is pinhole");
  EXPECT_EQ(error("Camera.fx: 1\nCamera.fy: 1\nCamera.cx: 1\nCamera.cy: 1\nCamera.type: Omni"),
            "/camera.yaml cannot be used: the camera type is Omni, supported are PinHole and "
            "KannalaBrandt8");
  EXPECT_EQ(error("just text"), "/camera.yaml: is neither YAML of a camera nor a KITTI calib.txt");
  EXPECT_EQ(error("image_width: 640\n"), "/camera.yaml: has no image_height");
  EXPECT_EQ(error("image_width: 640\nimage_height: high\n"),
            "/camera.yaml: line 2 has no numbers: image_height: high");
  EXPECT_EQ(error("%YAML:1.0\nCamera.fx: 1\nCamera.k1: 0,0\n"),
            "/camera.yaml: line 3 has no numbers: Camera.k1: 0,0");
  EXPECT_EQ(error("image_width: [640\n").find("/camera.yaml: line "), 0u);
}

TEST_F(CameraFile, ReadsKittiCalibrations) {
  expectIntrinsics(
      readCameraFile(
          write("calib.txt", "P0: 500 0 310 0 0 510 230 0 0 0 1 0\nP1: 1 0 2 0 0 3 4 0 0 0 1 0\n")),
      {0, 0, 500, 510, 310, 230});
  expectIntrinsics(
      readCameraFile(write("calib.txt", "P0: 500 0 310 0 0 510 230 0 0 0 1 0\nS0: 640 480\n")),
      {640, 480, 500, 510, 310, 230});
  expectIntrinsics(
      readCameraFile(write("intrinsic.txt",
                           "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n0 0 725 726 620.5 187\n"
                           "0 1 7 7 6 1\n")),
      {0, 0, 725, 726, 620.5, 187});
  const auto raw = write("calib_cam_to_cam.txt",
                         "S_00: 1392 512\nK_00: 900 0 690 0 910 230 0 0 1\nD_00: -0.3 0.1 0 0 0\n"
                         "S_rect_00: 1242 375\nP_rect_00: 700 0 600 45 0 710 180 0 0 0 1 0\n");
  expectIntrinsics(readCameraFile(raw), {1242, 375, 700, 710, 600, 180});
  expectIntrinsics(readKittiRawCamera(raw, "00", false), {1392, 512, 900, 910, 690, 230});
}

}  // namespace
}  // namespace gsv
