#include "ground_scale_vo/input/camera_file.hpp"

#include <yaml-cpp/yaml.h>

#include <sstream>
#include <vector>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "input/distortion_model.hpp"

namespace gsv {
namespace {

namespace fs = std::filesystem;
using Numbers = std::vector<double>;

constexpr std::size_t kMaxBytes = 1 << 20;

/// A file of YAML whose errors name it.
class CameraYaml {
 public:
  CameraYaml(const fs::path& file, const std::string& text) : name_(file.string()), text_(text) {
    try {
      root_ = YAML::Load(text);
    } catch (const YAML::Exception& error) {
      fail(format("line %d is not YAML (%s)", error.mark.line + 1, error.msg.c_str()));
    }
    if (!root_.IsMap()) fail("is neither YAML of a camera nor a KITTI calib.txt");
  }

  [[noreturn]] void fail(const std::string& what) const { throw DataError(name_ + ": " + what); }

  const YAML::Node& root() const { return root_; }
  bool has(const std::string& key) const { return static_cast<bool>(root_[key]); }
  /// The first of the keys that the file has. Throws DataError.
  YAML::Node at(std::initializer_list<const char*> keys) const {
    for (const char* key : keys) {
      if (has(key)) return root_[key];
    }
    fail(std::string("has no ") + *keys.begin());
  }
  YAML::Node child(const YAML::Node& node, const std::string& key) const {
    if (!node.IsMap() || !node[key]) fail("has no " + key);
    return node[key];
  }
  std::string word(const YAML::Node& node) const {
    if (!node.IsScalar()) fail(format("line %d is not one word", node.Mark().line + 1));
    return node.Scalar();
  }
  /// Not by node.as<double>(), which reads the decimal point of the global locale.
  double number(const YAML::Node& node) const {
    const auto value = node.IsScalar() ? parseNumber<double>(node.Scalar()) : std::nullopt;
    if (!value) failAt(node);
    return *value;
  }
  /// Numbers of a scalar, a list, or the data of a matrix, which may be empty.
  Numbers numbers(const YAML::Node& node) const {
    if (node.IsScalar()) return {number(node)};
    const YAML::Node list = node.IsMap() ? child(node, "data") : node;
    if (!list.IsSequence()) failAt(node);
    Numbers result;
    for (const YAML::Node& entry : list) result.push_back(number(entry));
    return result;
  }

 private:
  [[noreturn]] void failAt(const YAML::Node& node) const {
    std::istringstream lines(text_);
    std::string line;
    for (int i = 0; i <= node.Mark().line; ++i) std::getline(lines, line);
    fail(format("line %d has no numbers: ", node.Mark().line + 1) + line);
  }

