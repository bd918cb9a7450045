// The processing of MonoVo: camera_info and image in, vo/frame and its other topics out. An input
// is two bytes for image_is_rectified, then messages, each with a first byte `kind`: even, the next
// image of a drive, unchanged; odd, an image or (kind % 8 == 3) a camera_info, with random changes
// or (from 240 on) of random bytes, and with kind % 16 >= 12 at an irregular stamp.

#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include <memory>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/image_rectifier.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/ros/visuals.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "message_checks.hpp"
#include "small_drive.hpp"

namespace ground_scale_vo::fuzz {
namespace {

/// Larger images need too much memory for a test.
constexpr std::uint32_t kMaxSide = 1000;

/// Processes messages as the nodelet does.
class MonoVo {
 public:
  explicit MonoVo(bool image_is_rectified) : rectifier_(image_is_rectified) {}

  void onCameraInfo(const sensor_msgs::CameraInfo& info) {
    if (info.width > kMaxSide || info.height > kMaxSide) return;
    try {
      rectifier_.setCameraInfo(info, "camera_info");
    } catch (const MessageError&) {
    }
  }

  void onImage(const sensor_msgs::Image& image) {
    const auto camera = rectifier_.camera();
    if (!camera) return;
    cv::Mat rectified;
    try {
      rectified = rectifier_.rectify(image);
    } catch (const MessageError&) {
      return;
    }
    const Rectified received{image.header, rectified.clone(), camera};  // outlives the message
    for (const auto& accepted : filter_.filter(image.header.stamp, received)) {
      process(accepted.message, accepted.clock_jumped_back);
    }
  }

 private:
  struct Rectified {
    std_msgs::Header header;
    cv::Mat grey;
    std::shared_ptr<const CalibratedCamera> camera;
  };

  void process(const Rectified& image, bool clock_jumped_back) {
    if (!odometry_ || camera_ != image.camera || clock_jumped_back) {
      camera_ = image.camera;
      odometry_ = std::make_unique<VisualOdometry>(camera_->camera(), VisualOdometry::Options());
      painter_ = TrackPainter();
    }
    const auto output = odometry_->process(image.grey, toNanoseconds(image.header.stamp));
    check(*toMsg(output.frame, image.header));
    check(*toOdometryMsg(output.frame, image.header, "vo_world"));
    check(*toPointCloud(output.frame, image.header));
    painter_.paint(image.grey, output.frame, output.rejected, image.header);
  }

