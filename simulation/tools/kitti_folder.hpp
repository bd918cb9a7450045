#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <iomanip>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "tools/support/complete_output.hpp"

namespace gsv {

/// The tables of a KITTI odometry folder, and ground.txt. Empty vectors: unknown, no file.
struct KittiTables {
  PinholeCamera camera;
  std::vector<std::int64_t> stamps_ns;
  std::vector<Eigen::Isometry3d> T_c0_c;  ///< first camera from camera [m]
  /// Height of the camera above the road [m], and the road's normal in camera axes, up.
  std::vector<Eigen::Vector4d> ground;
};

inline void writeKittiTables(const std::filesystem::path& folder, const KittiTables& tables) {
  const PinholeCamera& c = tables.camera;
  std::ostringstream calib, times, ground;
  calib << std::setprecision(17) << "P0: " << c.fx << " 0 " << c.cx << " 0 0 " << c.fy << ' '
        << c.cy << " 0 0 0 1 0\nS0: " << c.width << ' ' << c.height << '\n';
  for (const std::int64_t stamp_ns : tables.stamps_ns) times << formatSeconds(stamp_ns) << '\n';
  ground << std::setprecision(12)
         << "# camera height above the local road plane [m], its unit normal in camera axes "
            "(x right, y down, z forward), pointing up\n";
  for (const Eigen::Vector4d& g : tables.ground) {
    ground << g[0] << ' ' << g[1] << ' ' << g[2] << ' ' << g[3] << '\n';
  }
  writeFile(folder / "calib.txt", calib.str());
  writeFile(folder / "times.txt", times.str());
  if (!tables.T_c0_c.empty()) writeKittiPoses(folder / "poses.txt", tables.T_c0_c);
  if (!tables.ground.empty()) writeFile(folder / "ground.txt", ground.str());
}

/// jpeg_quality: 0: a PNG file. Precondition: there is a folder image_0 in the folder.
inline void writeKittiImage(const std::filesystem::path& folder, std::size_t i,
                            const cv::Mat& image, int jpeg_quality = 0) {
  const std::string extension = jpeg_quality > 0 ? ".jpg" : ".png";
  const std::vector<int> quality = jpeg_quality > 0
                                       ? std::vector<int>{cv::IMWRITE_JPEG_QUALITY, jpeg_quality}
                                       : std::vector<int>{cv::IMWRITE_PNG_COMPRESSION, 1};
  std::ostringstream name;
  name << std::setw(6) << std::setfill('0') << i << extension;
  std::vector<unsigned char> bytes;
  cv::imencode(extension, image, bytes, quality);
  writeFile(folder / "image_0" / name.str(), {bytes.begin(), bytes.end()});
}

/// Makes a folder with an empty image_0 by writeCompletely(), and calls write() with its temporary
/// name. Throws DataError when there is such a folder.
template <typename Write>
void writeKittiFolder(const std::filesystem::path& folder, const Write& write) {
  if (isThere(folder)) throw DataError(folder.string() + " already exists");
  const std::filesystem::path normalised = std::filesystem::absolute(folder).lexically_normal();
  writeCompletely(normalised.has_filename() ? normalised : normalised.parent_path(),
                  [&](const std::filesystem::path& partial) {
                    makeFolder(partial / "image_0");
                    write(partial);
                  });
}

}  // namespace gsv
