// poses.txt of a KITTI folder, and the same bytes as a TUM trajectory.

#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "sequence_files.hpp"

namespace ground_scale_vo::fuzz {

Plan plan() {
  return {20000,
          {"1 0 0 0 0 1 0 0 0 0 1 0\n0.8 0 0.6 1.5 0 1 0 -0.1 -0.6 0 0.8 12\n",
           "1.000000e+00 9.043680e-12 2.326809e-11 5.551115e-17 9.043683e-12 1.000000e+00 "
           "2.392370e-10 3.330669e-16 2.326810e-11 2.392370e-10 9.999999e-01 -4.440892e-16\n"
           "1 0 0 0 0 1 0 0 0 0 1 1\r\n",
           "# stamp tx ty tz qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.1 1 2 3 0.6 0 0 0.8\n"}};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ground_scale_vo;
  fuzz::readSequenceWith("poses.txt", data, size);
  const std::string file = fuzz::scratchFolder() + "/poses.txt";
  try {
    const auto poses = readKittiPoses(file);
    if (poses.size() >= 2) {
      const OdometryMetrics metrics = computeOdometryMetrics(poses, poses);
      fuzz::require(std::isfinite(metrics.length_m) && std::isfinite(metrics.ate_rmse_m),
                    "metrics are finite");
      for (const auto& errors : {metrics.by_length, metrics.by_short_length}) {
        for (const auto& error : errors) {
          fuzz::require(std::isfinite(error.t_err_percent), "segment errors are finite");
        }
      }
    }
  } catch (const DataError&) {
  }
  try {
    for (const StampedPose& pose : readTumTrajectory(file)) {
      fuzz::require(pose.T_a_b.matrix().allFinite(), "poses are finite");
    }
  } catch (const DataError&) {
  }
  return 0;
}
