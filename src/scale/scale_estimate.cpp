#include "ground_scale_vo/scale/scale_estimate.hpp"

#include <cstddef>

namespace gsv {
namespace {

/// In the order of the enumerators.
template <typename Enum, std::size_t n>
const char* nameOf(Enum value, const char* const (&names)[n]) {
  const auto i = static_cast<std::size_t>(value);
  return i < n ? names[i] : "invalid";
}

}  // namespace

const char* toString(ScaleSource source) {
  return nameOf(source, {"none", "road", "speed", "both"});
}

const char* toString(ScaleStatus status) { return nameOf(status, {"unknown", "ok", "held"}); }

const char* toString(MeasurementStatus status) {
  return nameOf(status, {"none", "vo_not_tracking", "standstill", "too_few_triangles",
                         "too_few_ground_points", "no_plane", "plane_tilted", "rejected_by_filter",
                         "implausible_motion", "zoomed"});
}

}  // namespace gsv