  std::string name_, text_;
  YAML::Node root_;
};

void setSize(const CameraYaml& yaml, const Numbers& size, CameraCalibration* camera) {
  const auto is_side = [](double n) { return n >= 1 && n <= kMaxImageSide; };
  if (size.size() != 2 || !is_side(size[0]) || !is_side(size[1])) {
    yaml.fail("has an implausible image size");
  }
  camera->width = static_cast<int>(size[0]);
  camera->height = static_cast<int>(size[1]);
}

/// Of the first keys that the file has.
void setSize(const CameraYaml& yaml, std::initializer_list<const char*> width,
             std::initializer_list<const char*> height, CameraCalibration* camera) {
  setSize(yaml, {yaml.number(yaml.at(width)), yaml.number(yaml.at(height))}, camera);
}

void setIntrinsics(const CameraYaml& yaml, const Numbers& fx_fy_cx_cy, CameraCalibration* camera) {
  if (fx_fy_cx_cy.size() != 4) yaml.fail("intrinsics are not the numbers fx, fy, cx, cy");
  camera->fx = fx_fy_cx_cy[0];
  camera->fy = fx_fy_cx_cy[1];
  camera->cx = fx_fy_cx_cy[2];
  camera->cy = fx_fy_cx_cy[3];
}

/// The numbers of these keys; those that the node does not have are left out.
Numbers members(const CameraYaml& yaml, const YAML::Node& node,
                std::initializer_list<const char*> keys) {
  Numbers numbers;
  for (const char* key : keys) {
    if (node.IsMap() && node[key]) numbers.push_back(yaml.number(node[key]));
  }
  return numbers;
}

CameraCalibration ofRosOrOpenCv(const CameraYaml& yaml) {
  CameraCalibration camera;
  setSize(yaml, {"image_width", "image_Width"}, {"image_height", "image_Height"}, &camera);
  const Numbers K = yaml.numbers(yaml.at({"camera_matrix", "Camera_Matrix", "cameraMatrix", "K"}));
  if (K.size() != 9 || K[1] != 0 || K[3] != 0 || K[6] != 0 || K[7] != 0 || K[8] != 1) {
    yaml.fail("camera_matrix is not of the form fx 0 cx, 0 fy cy, 0 0 1");
  }
  setIntrinsics(yaml, {K[0], K[4], K[2], K[5]}, &camera);
  const bool is_named = yaml.has("distortion_model") || yaml.has("camera_model");
  const bool is_fisheye = yaml.has("fisheye_model") && yaml.number(yaml.at({"fisheye_model"})) > 0;
  camera.setDistortion(is_named     ? yaml.word(yaml.at({"distortion_model", "camera_model"}))
                       : is_fisheye ? "fisheye"
                                    : "plumb_bob",
                       yaml.numbers(yaml.at({"distortion_coefficients", "Distortion_Coefficients",
                                             "distCoeffs", "dist_coeffs", "D"})));
  camera.estimated =
      yaml.has("estimated_from_drives") && yaml.word(yaml.at({"estimated_from_drives"})) == "true";
  if (yaml.has("k1_sigma")) camera.k1_sigma = yaml.number(yaml.at({"k1_sigma"}));
  if (yaml.has("readout_time")) camera.readout_time = yaml.number(yaml.at({"readout_time"}));
  return camera;
}

/// A camera of a Kalibr camchain, or sensor.yaml of EuRoC.
CameraCalibration ofKalibr(const CameraYaml& yaml, const YAML::Node& node) {
  if (const std::string model = yaml.word(yaml.child(node, "camera_model")); model != "pinhole") {
    yaml.fail("the camera model is " + model + ", supported is pinhole");
  }
  CameraCalibration camera;
  setIntrinsics(yaml, yaml.numbers(yaml.child(node, "intrinsics")), &camera);
  setSize(yaml, yaml.numbers(yaml.child(node, "resolution")), &camera);
  camera.setDistortion(
      yaml.word(yaml.child(node, "distortion_model")),
      yaml.numbers(yaml.child(node, node["distortion_coefficients"] ? "distortion_coefficients"
                                                                    : "distortion_coeffs")));
  return camera;
}

/// prefix: "Camera." or "Camera1.".
CameraCalibration ofOrbSlam(const CameraYaml& yaml, const std::string& prefix) {
  const auto number = [&](const std::string& name) {
    return yaml.number(yaml.at({(prefix + name).c_str()}));
  };
  CameraCalibration camera;
  for (const char* name : {"k1", "k2", "p1", "p2", "k3", "k4"}) {
    if (yaml.has(prefix + name)) camera.distortion.push_back(number(name));
  }
  setIntrinsics(yaml, {number("fx"), number("fy"), number("cx"), number("cy")}, &camera);
  if (yaml.has("Camera.width") && yaml.has("Camera.height")) {
    setSize(yaml, {"Camera.width"}, {"Camera.height"}, &camera);
  }
  if (yaml.has("Camera.type")) {
    const std::string type = yaml.word(yaml.at({"Camera.type"}));
    camera.model =
        &modelNamed(type, &DistortionModel::orb_slam_names, "the camera type is " + type + ", ");
  }
  return camera;
}

CameraCalibration ofVins(const CameraYaml& yaml) {
  const YAML::Node projection = yaml.at({"projection_parameters"});
  CameraCalibration camera;
  setSize(yaml, {"image_width"}, {"image_height"}, &camera);
  const std::string type = yaml.word(yaml.at({"model_type"}));
  camera.model =
      &modelNamed(type, &DistortionModel::vins_names, "the camera model is " + type + ", ");
  if (camera.model->is_brown_conrady) {
    setIntrinsics(yaml, members(yaml, projection, {"fx", "fy", "cx", "cy"}), &camera);
    camera.distortion = members(yaml, yaml.at({"distortion_parameters"}), {"k1", "k2", "p1", "p2"});
  } else {
    setIntrinsics(yaml, members(yaml, projection, {"mu", "mv", "u0", "v0"}), &camera);
    camera.distortion = members(yaml, projection, {"k2", "k3", "k4", "k5"});
  }
  return camera;
}

/// What read() returns, if it is valid. Its distortion model may be unknown.
template <typename Read>
CameraCalibration valid(const fs::path& file, const Read& read) {
  try {
    CameraCalibration camera = read();
    camera.validate();
    return camera;
  } catch (const OptionError& error) {
    throw DataError(file.string() + " cannot be used: " + error.what());
  }
}

void setKittiSize(const TextFile& text, const std::string& key, CameraCalibration* camera) {
  if (!text.has(key)) return;
  const Numbers size = text.numbers(text.lineOf(key), 2, 1);
  camera->width = static_cast<int>(std::min<double>(size[0], kMaxImageSide));
  camera->height = static_cast<int>(std::min<double>(size[1], kMaxImageSide));
}

bool hasLine(const std::string& text, const std::string& key) {
  return ("\n" + text).find("\n" + key) != std::string::npos;
}

}  // namespace

CameraCalibration readCameraFile(const fs::path& file) {
  std::string text = readFile(file, kMaxBytes);
  if (text.rfind("\xef\xbb\xbf", 0) == 0) text.erase(0, 3);
  if (hasLine(text, "P_rect_00:")) return readKittiRawCamera(file, "00", true);
  if (hasLine(text, "P0:")) return readKittiProjection(file, "P0:");
  if (hasLine(text, "frame cameraID K[0,0] K[1,1]")) {  // Virtual KITTI: a line for each image
    const Numbers K = TextFile(file).numbers(1, 4, 2);
    return valid(file, [&] { return CameraCalibration{0, 0, K[0], K[1], K[2], K[3]}; });
  }
  // OpenCV's directive %YAML:1.0 is not YAML.
  if (text.rfind("%YAML", 0) == 0) text.erase(0, text.find('\n'));
  if (text.find("<opencv_storage>") != std::string::npos) {
    throw DataError(file.string() + ": is OpenCV's XML, which is not read; save it as YAML");
  }
  const CameraYaml yaml(file, text);
  return valid(file, [&] {
    if (yaml.has("cam0")) return ofKalibr(yaml, yaml.at({"cam0"}));
    if (yaml.has("resolution")) return ofKalibr(yaml, yaml.root());
    if (yaml.has("projection_parameters")) return ofVins(yaml);
    if (yaml.has("Camera.fx")) return ofOrbSlam(yaml, "Camera.");
    if (yaml.has("Camera1.fx")) return ofOrbSlam(yaml, "Camera1.");
    return ofRosOrOpenCv(yaml);
  });
}

CameraCalibration readKittiProjection(const fs::path& file, const std::string& key) {
  const TextFile text(file);
  const std::size_t line = text.lineOf(key);
  const Numbers p = text.numbers(line, 12, 1);
  const bool is_pinhole = p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1;
  if (!is_pinhole) text.fail(line, key + " is not the projection of a rectified pinhole camera");
  CameraCalibration camera{0, 0, p[0], p[5], p[2], p[6]};
  setKittiSize(text, "S" + key.substr(1), &camera);
  try {
    camera.validate();
  } catch (const OptionError& error) {
    text.fail(line, error.what());
  }
  return camera;
}

CameraCalibration readKittiRawCamera(const fs::path& file, const std::string& camera,
                                     bool rectified) {
  const TextFile text(file);
  if (rectified) return readKittiProjection(file, "P_rect_" + camera + ":");
  const Numbers K = text.numbers(text.lineOf("K_" + camera + ":"), 9, 1);
  const Numbers D = text.numbers(text.lineOf("D_" + camera + ":"), 5, 1);
  CameraCalibration calibration{0, 0, K[0], K[4], K[2], K[5], D};
  setKittiSize(text, "S_" + camera + ":", &calibration);
  return valid(file, [&] { return calibration; });
}

std::string cameraYaml(const CameraCalibration& camera, const std::string& comment) {
  std::string text;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) text += "# " + line + "\n";
  std::vector<double> d = camera.distortion;
  if (camera.isPlumbBob()) d.resize(5);
  std::string coefficients;
  for (const double k : d) coefficients += format(coefficients.empty() ? "%.8f" : ", %.8f", k);
  const auto matrix = [](const char* name, int rows, int columns, const std::string& data) {
    return format("%s:\n  rows: %d\n  cols: %d\n  data: [", name, rows, columns) + data + "]\n";
  };
  const std::string f_c = format("%.6f, 0, %.6f, ", camera.fx, camera.cx),
                    below = format("%.6f, %.6f, ", camera.fy, camera.cy);
  return text + format("image_width: %d\nimage_height: %d\n", camera.width, camera.height) +
         "camera_name: camera\n" + matrix("camera_matrix", 3, 3, f_c + "0, " + below + "0, 0, 1") +
         "distortion_model: " + camera.model->names.front() + "\n" +
         matrix("distortion_coefficients", 1, static_cast<int>(d.size()), coefficients) +
         matrix("rectification_matrix", 3, 3, "1, 0, 0, 0, 1, 0, 0, 0, 1") +
         matrix("projection_matrix", 3, 4, f_c + "0, 0, " + below + "0, 0, 0, 1, 0") +
         (camera.estimated ? "estimated_from_drives: true\n" : "") +
         (camera.k1_sigma > 0 ? format("k1_sigma: %.3g\n", camera.k1_sigma) : "") +
         (camera.readout_time > 0 ? format("readout_time: %.9g\n", camera.readout_time) : "");
}

}  // namespace gsv
