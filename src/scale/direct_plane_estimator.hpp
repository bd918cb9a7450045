#pragma once

#include <Eigen/Geometry>
#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/patch_matcher.hpp"
#include "scale/road.hpp"

namespace gsv {

/// Direct (photometric) estimate of the ground plane m = n / h from the intensities of the road:
/// patches of the lane are aligned with two earlier images along the epipolar lines
/// (docs/explanation/how_it_works.md). It needs image texture but no corners and no map points.
/// Regions of a given mask are used in no image. Not thread safe.
class DirectPlaneEstimator {
 public:
  using Options = DirectPlaneEstimatorOptions;

  explicit DirectPlaneEstimator(const Options& options) : options_(options) {}

  /// frame: tracking. image: rectified, 8-bit grey, of the camera's size. height: predicted [VO
  /// units]; 0: not known, the median of the features in the lane replaces it. path: its newest
  /// pose is the one of the frame. mask: as for ScaleRecovery::process(). road: of this frame, for
  /// CameraPath::keepRoad(). The height of the result belongs to the pose of the path that is
  /// nearest to the lane region. Status: kMeasured, kNoPlane, or kStandstill (no reference image at
  /// a sufficient distance, or neither a height nor a feature in the lane).
  PlaneMeasurement estimate(const VoFrame& frame, const cv::Mat& image, double height,
                            const CameraPath& path, const cv::Mat& mask, RoadImage* road);

 private:
  /// Unknowns of both reference images: m (3), the curvature of the road along the path, across it
  /// (crown) and its twist (3), the radial distortion of the images (k1, k2); and of each: the
  /// error of its relative pose (3 rotation, 2 direction of translation).
  static constexpr int kShared = 8, kMotion = 5;
  using PlaneEquations = NormalEquations<kShared>;
  using JointEquations = std::array<NormalEquations<kShared + kMotion>, direct::kReferences>;

  void setCamera(const PinholeCamera& camera, const cv::Mat& mask);
  LaneRegion laneRegion(const RoadPrior& prior, double height) const;
  Eigen::Vector3d roadCentre(const GroundPlane& plane) const;
  PlaneMeasurement solve(const RoadPrior& prior, const GroundPlane& initial);
  GroundPlane search(const RoadPrior& prior, double centre) const;
  double meanCorrelation(const Eigen::Vector3d& m) const;
  bool matchPatches(const Eigen::Vector3d& m, bool linearise, PlaneMeasurement* result);
  double shiftVariance(const direct::Match& match, const Eigen::Vector3d& m) const;
  JointEquations accumulate(const RoadPrior& prior, const Eigen::Vector3d& m, double height,
                            double robust_scale) const;
  PlaneEquations marginaliseMotion(JointEquations joint) const;
  void addPriors(const RoadPrior& prior, const Eigen::Vector3d& m, double height,
                 PlaneEquations* equations) const;
  void accept(const Eigen::Vector3d& m, const Eigen::Matrix3d& covariance, double initial_height,
              PlaneMeasurement* result) const;

  Options options_;
  PinholeCamera camera_;  ///< of the images
  cv::Mat mask_;
  std::optional<direct::PatchMatcher>
      matcher_;      ///< for camera and mask; empty before the first image
  int setting_ = 0;  ///< RoadImage::setting of camera and mask

  // Current frame.
  std::vector<direct::Patch> patches_;
  std::vector<direct::Reference> references_;
  /// Camera whose height is measured, in this frame's camera axes [VO units].
  Eigen::Vector3d origin_c_ = Eigen::Vector3d::Zero();
  std::vector<direct::Match> matches_;  ///< of patch i in reference k: i * kReferences + k
  std::vector<double> normalised_shifts_;
};

}  // namespace gsv
