#pragma once

#include <optional>
#include <vector>

#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/direct/image_buffer.hpp"
#include "scale/direct/patch.hpp"
#include "scale/direct/patch_matcher.hpp"

namespace ground_scale_vo::direct {

/// Cells of the patch grid whose content does not move in the image while the camera moves: parts
/// of the own vehicle, its shadow, dirt on the lens. Learned over the distance travelled and kept
/// when the map changes.
class StaticMask {
 public:
  StaticMask(const PinholeCamera& camera, const PatchGrid& grid);

  /// Compares each patch with the same pixels of the reference image. m: the plane n / h that the
  /// patches are expected on. is_aligned: m was estimated from this frame; otherwise it only serves
  /// to predict the flow. rate: weight of this frame, 0 to 1.
  void update(const std::vector<Patch>& patches, const Reference& reference,
              const PatchMatcher& matcher, const Eigen::Vector3f& m, bool is_aligned, float rate);

  bool contains(std::size_t cell) const;

 private:
  bool isStatic(const Patch& patch, const Reference& reference, const PatchMatcher& matcher,
                const Eigen::Vector3f& m, bool is_aligned) const;

  PinholeCamera camera_;
  PatchGrid grid_;
  std::vector<float> probability_;  ///< by cell: 1 static in the image, 0 moves with the road
};

}  // namespace ground_scale_vo::direct
