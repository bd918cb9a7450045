#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <cstdint>
#include <utility>

namespace ground_scale_vo {

void ImageRectifier::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  auto camera = std::make_shared<const CalibratedCamera>(info, topic, image_is_rectified_);
  switch (calibrations_.check(camera)) {
    case decltype(calibrations_)::Verdict::kSame:
      return;
    case decltype(calibrations_)::Verdict::kChanged:
      camera_ = std::move(camera);
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
