#pragma once

#include <vector>

#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/direct/patch.hpp"

namespace ground_scale_vo::direct {

/// Cells of the patch grid in which most tracked features lie off the expected plane: vehicles,
/// kerbs, vegetation.
class OffPlaneMask {
 public:
  /// threshold_heights: deviation from the plane that counts as off [camera heights].
  OffPlaneMask(const PatchGrid& grid, double threshold_heights);

  /// Votes of the frame's features. height: of the camera over the plane [VO units]; 0 when it is
  /// not known: nothing is masked.
  void update(const VoFrame& frame, const NormalPrior& prior, double height);

  bool contains(std::size_t cell) const { return votes_[cell] > 0; }

 private:
  PatchGrid grid_;
  double threshold_heights_;
  std::vector<int> votes_;  ///< by cell: features off the plane minus features on it
};

}  // namespace ground_scale_vo::direct
