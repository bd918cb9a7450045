#include "ground_scale_vo/ros/camera_stream.hpp"

#include <cmath>
#include <cstdint>
#include <utility>

namespace ground_scale_vo {
namespace {

constexpr double kSamePx = 0.01;

}  // namespace

CalibratedCamera::CalibratedCamera(Calibration calibration, const std::string& topic)
    : calibration_(std::move(calibration)), rectifier_(toRectifier(calibration_, topic)) {}

cv::Mat CalibratedCamera::rectified(const sensor_msgs::Image& image, GreyConverter* grey) const {
  const PinholeCamera& raw = calibration_.raw;
  if (image.width != static_cast<std::uint32_t>(raw.width) ||
      image.height != static_cast<std::uint32_t>(raw.height)) {
    throw MessageError("the image is " + std::to_string(image.width) + " x " +
                       std::to_string(image.height) + ", camera_info says " +
                       std::to_string(raw.width) + " x " + std::to_string(raw.height));
  }
  return rectifier_.rectify(grey->convert(image));
}

bool CalibratedCamera::isCameraOf(const PinholeCamera& other) const {
  const PinholeCamera& own = camera();
  const auto same = [](double a, double b) { return std::abs(a - b) <= kSamePx; };
  return own.width == other.width && own.height == other.height && same(own.fx, other.fx) &&
         same(own.fy, other.fy) && same(own.cx, other.cx) && same(own.cy, other.cy);
}

void CameraStream::accept(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  Calibration calibration = toCalibration(info, topic, image_is_rectified_);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (camera_ && camera_->calibration() == calibration) return;
  }
  auto camera = std::make_shared<const CalibratedCamera>(std::move(calibration), topic);
  const std::lock_guard<std::mutex> lock(mutex_);
  camera_ = std::move(camera);
}

std::shared_ptr<const CalibratedCamera> CameraStream::camera() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return camera_;
}

}  // namespace ground_scale_vo
