// The processing of ScaleRecovery: vo/frame of any odometry, the image and speeds in, its topics
// out. An input is a list of frames: an even byte is the next frame of a drive, unchanged, an odd
// one a frame with random changes.

#include <functional>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "message_checks.hpp"
#include "ros/odometry_output.hpp"
#include "ros/visuals.hpp"

namespace gsv::fuzz {
namespace {

/// The frames of MonoVo for the drive.
const std::vector<VoFrameMsg>& frames() {
  static const std::vector<VoFrameMsg> kFrames = [] {
    const SmallDrive& drive = smallDrive();
    VisualOdometry odometry(drive.camera, VisualOdometry::Options());
    std::vector<VoFrameMsg> messages;
    for (std::size_t i = 0; i < drive.images.size(); ++i) {
      const VoFrame frame = odometry.process(drive.images[i], drive.stamps_ns[i]).frame;
      std_msgs::Header header;
      header.stamp = fromNanoseconds(frame.stamp_ns);
      header.frame_id = "camera";
      messages.push_back(*toMsg(frame, header));
    }
    require(messages.back().status == VoFrameMsg::TRACKING, "the drive can be tracked");
    return messages;
  }();
  return kFrames;
}

/// Processes messages as the nodelet does.
class Scale {
 public:
  explicit Scale(const ScaleRecovery::Options& options) : recovery_(options) {}

  void onSpeed(const SpeedSample& speed) { recovery_.addSpeed(speed); }

  void onFrame(const VoFrameMsg& message, const cv::Mat& image) {
    VoFrame frame;
    try {
      frame = fromMsg(message);
    } catch (const DataError&) {
      return;
    }
    const StampFilter::Process process = [=,
                                          header = message.header](bool clock_jumped_back) mutable {
      if (clock_jumped_back) frame.continuity = Continuity::kNewTrajectory;
      const bool fits = image.cols == frame.camera.width && image.rows == frame.camera.height;
      const auto output = recovery_.process(frame, fits ? image : cv::Mat());
      check(*toMsg(output.scale, frame.map_id, header));
      for (const auto& p : output.ground_points_c) require(p.allFinite(), "points are finite");
      if (output.pose) {
        require(output.scale.status != ScaleStatus::kUnknown, "nothing metric without a scale");
        const auto frames = TfFrames::ofCamera("odom", "camera");
        check(*toOdometryMsg(*output.pose, frames, header.stamp));
        require(std::isfinite(output.pose->distance), "the distance is finite");
      }
      if (!hasGroundPlane(output.scale)) return;
      require(isPose(toPlaneMarker(output.scale, header)->pose), "the pose of the marker is valid");
    };
    filter_.add(toNanoseconds(message.header.stamp), process);
  }

 private:
  ScaleRecovery recovery_;
  StampFilter filter_{1.0, [](const std::string&) {}};
};

/// Changes one property of the message, or the geometry of all features.
void spoil(VoFrameMsg* frame, Input* input) {
  std::vector<float>* const arrays[] = {&frame->u, &frame->v, &frame->x,
                                        &frame->y, &frame->z, &frame->depth_sigma};
  std::vector<float>& array = *input->oneOf(arrays);
  const auto value = static_cast<float>(input->number());
  auto& position = frame->pose.position;
  auto& orientation = frame->pose.orientation;
  double* const numbers[] = {&frame->fx,  &frame->fy,  &frame->cx,     &position.x,
                             &position.y, &position.z, &orientation.x, &orientation.w};
  switch (input->below(6)) {
    case 0:  // e.g. points in a plane or behind the camera
      std::fill(array.begin(), array.end(), value);
      break;
    case 1:  // one coordinate of all features scaled or mirrored
      for (float& element : array) element *= value;
      break;
    case 2:  // arrays of different lengths
      array.resize(input->below(40));
      break;
    case 3:  // few features
      frame->id.resize(std::min(frame->id.size(), input->below(12)));
      frame->age.resize(frame->id.size());
      for (std::vector<float>* all : arrays) all->resize(frame->id.size());
      break;
    case 4:
      *input->oneOf(numbers) = input->number();
      if (!array.empty()) input->oneOf(array) = value;
      break;
    default:
      frame->status = input->take<std::uint8_t>();
      frame->map_id = input->take<std::uint32_t>();
      (input->below(2) ? frame->width : frame->height) = input->take<std::uint32_t>();
  }
}

}  // namespace

Plan plan() { return {1500, {std::string(24, '\0'), std::string(24, '\2'), mixedMessages(5)}}; }

void run(const std::string& bytes) {
  constexpr std::size_t kMaxMessages = 40;
  Input input(bytes);
  const auto flags = input.take<std::uint8_t>();
  ScaleRecovery::Options options;
  options.gpa.fit.homogeneous = options.gpe.frame_pitch_test = flags % 8 == 1;
  options.use_speed = flags / 8 % 2 == 1 && flags % 8 != 1;
  options.camera_height = options.use_speed && flags / 16 % 2 == 1 ? 0 : 1.65;
  options.camera_height_sigma = options.use_speed && flags / 32 % 2 == 1 ? 0.1 : 0;
  Scale scale(options);
  const bool with_images = flags % 2 == 0;
  for (std::size_t k = 0; k < kMaxMessages && !input.empty(); ++k) {
    const auto kind = input.take<std::uint8_t>();
    const std::size_t i = k % frames().size();
    VoFrameMsg frame = frames()[i];
    for (std::size_t n = kind % 2 * (1 + input.below(3)); n > 0; --n) spoil(&frame, &input);
    if (options.use_speed) {
      const bool spoilt = kind % 4 > 1;
      const std::int64_t late_ns = spoilt ? static_cast<std::int64_t>(input.below(1000)) : 0;
      scale.onSpeed({toNanoseconds(frame.header.stamp) - late_ns * 1000000,
                     spoilt ? input.number() : 9.0, spoilt ? input.number() : 0.0});
    }
    scale.onFrame(frame, with_images ? smallDrive().images[i] : cv::Mat());
  }
}

}  // namespace gsv::fuzz
