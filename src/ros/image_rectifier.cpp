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

ImageRectifier::ImageRectifier(bool image_is_rectified, const std::string& mask_file)
    : image_is_rectified_(image_is_rectified),
      mask_name_("parameter mask: " + mask_file),
      raw_mask_(readMask(mask_file, mask_name_)) {}

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
      camera_ = std::move(camera);
      mask_ = camera_->rectifyMask(raw_mask_);
      return;
    case decltype(calibrations_)::Verdict::kOther:
      break;
  }
  throw MessageError("two cameras publish on " + topic + ": camera_info alternates between " +
                     camera_->describe() + ", which is used, and " + camera->describe());
}

cv::Mat ImageRectifier::rectify(const sensor_msgs::Image& image) {
  const PinholeCamera& camera = camera_->camera();
  if (image.width != static_cast<std::uint32_t>(camera.width) ||
      image.height != static_cast<std::uint32_t>(camera.height)) {
    throw MessageError("the image is " + std::to_string(image.width) + " x " +
                       std::to_string(image.height) + ", but camera_info describes " +
                       std::to_string(camera.width) + " x " + std::to_string(camera.height));
  }
  return camera_->rectify(grey_converter_.convert(image));
}

}  // namespace ground_scale_vo