  ImageRectifier rectifier_;
  StampFilter<Rectified> filter_{1.0, [](const std::string&) {}};
  std::shared_ptr<const CalibratedCamera> camera_;
  std::unique_ptr<VisualOdometry> odometry_;
  TrackPainter painter_;
};

sensor_msgs::Image imageMessage(std::size_t i, std::int64_t stamp_ns) {
  const cv::Mat& pixels = smallDrive().images[i % smallDrive().images.size()];
  sensor_msgs::Image image;
  image.header.frame_id = "camera";
  image.header.stamp = fromNanoseconds(stamp_ns);
  image.width = static_cast<std::uint32_t>(pixels.cols);
  image.height = static_cast<std::uint32_t>(pixels.rows);
  image.step = image.width;
  image.encoding = sensor_msgs::image_encodings::MONO8;
  image.data.assign(pixels.datastart, pixels.dataend);
  return image;
}

/// Changes one property of the message.
void spoil(sensor_msgs::Image* image, Input* input) {
  namespace enc = sensor_msgs::image_encodings;
  static const std::string kEncodings[] = {enc::MONO8,
                                           enc::MONO16,
                                           enc::BGR8,
                                           enc::RGB8,
                                           enc::BGRA8,
                                           enc::RGBA8,
                                           enc::RGB16,
                                           enc::BAYER_RGGB8,
                                           enc::BAYER_GBRG16,
                                           enc::YUV422,
                                           enc::TYPE_8UC1,
                                           enc::TYPE_16UC1,
                                           enc::TYPE_32FC1,
                                           enc::TYPE_64FC4,
                                           enc::TYPE_8SC3,
                                           "8UC9999999999",
                                           "16UC-1",
                                           "32FC",
                                           "",
                                           "jpeg",
                                           "8UC0",
                                           "64FC512",
                                           "bayer_rggb32"};
  switch (input->below(9)) {
    case 0:
      image->encoding = kEncodings[input->below(std::size(kEncodings))];
      break;
    case 1: {  // another encoding, with data as long as step and height say
      image->encoding = kEncodings[input->below(std::size(kEncodings))];
      image->step = image->width * (1 + static_cast<std::uint32_t>(input->below(8)));
      image->data.resize(image->step * image->height, input->take<std::uint8_t>());
      break;
    }
    case 2:
      image->encoding = input->text(16);
      break;
    case 3:
      image->width = input->below(2) ? input->take<std::uint32_t>()
                                     : static_cast<std::uint32_t>(input->below(500));
      break;
    case 4:
      image->height = input->below(2) ? input->take<std::uint32_t>()
                                      : static_cast<std::uint32_t>(input->below(200));
      break;
    case 5:
      image->step = input->take<std::uint32_t>();
      break;
    case 6:
      image->data.resize(input->below(100000));
      break;
    case 7: {  // a part of the pixels gets one value
      const std::size_t begin = input->below(image->data.size() + 1);
      const std::size_t end = begin + input->below(image->data.size() - begin + 1);
      const auto value = input->take<std::uint8_t>();
      std::fill(image->data.begin() + static_cast<std::ptrdiff_t>(begin),
                image->data.begin() + static_cast<std::ptrdiff_t>(end), value);
      break;
    }
    default:
      image->is_bigendian = input->take<std::uint8_t>();
  }
}

/// Changes one property of the message.
void spoil(sensor_msgs::CameraInfo* info, Input* input) {
  namespace models = sensor_msgs::distortion_models;
  static const std::string kModels[] = {
      models::PLUMB_BOB, models::RATIONAL_POLYNOMIAL, models::EQUIDISTANT, "fisheye", "",
      "thin_prism"};
  switch (input->below(9)) {
    case 0:
      info->K[input->below(9)] = input->number();
      break;
    case 1:
      info->P[input->below(12)] = input->number();
      break;
    case 2:
      info->D.resize(input->below(16));
      for (double& k : info->D) k = input->below(3) ? 0.01 : input->number();
      break;
    case 3:
      info->distortion_model = kModels[input->below(std::size(kModels))];
      break;
    case 4:
      info->width = input->take<std::uint32_t>();
      break;
    case 5:
      info->height = input->take<std::uint32_t>();
      break;
    case 6:
      info->K.fill(0);
      if (input->below(2)) info->P.fill(0);
      break;
    case 7:
      info->binning_x = input->take<std::uint8_t>();
      info->roi.width = input->take<std::uint8_t>();
      break;
    default:
      info->R[input->below(9)] = input->number();
  }
}

/// Deserialises random bytes, as a faulty publisher could send them. False if that fails.
template <typename Message>
bool deserialise(Message* message, Input* input) {
  std::vector<std::uint8_t> bytes(1 + input->below(400));  // roscpp never hands over nullptr
  for (std::uint8_t& byte : bytes) byte = input->take<std::uint8_t>();
  try {
    ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    ros::serialization::deserialize(stream, *message);
  } catch (const std::exception&) {
    return false;
  }
  return true;
}

/// Time to the stamp of the next message [ns].
std::int64_t stampStep(Input* input) {
  constexpr std::int64_t kMs = 1000000;
  constexpr std::int64_t kSteps[] = {0,
                                     1,
                                     -50 * kMs,
                                     -2000 * kMs,
                                     5000 * kMs,
                                     33 * kMs,
                                     1000000 * kMs,
                                     -1000000000 * kMs,
                                     200 * kMs,
                                     400000 * kMs,
                                     2147483 * kMs,
                                     50 * kMs};
  return kSteps[input->below(std::size(kSteps))];
}

}  // namespace

Plan plan() {
  std::vector<std::string> corpus{std::string(20, '\0'), std::string(12, '\0')};
  std::string mixed;
  for (int i = 0; i < 40; ++i) mixed += {static_cast<char>(i % 3), static_cast<char>(7 * i)};
  corpus.push_back(mixed);
  return {600, corpus};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ground_scale_vo;
  using namespace ground_scale_vo::fuzz;
  constexpr std::int64_t kLatest = 4294967295ll * 1000000000;  // of ros::Time [ns]
  constexpr int kMaxMessages = 40;
  Input input(data, size);
  MonoVo mono_vo(input.below(4) == 1);
  mono_vo.onCameraInfo(toCameraInfo(smallDrive().camera));
  std::int64_t stamp_ns = smallDrive().stamps_ns.front();
  std::size_t next = 0;
  for (int k = 0; k < kMaxMessages && !input.empty(); ++k) {
    const auto kind = input.take<std::uint8_t>();
    stamp_ns += kind % 2 == 0 || kind % 16 < 12 ? 100000000 : stampStep(&input);
    stamp_ns = std::clamp<std::int64_t>(stamp_ns, 0, kLatest);
    if (kind % 2 == 0) {
      mono_vo.onImage(imageMessage(next++, stamp_ns));
    } else if (kind % 8 == 3) {
      sensor_msgs::CameraInfo info = toCameraInfo(smallDrive().camera);
      if (kind >= 240) {
        if (!deserialise(&info, &input)) continue;
      } else {
        for (std::size_t n = input.below(3); n > 0; --n) spoil(&info, &input);
      }
      mono_vo.onCameraInfo(info);
    } else {
      sensor_msgs::Image image = imageMessage(next++, stamp_ns);
      if (kind >= 240) {
        if (!deserialise(&image, &input)) continue;
      } else {
        for (std::size_t n = input.below(3) + 1; n > 0; --n) spoil(&image, &input);
      }
      mono_vo.onImage(image);
    }
  }
  return 0;
}
