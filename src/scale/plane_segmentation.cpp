// PCL's templates are instantiated here for an own point type. The instances of
// libpcl_segmentation would load nine more libraries: 36 MiB for a RANSAC of planes.
#define PCL_NO_PRECOMPILE

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/register_point_struct.h>
#include <pcl/sample_consensus/sac_model_perpendicular_plane.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <algorithm>
#include <cstddef>

#include "scale/plane_fit.hpp"

namespace gsv {

struct EIGEN_ALIGN16 PclPoint {
  PclPoint() = default;
  explicit PclPoint(const Eigen::Vector3f& p) : data{p.x(), p.y(), p.z(), 1} {}
  PCL_ADD_POINT4D
  EIGEN_MAKE_ALIGNED_OPERATOR_NEW
};

}  // namespace gsv

POINT_CLOUD_REGISTER_POINT_STRUCT(gsv::PclPoint, (float, x, x)(float, y, y)(float, z, z))

namespace gsv {
namespace {

using Cloud = pcl::PointCloud<PclPoint>;
using PclModel = pcl::SampleConsensusModelPerpendicularPlane<PclPoint>;

/// [camera heights^2] Least area of a sample's parallelogram; PCL's own limit is the same.
constexpr float kMinSampleArea = 1e-5f;

constexpr double kInlierDistance = 0.04;  ///< [camera heights]
constexpr int kSacIterations = 100;

/// PCL's model without its error messages. PCL prints one for every degenerate sample and one when
/// no model has inliers. Here a degenerate sample has the invalid plane 0, which has no inliers,
/// and the count of inliers is at least one, so that RANSAC always ends with a model. A model of an
/// invalid plane is recognised by its empty inliers.
class PlaneModel : public PclModel {
 public:
  explicit PlaneModel(const Cloud::ConstPtr& cloud) : PclModel(cloud) {}

  bool computeModelCoefficients(const std::vector<int>& samples,
                                Eigen::VectorXf& coefficients) const override {
    const auto at = [&](std::size_t i) -> Eigen::Vector3f {
      return (*input_)[static_cast<std::size_t>(samples[i])].getVector3fMap();
    };
    const Eigen::Vector3f cross = (at(1) - at(0)).cross(at(2) - at(0));
    if (cross.stableNorm() >= kMinSampleArea) {
      return PclModel::computeModelCoefficients(samples, coefficients);
    }
    coefficients = Eigen::Vector4f::Zero();
    return true;
  }

  std::size_t countWithinDistance(const Eigen::VectorXf& coefficients,
                                  double threshold) const override {
    return std::max<std::size_t>(1, PclModel::countWithinDistance(coefficients, threshold));
  }

 protected:
  bool isSampleGood(const std::vector<int>&) const override { return true; }
};

}  // namespace
}  // namespace gsv

/// With PlaneModel alone: the general one instantiates PCL's models of all shapes.
template <>
bool pcl::SACSegmentation<gsv::PclPoint>::initSACModel(int /*model_type*/) {
  const auto model = pcl::make_shared<gsv::PlaneModel>(input_);
  model->setAxis(axis_);
  model->setEpsAngle(eps_angle_);
  model_ = model;
  return true;
}

namespace gsv {

std::optional<Eigen::Vector4f> segmentPerpendicularPlane(const std::vector<Eigen::Vector3f>& points,
                                                         const Eigen::Vector3f& axis,
                                                         double max_angle) {
  const auto cloud = pcl::make_shared<Cloud>();
  cloud->reserve(points.size());
  for (const Eigen::Vector3f& p : points) cloud->push_back(PclPoint(p));
  pcl::SACSegmentation<PclPoint> segmentation;
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setAxis(axis);
  segmentation.setEpsAngle(max_angle);
  segmentation.setDistanceThreshold(kInlierDistance);
  segmentation.setMaxIterations(kSacIterations);
  segmentation.setOptimizeCoefficients(false);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients coefficients;
  segmentation.segment(inliers, coefficients);
  if (inliers.indices.empty() || coefficients.values.size() != 4) return std::nullopt;
  return Eigen::Vector4f(coefficients.values.data());
}

}  // namespace gsv
