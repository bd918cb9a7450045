#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "vo/alignment.hpp"
#include "vo/initialisation.hpp"
#include "vo/mapping.hpp"
#include "vo/motion.hpp"
#include "vo/recovery.hpp"
#include "vo/tracking.hpp"

namespace gsv {

/// The stages of VisualOdometry, and what they know of the drive. process() is the life of a frame.
class VisualOdometry::Impl {
 public:
  Impl(const PinholeCamera& camera, const Options& options, const cv::Mat& mask);

  Output process(const cv::Mat& image, std::int64_t stamp_ns);

 private:
  /// A frame while it is processed.
  struct Frame {
    std::int64_t stamp_ns = 0;
    ImagePyramid image;
    std::vector<Feature> found;     ///< in the image
    std::vector<Feature> outliers;  ///< found and removed
    bool keyframe = false;
    std::vector<StampedPose> start;  ///< see Output
    StageTimes times;
  };

  std::vector<Feature> initialise(Frame* frame);
  void trackByFlow(Frame* frame) const;
  void trackByMatching(Frame* frame) const;
  void startMap(std::vector<StampedPose> poses, Frame* frame);
  void startNextMap(Frame* frame);
  void restart(Frame* frame);

  std::vector<Feature> track(Frame* frame);
  void findFeatures(const RelocalisedPose* relocalised, Frame* frame);
  bool localise(const Eigen::Isometry3d& predicted_T_w_c, Frame* frame);
  void rejectOutliers(const Eigen::Isometry3d& T_c_previous, const std::vector<bool>& inlier,
                      Frame* frame);
  std::optional<double> zoomOf(const Frame& frame) const;
  void startZoomedMap(double zoom, Frame* frame);
  bool relocalise(Frame* frame);
  bool trackFrom(const RelocalisedPose& pose, Frame* frame);
  void rejectInconsistent(const Eigen::Isometry3d& T_w_c, Frame* frame) const;
  void addKeyframe(Frame* frame);

  Vector6d readoutMotion(const MotionModel& moved) const {
    return options_.readout_time * moved.velocity();
  }
  void shiftToStamp(const MotionModel& moved, std::vector<Feature>* features) const;
  VoFrame toVoFrame(const Frame& frame, const std::vector<Feature>& visible) const;

  const Options options_;
  const PinholeCamera camera_;
  const cv::Mat mask_;

  Tracking tracking_;
  MapInitialisation initialisation_;
  ReferenceAlignment reference_alignment_;
  Mapping mapping_;
  MotionModel motion_;
  Matrix6d pose_covariance_ = Matrix6d::Zero();  ///< see VoFrame

  VoStatus status_ = VoStatus::kInitialising;
  std::uint32_t map_id_ = 0;
  Continuity continuity_ = Continuity::kNewTrajectory;  ///< of the frame that is processed
  std::uint32_t sequence_ = 0;                          ///< of the current image
  MapStart map_start_;
  /// From the last frame with a pose, or from the first image, to the first frame of the next map.
  RelativeRotation rotation_to_start_{Eigen::Matrix3d::Identity(), 0};
  Interruption interruption_;
  double zoom_ = 1;  ///< see VoFrame
};

}  // namespace gsv
