#include "ground_scale_vo/self_calibrating_odometry.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <future>
#include <map>
#include <optional>
#include <utility>

namespace gsv {
namespace {

/// [frames] that the second odometry tracks before it replaces the first, and after which it is
/// abandoned when it has no map.
constexpr std::size_t kMinWarmUp = 8, kMaxWarmUp = 40;

/// The refined lens, or the calibration as it is given.
CameraCalibration calibrationBy(const LensEstimate& lens, const CameraCalibration& camera) {
  if (!lens.isEstimate()) return camera;
  CameraCalibration refined = calibrationOf(lens.lens);
  refined.is_part = camera.is_part;
  return refined;
}

}  // namespace

/// An odometry on images that are undistorted by one lens, and the numbers and the world frame in
/// which its frames are reported.
class LensOdometry {
 public:
  LensOdometry(const LensEstimate& lens, const CameraCalibration& camera,
               const VisualOdometry::Options& options, const cv::Mat& mask)
      : lens_(lens),
        undistortion_(calibrationBy(lens, camera), mask),
        vo_(undistortion_.camera(), options, undistortion_.mask()) {}

  const LensEstimate& lens() const { return lens_; }

  SelfCalibratingOdometry::Output process(const cv::Mat& image, std::int64_t stamp_ns) {
    SelfCalibratingOdometry::Output output;
    output.image = undistortion_.image(image);
    static_cast<VisualOdometry::Output&>(output) = vo_.process(output.image.grey, stamp_ns);
    if (output.frame.continuity == Continuity::kNewMap) map_start_.reset();
    report(&output);
    return output;
  }

  /// Its own last frame becomes the given one, of the odometry that it replaces. unit: length of
  /// its own unit. first_id: of features that were not reported yet.
  void continueFrom(const VoFrame& last, const VoFrame& own, double unit, std::uint64_t first_id) {
    first_sequence_ = last.sequence - own.sequence;
    first_map_ = last.map_id;
    first_id_ = first_id;
    map_start_ = last.map_start;
    unit_ = unit;
    Eigen::Isometry3d T_v_c = own.T_w_c;
    T_v_c.translation() *= unit_;
    T_w_v_ = last.T_w_c * T_v_c.inverse();
  }

  void report(SelfCalibratingOdometry::Output* output) const {
    VoFrame& frame = output->frame;
    if (map_start_) {
      frame.map_start = *map_start_;
      scaleLengths(unit_, &frame);
      frame.T_w_c = T_w_v_ * frame.T_w_c;
    }
    frame.sequence += first_sequence_;
    frame.map_id += first_map_;
    for (TrackedFeature& feature : frame.features) feature.id += first_id_;
    for (RejectedFeature& feature : output->rejected) feature.id += first_id_;
  }

 private:
  const LensEstimate lens_;
  const Undistortion undistortion_;
  VisualOdometry vo_;
  std::uint32_t first_sequence_ = 0, first_map_ = 0;
  std::uint64_t first_id_ = 0;
  /// While it is in its first map, if that continues the map of another odometry: T_w_v leads from
  /// its own world frame, in the reported unit, to the reported one.
  std::optional<MapStart> map_start_;
  double unit_ = 1;
  Eigen::Isometry3d T_w_v_ = Eigen::Isometry3d::Identity();
};

/// The odometry with a better lens, until it replaces the current one.
struct NextOdometry {
  std::unique_ptr<LensOdometry> odometry;
  std::map<std::int64_t, Eigen::Vector3d> positions_w;  ///< of the current one, by stamp
};

struct SelfCalibratingOdometry::Impl {
  Impl(const CameraCalibration& camera_in, const Options& options_in, const cv::Mat& mask_in)
      : options((requireInRanges(options_in), options_in)),
        camera(camera_in),
        mask(mask_in),
        current(
            std::make_unique<LensOdometry>(LensEstimate{lensOf(camera)}, camera, options.vo, mask)),
        refinement(current->lens().lens, options.refinement) {}

  void startNext(const cv::Mat& image, Output* output);
  void warmUp(Output other, Output* output);

