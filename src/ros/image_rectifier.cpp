#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/encoded_image.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// name: for the OptionError.
cv::Mat readMask(const std::string& file, const std::string& name) {
  if (file.empty()) return {};
  std::error_code unused;
  if (!std::filesystem::is_regular_file(file, unused)) {  // opening a FIFO would block
    throw OptionError(name + " cannot be read");
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw OptionError(name + " cannot be read");
  const std::vector<char> bytes((std::istreambuf_iterator<char>(stream)), {});
  try {
    requireDecodable({bytes.data(), bytes.size()});
  } catch (const DataError& error) {
    throw OptionError(name + " " + error.what());
  }
  cv::Mat mask;
  try {
    mask = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    mask.release();
  }
  if (mask.empty()) throw OptionError(name + " cannot be decoded");
  return mask;
}

}  // namespace

ImageRectifier::ImageRectifier(bool image_is_rectified, const std::string& mask_file,
                               const std::string& camera_file)
    : image_is_rectified_(image_is_rectified),
      mask_name_("parameter mask: " + mask_file),
      raw_mask_(readMask(mask_file, mask_name_)) {
  if (!camera_file.empty()) readCamera(camera_file);
}

void ImageRectifier::readCamera(const std::string& file) {
  source_ = "parameter camera_file: " + file;
  std::shared_ptr<const CalibratedCamera> camera;
  try {
    const CameraCalibration calibration = readCameraFile(file);
    readout_time_ = calibration.readout_time;
    camera = std::make_shared<const CalibratedCamera>(calibration);
  } catch (const DataError& error) {  // it begins with the name of the file
    throw OptionError(std::string("parameter camera_file: ") + error.what());
  } catch (const OptionError& error) {
    throw OptionError(source_ + " cannot be used: " + error.what());
  }
  try {
    requireMask(raw_mask_, camera->camera(), mask_name_);
  } catch (const OptionError& error) {
    throw OptionError(std::string(error.what()) + " of " + source_);
  }
  use(std::move(camera));
}

void ImageRectifier::use(std::shared_ptr<const CalibratedCamera> camera) {
  camera_ = std::move(camera);
  mask_ = raw_mask_;
  if (!camera_->isDistorted()) return;
  const cv::Size size(camera_->camera().width, camera_->camera().height);
  mask_ = camera_->rectifyMask(mask_.empty() ? cv::Mat(size, CV_8U, cv::Scalar(255)) : mask_);
  if (raw_mask_.empty() && cv::countNonZero(mask_) == size.area()) mask_.release();
}

void ImageRectifier::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  auto camera = std::make_shared<const CalibratedCamera>(info, topic, image_is_rectified_);
  try {
    requireMask(raw_mask_, camera->camera(), mask_name_);
  } catch (const OptionError& error) {
    throw MessageError(std::string(error.what()) + " of camera_info on topic " + topic);
  }
  switch (calibrations_.check(camera)) {
    case decltype(calibrations_)::Verdict::kSame:
      return;
    case decltype(calibrations_)::Verdict::kChanged:
      use(std::move(camera));
      return;
    default:
      throw MessageError(calibrationError(topic));
  }
}

std::string ImageRectifier::calibrationError(const std::string& topic) const {
  if (!calibrations_.keepsChanging()) return {};
  const std::string used = camera_->describe(), other = (*calibrations_.other())->describe();
  return calibrations_.alternates()
             ? "two cameras publish on " + topic + ": camera_info alternates between " + used +
                   ", which is used, and " + other
             : "camera_info on topic " + topic + " keeps changing: " + used +
                   " is used until it settles, the last one is " + other +
                   "; publish one constant calibration";
}

cv::Mat ImageRectifier::rectify(const sensor_msgs::Image& image) {
  return camera_->rectify(toGrey(image));
}

cv::Mat ImageRectifier::given(const sensor_msgs::Image& image) {
  return camera_->given(toGrey(image));
}

/// Before rectification. Throws MessageError.
cv::Mat ImageRectifier::toGrey(const sensor_msgs::Image& image) {
  const PinholeCamera& camera = camera_->camera();
  if (image.width != static_cast<std::uint32_t>(camera.width) ||
      image.height != static_cast<std::uint32_t>(camera.height)) {
    throw MessageError("the image is " + std::to_string(image.width) + " x " +
                       std::to_string(image.height) + ", but " + source_ + " describes " +
                       std::to_string(camera.width) + " x " + std::to_string(camera.height));
  }
  return grey_converter_.convert(image);
}

}  // namespace ground_scale_vo
