#include "ground_scale_vo/calibration/height_report.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>
#include <sstream>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/scale/mounting.hpp"

namespace ground_scale_vo {
namespace {

std::string inDegrees(const std::optional<HeightCalibration::Estimate>& angle) {
  if (!angle) return "not known, the drive is too short or the plane was measured too rarely";
  return format("%.2f deg ± %.2f (95 %%)", kDegreesPerRadian * angle->value,
                kDegreesPerRadian * angle->error95());
}

/// Translation and quaternion of the camera in a base_link that stands on the road below it. Its z
/// axis is the road's normal, its x axis the optical axis projected onto the road. Empty when the
/// mounting is not known.
std::string mounting(const HeightCalibration::Result& result) {
  if (!result.pitch) return {};
  // The columns of R_c_b are the base's axes in the camera: up is the road's normal, forward the
  // optical axis without its part along up.
  const Eigen::Vector3d up = roadNormal(result.pitch->value, result.roll->value);
  const Eigen::Vector3d forward =
      (Eigen::Vector3d::UnitZ() - up.dot(Eigen::Vector3d::UnitZ()) * up).normalized();
  Eigen::Matrix3d R_c_b;
  R_c_b << forward, up.cross(forward), up;
  Eigen::Quaterniond q(R_c_b.transpose());
  if (q.w() < 0) q.coeffs() *= -1;  // q and -q are the same rotation
  return format("0 0 %.3f %.5f %.5f %.5f %.5f", result.height.value, q.x(), q.y(), q.z(), q.w());
}

}  // namespace

std::string heightYaml(const HeightCalibration::Result& result, const std::string& source) {
  std::ostringstream text;
  const HeightCalibration::Estimate& height = result.height;
  text << "# " << source << '\n'
       << format("camera_height: %.4f  # [m] ± %.4f (95 %%)", height.value, height.error95())
       << format(", %.2f %%", 100 * height.error95() / height.value) << '\n'
       << "# The mounting of the camera, for tf; the scale does not need it.\n"
       << "# pitch: " << inDegrees(result.pitch) << ", positive looks down\n"
       << "# roll: " << inDegrees(result.roll) << ", positive: the right of the camera is lower\n";
  if (const std::string transform = mounting(result); !transform.empty()) {
    text << "# A base_link on the road below the camera that faces as the camera does:\n"
         << "# rosrun tf2_ros static_transform_publisher " << transform
         << " base_link CAMERA_FRAME\n";
  }
  return text.str();
}

std::string segmentTable(const HeightCalibration::Result& result) {
  if (result.segments.empty()) return {};
  std::string text = "Times since the start of the first segment.\n" +
                     format("%8s %8s %10s %10s\n", "from s", "to s", "length m", "height m");
  const std::int64_t start = result.segments.front().from_ns;
  std::size_t used = 0;
  for (const HeightCalibration::Segment& segment : result.segments) {
    used += segment.used;
    text += format("%8.1f %8.1f %10.1f %10.3f%s\n", secondsBetween(start, segment.from_ns),
                   secondsBetween(start, segment.to_ns), segment.length_heights * segment.height,
                   segment.height, segment.used ? "" : "  rejected");
  }
  return text + format("%zu of %zu segments\n", used, result.segments.size());
}

}  // namespace ground_scale_vo
