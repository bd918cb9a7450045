#include "ground_scale_vo/io/trajectory_io.hpp"

#include <limits>
#include <locale>
#include <sstream>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

std::ostringstream numberStream(int digits) {
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  stream.precision(digits);
  return stream;
}
/// Its numbers parse to the same doubles.
std::ostringstream exactStream() { return numberStream(std::numeric_limits<double>::max_digits10); }

}  // namespace

std::ostringstream csvStream(const std::string& heading) {
  std::ostringstream stream = numberStream(10);
  stream << heading << '\n';
  return stream;
}

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) { return Eigen::Affine3d(m).rotation(); }

std::optional<Eigen::Isometry3d> rigidTransform(const Eigen::Matrix3d& m,
                                                const Eigen::Vector3d& t) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = nearestRotation(m);
  T.translation() = t;
  const bool is_rotation = isFinite(T) && (T.linear() - m).cwiseAbs().maxCoeff() <= 0.01;
  return is_rotation ? std::make_optional(T) : std::nullopt;
}

std::vector<Eigen::Isometry3d> readKittiPoses(const fs::path& file) {
  const TextFile text(file);
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::vector<double> numbers = text.numbers(i, 12);
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> rows(numbers.data());
    const auto pose = rigidTransform(rows.leftCols<3>(), rows.col(3));
    if (!pose) text.fail(i, "its 3x3 is not a rotation");
    if (!isPlausiblePosition(pose->translation())) {
      text.fail(i, "its position is implausibly far away");
    }
    poses.push_back(*pose);
  }
  return poses;
}

void writeKittiPoses(const fs::path& file, const std::vector<Eigen::Isometry3d>& poses) {
  std::ostringstream stream = exactStream();
  for (const Eigen::Isometry3d& pose : poses) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        stream << pose(row, column) << (row == 2 && column == 3 ? '\n' : ' ');
      }
    }
  }
  writeFile(file, stream.str());
}

void writeTumTrajectory(const fs::path& file, const std::vector<StampedPose>& poses) {
  std::ostringstream stream = exactStream();
  for (const StampedPose& pose : poses) {
    const Eigen::Vector3d t = pose.T_w_c.translation();
    const Eigen::Quaterniond q(pose.T_w_c.linear());
    stream << formatSeconds(pose.stamp_ns) << ' ' << t.x() << ' ' << t.y() << ' ' << t.z() << ' '
           << q.x() << ' ' << q.y() << ' ' << q.z() << ' ' << q.w() << '\n';
  }
  writeFile(file, stream.str());
}

}  // namespace gsv
