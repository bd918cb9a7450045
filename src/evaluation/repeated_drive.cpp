#include "ground_scale_vo/evaluation/repeated_drive.hpp"

#include <cstdlib>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {

RepeatedDrive::RepeatedDrive(const std::string& folder, int passes, double image_scale)
    : sequence_(folder), image_scale_(image_scale) {
  const std::size_t n = sequence_.size();
  for (std::size_t i = 0; i < n; ++i) append(i);
  for (int pass = 1; pass < passes; ++pass) {
    const bool backwards = pass % 2 == 1;
    for (std::size_t k = 1; k < n; ++k) append(backwards ? n - 1 - k : k);
  }
  camera_ = sequence_.camera();
  const cv::Size size = image(0).size();
  const double x = static_cast<double>(size.width) / camera_.width;
  const double y = static_cast<double>(size.height) / camera_.height;
  camera_ = {size.width, size.height, x * camera_.fx, y * camera_.fy,
             // (0, 0) is the centre of a pixel
             x * (camera_.cx + 0.5) - 0.5, y * (camera_.cy + 0.5) - 0.5};
}

cv::Mat RepeatedDrive::image(std::size_t i) const {
  cv::Mat image = sequence_.image(order_[i]);
  if (image_scale_ != 1) {
    cv::resize(image, image, {}, image_scale_, image_scale_,
               image_scale_ < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  }
  return image;
}

void RepeatedDrive::append(std::size_t image) {
  const std::int64_t step =
      order_.empty() ? sequence_.stampNs(0)
                     : std::abs(sequence_.stampNs(image) - sequence_.stampNs(order_.back()));
  stamps_ns_.push_back(order_.empty() ? step : stamps_ns_.back() + step);
  order_.push_back(image);
}

}  // namespace ground_scale_vo
