#include "kitti_raw.hpp"

#include <cmath>
#include <string>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/image_folder.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

/// A transform of a KITTI raw calibration file: the rotation after rotation_key and the translation
/// after translation_key, which may be empty for zero.
Eigen::Isometry3d readTransform(const fs::path& file, const std::string& rotation_key,
                                const std::string& translation_key) {
  const TextFile text(file);
  const std::size_t line = text.lineOf(rotation_key);
  const std::vector<double> r = text.numbers(line, 9, 1);
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  if (!translation_key.empty()) {
    t = Eigen::Map<const Eigen::Vector3d>(text.numbers(text.lineOf(translation_key), 3, 1).data());
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(r.data());
  const auto transform = rigidTransform(R, t);
  if (!transform) text.fail(line, rotation_key + " is not a rotation");
  return *transform;
}

/// T_w_imu [m] of the GPS/IMU: a Mercator projection that is true to scale at the first latitude.
std::vector<Eigen::Isometry3d> readOxts(const fs::path& folder) {
  constexpr double kEarthRadius = 6378137.0;  // [m], WGS 84 equator
  std::vector<Eigen::Isometry3d> poses;
  double scale = 0;
  for (const fs::path& file : numberedFiles(folder, {".txt"}).files) {
    const TextFile text(file);
    const std::vector<double> v = text.numbers(0, 30);
    const double latitude = v[0], longitude = v[1], altitude = v[2];
    if (std::abs(latitude) >= 90.0) text.fail(0, "its latitude is not between -90 and 90 degrees");
    if (poses.empty()) scale = std::cos(latitude * kRadiansPerDegree);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() << scale * kEarthRadius * longitude * kRadiansPerDegree,
        scale * kEarthRadius * std::log(std::tan((90.0 + latitude) * kRadiansPerDegree / 2.0)),
        altitude;
    T.linear() = (Eigen::AngleAxisd(v[5], Eigen::Vector3d::UnitZ()) *
                  Eigen::AngleAxisd(v[4], Eigen::Vector3d::UnitY()) *
                  Eigen::AngleAxisd(v[3], Eigen::Vector3d::UnitX()))
                     .toRotationMatrix();
    poses.push_back(T);
  }
  return poses;
}

}  // namespace

std::vector<Eigen::Isometry3d> readRawGroundTruth(const fs::path& folder) {
  const fs::path oxts = folder / "oxts" / "data";
  const fs::path camera_calibration = folder.parent_path() / "calib_cam_to_cam.txt";
  const fs::path imu_calibration = folder.parent_path() / "calib_imu_to_velo.txt";
  const fs::path velo_calibration = folder.parent_path() / "calib_velo_to_cam.txt";
  if (!isThere(oxts) || !isThere(imu_calibration) || !isThere(velo_calibration)) return {};
  const Eigen::Isometry3d T_c_imu = readTransform(camera_calibration, "R_rect_00:", "") *
                                    readTransform(velo_calibration, "R:", "T:") *
                                    readTransform(imu_calibration, "R:", "T:");
  std::vector<Eigen::Isometry3d> poses = readOxts(oxts);
  const Eigen::Isometry3d T_c0_w = T_c_imu * poses.front().inverse();
  for (Eigen::Isometry3d& pose : poses) pose = T_c0_w * pose * T_c_imu.inverse();
  return poses;
}

}  // namespace ground_scale_vo