  const Options options;
  const CameraCalibration camera;  ///< of the images as they come, as is the mask
  const cv::Mat mask;
  std::unique_ptr<LensOdometry> current;
  std::optional<NextOdometry> next;
  std::future<std::unique_ptr<LensOdometry>> prepared;  ///< becomes `next`
  LensRefinement refinement;
  std::optional<LensEstimate> better_lens;  ///< until `current` has it
  std::uint64_t first_unused_id = 0;
};

/// Prepares an odometry with the better lens, on another thread, as it takes longer than an image.
/// At a keyframe it becomes `next`, and the image is its first one.
void SelfCalibratingOdometry::Impl::startNext(const cv::Mat& image, Output* output) {
  if (!prepared.valid()) {
    prepared = std::async(std::launch::async, [lens = *better_lens, this] {
      return std::make_unique<LensOdometry>(lens, camera, options.vo, mask);
    });
  }
  if (!output->frame.keyframe) return;
  const bool is_ready = prepared.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  if (!is_ready && !options.refinement.deterministic) return;
  next = NextOdometry{prepared.get(), {}};
  warmUp(next->odometry->process(image, output->frame.stamp_ns), output);
}

/// other: the output of `next` for the same image. It replaces `current` when it has a map: *output
/// becomes its output then.
void SelfCalibratingOdometry::Impl::warmUp(Output other, Output* output) {
  const VoFrame& last = output->frame;
  auto& [odometry, positions_w] = *next;
  positions_w.emplace(last.stamp_ns, last.T_w_c.translation());
  const bool is_lost =
      last.status != VoStatus::kTracking || other.frame.continuity == Continuity::kNewMap;
  if (is_lost || positions_w.size() > kMaxWarmUp) return next.reset();
  if (positions_w.size() < kMinWarmUp || !other.frame.keyframe) return;
  // The origin of its world frame is the first frame of its map.
  const auto origin = positions_w.find(other.frame.map_start.stamp_ns);
  if (origin == positions_w.end()) return;
  const double length = (last.T_w_c.translation() - origin->second).norm();
  const double own_length = other.frame.T_w_c.translation().norm();
  if (!(own_length > 0 && length > 0)) return;
  odometry->continueFrom(last, other.frame, length / own_length, first_unused_id);
  odometry->report(&other);
  other.times.total = std::max(other.times.total, output->times.total);
  other.frame.continuity = Continuity::kOtherLens;
  *output = std::move(other);
  current = std::move(odometry);
  next.reset();
  better_lens.reset();
}

SelfCalibratingOdometry::SelfCalibratingOdometry(const CameraCalibration& camera,
                                                 const Options& options, const cv::Mat& mask)
    : impl_(std::make_unique<Impl>(camera, options, mask)) {}

SelfCalibratingOdometry::~SelfCalibratingOdometry() = default;

SelfCalibratingOdometry::Output SelfCalibratingOdometry::process(const cv::Mat& image,
                                                                 std::int64_t stamp_ns) {
  Impl& s = *impl_;
  // At the same time: the latency does not grow.
  std::future<Output> of_next;
  if (s.next) {
    of_next = std::async(std::launch::async, [&next = *s.next->odometry, &image, stamp_ns] {
      return next.process(image, stamp_ns);
    });
  }
  Output output = s.current->process(image, stamp_ns);
  if (!s.options.refine_camera) return output;
  for (const TrackedFeature& feature : output.frame.features) {
    s.first_unused_id = std::max(s.first_unused_id, feature.id + 1);
  }
  if (of_next.valid()) s.warmUp(of_next.get(), &output);
  // A zoomed camera is not the one whose lens is refined; warmUp() ends `next` with its map.
  if (output.frame.zoom != 1) return output;
  if (!s.better_lens) {
    const Lens& in_use = s.current->lens().lens;
    s.better_lens = s.refinement.add(withDistortedFeatures(output.frame, in_use), in_use);
  }
  if (s.better_lens && !s.next) s.startNext(image, &output);
  return output;
}

const LensEstimate& SelfCalibratingOdometry::lens() const { return impl_->current->lens(); }

const std::string& SelfCalibratingOdometry::lensContradiction() const {
  return impl_->refinement.contradiction();
}

std::string SelfCalibratingOdometry::finalLensContradiction() {
  return impl_->options.refine_camera ? impl_->refinement.finalContradiction(lens().lens) : "";
}

}  // namespace gsv
