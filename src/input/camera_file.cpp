#include "ground_scale_vo/input/camera_file.hpp"

#include <cmath>
#include <fstream>
#include <iterator>
#include <locale>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <system_error>
#include <tuple>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/image_limits.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::size_t kMaxBytes = 1 << 20;
constexpr double kMaxReadoutTime = 0.2;  // [s], that of the option odometry/readout_time

/// The few constructs of YAML that camera_calibration writes: `key: value` and, below a key,
/// `data: [numbers]`, possibly over several lines.
class CameraYaml {
 public:
  explicit CameraYaml(const std::filesystem::path& file) : name_(file.string()) {
    std::error_code unused;
    if (!std::filesystem::is_regular_file(file, unused)) fail("no such file");
    std::ifstream stream(file, std::ios::binary);
    text_ = "\n" + std::string(std::istreambuf_iterator<char>(stream), {});
    if (!stream || text_.size() > kMaxBytes) fail("cannot be read");
  }

  [[noreturn]] void fail(const std::string& what) const { throw DataError(name_ + ": " + what); }

  std::string word(const std::string& key) const {
    std::istringstream stream(text_.substr(after(key)));
    std::string result;
    stream >> result;
    const bool quoted =
        result.size() > 1 && (result[0] == '"' || result[0] == '\'') && result.back() == result[0];
    return quoted ? result.substr(1, result.size() - 2) : result;
  }

  bool has(const std::string& key) const {
    return text_.find("\n" + key + ":") != std::string::npos;
  }

  double number(const std::string& key) const { return numbers(key, word(key), 1).front(); }

  std::vector<double> matrix(const std::string& key, std::size_t count) const {
    const std::size_t data = text_.find("data:", after(key));
    const std::size_t open = text_.find('[', data);
    const std::size_t close = text_.find(']', open);
    if (data == std::string::npos || close == std::string::npos) fail(key + " has no data");
    std::string list = text_.substr(open + 1, close - open - 1);
    for (char& c : list) c = c == ',' ? ' ' : c;
    return numbers(key, list, count);
  }

 private:
  std::size_t after(const std::string& key) const {
    const std::size_t at = text_.find("\n" + key + ":");
    if (at == std::string::npos) fail("has no " + key + ", which camera_calibration writes");
    return at + key.size() + 2;
  }

  std::vector<double> numbers(const std::string& key, const std::string& list,
                              std::size_t count) const {
    std::istringstream stream(list);
    stream.imbue(std::locale::classic());
    std::vector<double> result;
    for (double value; stream >> value;) result.push_back(value);
    if (!stream.eof() || result.size() != count) {
      fail(key + " is not " + std::to_string(count) + " numbers");
    }
    for (const double value : result) {
      if (!std::isfinite(value)) fail(key + " is not finite");
    }
    return result;
  }

  std::string name_, text_;
};

}  // namespace

CameraCalibration readCameraFile(const std::filesystem::path& file) {
  const CameraYaml yaml(file);
  CameraCalibration camera;
  const double width = yaml.number("image_width"), height = yaml.number("image_height");
  if (!(width >= 1 && height >= 1 && width <= kMaxImageSide && height <= kMaxImageSide)) {
    yaml.fail("has an implausible image size");
  }
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  const std::vector<double> K = yaml.matrix("camera_matrix", 9);
  camera.fx = K[0];
  camera.fy = K[4];
  camera.cx = K[2];
  camera.cy = K[5];
  if (!(camera.fx > 0 && camera.fy > 0) || K[1] != 0 || K[3] != 0 || K[6] != 0 || K[7] != 0 ||
      K[8] != 1) {
    yaml.fail("camera_matrix is not of the form fx 0 cx, 0 fy cy, 0 0 1");
  }
  if (const std::string model = yaml.word("distortion_model"); model != "plumb_bob") {
    yaml.fail("the distortion model is " + model + "; supported is plumb_bob");
  }
  const std::vector<double> D = yaml.matrix("distortion_coefficients", 5);
  std::copy(D.begin(), D.end(), camera.distortion.begin());
  camera.estimated =
      yaml.has("estimated_from_drives") && yaml.word("estimated_from_drives") == "true";
  if (yaml.has("readout_time")) camera.readout_time = yaml.number("readout_time");
  if (!(camera.readout_time >= 0 && camera.readout_time <= kMaxReadoutTime)) {
    yaml.fail("readout_time is not in [0, 0.2] s");
  }
  return camera;
}

std::string cameraYaml(const CameraCalibration& camera, const std::string& comment) {
  std::string text;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) text += "# " + line + "\n";
  const auto& d = camera.distortion;
  return text +
         format("image_width: %d\nimage_height: %d\ncamera_name: camera\n", camera.width,
                camera.height) +
         format(
             "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [%.6f, 0, %.6f, 0, %.6f, %.6f, 0, 0, "
             "1]\n",
             camera.fx, camera.cx, camera.fy, camera.cy) +
         format(
             "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
             "  data: [%.8f, %.8f, %.8f, %.8f, %.8f]\n",
             d[0], d[1], d[2], d[3], d[4]) +
         "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n" +
         format(
             "projection_matrix:\n  rows: 3\n  cols: 4\n"
             "  data: [%.6f, 0, %.6f, 0, 0, %.6f, %.6f, 0, 0, 0, 1, 0]\n",
             camera.fx, camera.cx, camera.fy, camera.cy) +
         (camera.estimated ? "estimated_from_drives: true\n" : "") +
         (camera.readout_time > 0 ? format("readout_time: %.9g\n", camera.readout_time) : "");
}

bool operator==(const CameraCalibration& a, const CameraCalibration& b) {
  const auto values = [](const CameraCalibration& c) {
    return std::tie(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion, c.estimated,
                    c.readout_time);
  };
  return values(a) == values(b);
}

Undistortion::Undistortion(const CameraCalibration& camera) : size_(camera.width, camera.height) {
  bool distorted = false;
  for (const double d : camera.distortion) distorted = distorted || d != 0;
  if (!distorted) return;
  const cv::Matx33d K(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const std::vector<double> D(camera.distortion.begin(), camera.distortion.end());
  cv::initUndistortRectifyMap(K, D, cv::noArray(), K, size_, CV_16SC2, map1_, map2_);
  const cv::Mat mask = image(cv::Mat(size_, CV_8U, cv::Scalar(255))) == 255;
  if (cv::countNonZero(mask) < size_.area()) mask_ = mask;
}

cv::Mat Undistortion::mask(const cv::Mat& given) const {
  if (given.empty()) return mask_;
  const cv::Mat undistorted = image(given != 0) == 255;
  return mask_.empty() ? undistorted : cv::Mat(undistorted & mask_);
}

cv::Mat Undistortion::image(const cv::Mat& image) const {
  if (image.size() != size_) {
    throw DataError("the images are " + std::to_string(image.cols) + "x" +
                    std::to_string(image.rows) + ", the calibration is of " +
                    std::to_string(size_.width) + "x" + std::to_string(size_.height));
  }
  if (map1_.empty()) return image;
  cv::Mat result;
  cv::remap(image, result, map1_, map2_, cv::INTER_LINEAR);
  return result;
}

}  // namespace ground_scale_vo
