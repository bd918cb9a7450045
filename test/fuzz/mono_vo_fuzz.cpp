// The processing of MonoVo: camera_info and image in, vo/frame and its other topics out. An input
// is two bytes for image_is_rectified, then messages, each with a first byte `kind`: even, the next
// image of a drive, unchanged; odd, an image or (kind % 8 == 3) a camera_info, with random changes,
// and with kind % 16 >= 12 at an irregular stamp.

#include <algorithm>
#include <functional>
#include <memory>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"
#include "input/camera_input.hpp"
#include "message_checks.hpp"
#include "ros/odometry_output.hpp"
#include "ros/visuals.hpp"

namespace gsv::fuzz {
namespace {

/// Processes messages as the nodelet does.
class MonoVo {
 public:
  explicit MonoVo(bool image_is_rectified) : input_(image_is_rectified) {}

  void onCameraInfo(const sensor_msgs::CameraInfo& info) {
    if (info.width > 1000 || info.height > 1000) return;  // too much memory for a test
    try {
      input_.setCameraInfo(fromMsg(info), "camera_info");
    } catch (const DataError&) {
    }
  }

  void onImage(const sensor_msgs::Image& image) {
    const auto camera = input_.camera();
    if (!camera) return;
    cv::Mat grey;
    try {
      grey = input_.grey(pixelsOf(fromMsg(image)), image.encoding).clone();  // outlives the message
    } catch (const DataError&) {
      return;
    }
    const StampFilter::Process process = [=, header = image.header](bool clock_jumped_back) {
      if (!odometry_ || camera_ != camera || clock_jumped_back) {
        camera_ = camera;
        odometry_ =
            std::make_unique<SelfCalibratingOdometry>(*camera, SelfCalibratingOdometry::Options());
      }
      const auto output = odometry_->process(grey, toNanoseconds(header.stamp));
      check(*toMsg(output.frame, header));
      check(*toOdometryMsg(output.frame, header, "vo_world"));
      toPointCloud(output.frame, header, 1);
      paintTracks(output.image, output.frame, &last_, output.rejected, header);
      last_ = output.frame;
    };
    filter_.add(toNanoseconds(image.header.stamp), process);
  }

 private:
  CameraInput input_;
  StampFilter filter_{1.0, [](const std::string&) {}};
  std::shared_ptr<const CameraCalibration> camera_;
  std::unique_ptr<SelfCalibratingOdometry> odometry_;
  VoFrame last_;
};

/// Changes one property of the message.
void spoil(sensor_msgs::Image* image, Input* input) {
  static const std::string kEncodings[] = {"mono8",  "mono16",  "bgr8",    "rgba8",  "bayer_rggb8",
                                           "32FC1",  "64FC4",   "8UC9999", "16UC-1", "jpeg",
                                           "yuv422", "64FC512", ""};
  constexpr std::uint32_t kMaxBytes = 1u << 22;
  std::uint32_t* const sizes[] = {&image->width, &image->height, &image->step};
  switch (input->below(4)) {
    case 0:  // another encoding, perhaps with data as long as step and height say
      image->encoding = input->below(4) > 0 ? input->oneOf(kEncodings) : input->text(16);
      if (input->below(2)) break;
      image->step = image->width * (1 + static_cast<std::uint32_t>(input->below(8)));
      image->data.resize(std::min(image->step * image->height, kMaxBytes));
      break;
    case 1:
      *input->oneOf(sizes) = input->take<std::uint32_t>() >> (4 * input->below(8));
      break;
    case 2:
      image->data.resize(input->below(image->data.size() + 1));
      break;
    default:
      image->is_bigendian = input->take<std::uint8_t>();
  }
}

void spoil(sensor_msgs::CameraInfo* info, Input* input) {
  static const std::string kModels[] = {"plumb_bob", "rational_polynomial", "fisheye", ""};
  switch (input->below(3)) {
    case 0:
      (input->below(2) ? input->oneOf(info->K) : input->oneOf(info->P)) = input->number();
      input->oneOf(info->R) = input->number();
      break;
    case 1:
      info->distortion_model = input->oneOf(kModels);
      info->D.resize(input->below(16));
      for (double& k : info->D) k = input->below(3) ? 0.01 : input->number();
      break;
    default:
      (input->below(2) ? info->width : info->height) = input->take<std::uint32_t>();
      info->binning_x = input->take<std::uint8_t>();
      if (input->below(2)) info->P.fill(0);
  }
}

}  // namespace

Plan plan() { return {600, {std::string(20, '\0'), mixedMessages(3)}}; }

void run(const std::string& bytes) {
  constexpr std::int64_t kLatest = 4294967295ll * 1000000000;  // of ros::Time [ns]
  constexpr std::int64_t kSteps_ms[] = {0, -50, -2000, 5000, 33, 1000000, -1000000000, 2147483};
  constexpr std::size_t kMaxMessages = 40;
  Input input(bytes);
  MonoVo mono_vo(input.below(4) == 1);
  mono_vo.onCameraInfo(toCameraInfo(smallDrive().camera));
  std::int64_t stamp_ns = smallDrive().stamps_ns.front();
  for (std::size_t k = 0; k < kMaxMessages && !input.empty(); ++k) {
    const auto kind = input.take<std::uint8_t>();
    const bool is_regular = kind % 2 == 0 || kind % 16 < 12;
    stamp_ns += (is_regular ? 100 : input.oneOf(kSteps_ms)) * 1000000;
    stamp_ns = std::clamp<std::int64_t>(stamp_ns, 0, kLatest);
    if (kind % 8 == 3) {
      sensor_msgs::CameraInfo info = toCameraInfo(smallDrive().camera);
      for (std::size_t n = input.below(3); n > 0; --n) spoil(&info, &input);
      mono_vo.onCameraInfo(info);
    } else {
      std_msgs::Header header;
      header.frame_id = "camera";
      header.stamp = fromNanoseconds(stamp_ns);
      const auto& images = smallDrive().images;
      sensor_msgs::Image image = *toMsg(images[k % images.size()], "mono8", header);
      for (std::size_t n = kind % 2 * input.below(4); n > 0; --n) spoil(&image, &input);
      mono_vo.onImage(image);
    }
  }
}

}  // namespace gsv::fuzz
