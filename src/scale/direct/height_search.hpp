#pragma once

#include <optional>
#include <vector>

#include "ground_scale_vo/scale/direct_plane_estimator.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/lane_region.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/direct/image_buffer.hpp"
#include "scale/direct/patch.hpp"
#include "scale/direct/patch_matcher.hpp"

namespace ground_scale_vo::direct {

/// Median camera height over the features in the lane, each taken as a road point [VO units]: the
/// order of magnitude of the height. 0 when there are none.
double medianFeatureHeight(const VoFrame& frame, const LaneRegion& lane, const NormalPrior& prior);

/// Exhaustive search for the camera height: maximises the correlation of the patches with each
/// reference image over the height. While the prior leaves the roll open, the one that correlates
/// best with the first reference image is used for both. The pitch is that of the prior, which
/// knows it from the direction of motion.
class HeightSearch {
 public:
  explicit HeightSearch(const DirectPlaneEstimator::Options& options) : options_(options) {}

  /// The plane at whose height both reference images have the same distinct correlation peak
  /// [VO units]. centre: of the searched range of heights [VO units]. Empty: no such peak, or fewer
  /// than kReferences references.
  std::optional<GroundPlane> find(const std::vector<Patch>& patches,
                                  const std::vector<Reference>& references,
                                  const PatchMatcher& matcher, const NormalPrior& prior,
                                  double centre) const;

 private:
  int halfRange() const;
  std::vector<double> scores(const std::vector<Patch>& patches, const Reference& reference,
                             const PatchMatcher& matcher, const Eigen::Vector3d& n_c,
                             double centre) const;
  Eigen::Vector3d bestNormal(const std::vector<Patch>& patches, const Reference& reference,
                             const PatchMatcher& matcher, const NormalPrior& prior,
                             double centre) const;
  double meanCorrelation(const std::vector<Patch>& patches, const Reference& reference,
                         const PatchMatcher& matcher, const Eigen::Vector3f& m) const;

  DirectPlaneEstimator::Options options_;
};

}  // namespace ground_scale_vo::direct
