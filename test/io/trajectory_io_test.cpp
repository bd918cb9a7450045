#include "ground_scale_vo/io/trajectory_io.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/files.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using TrajectoryIo = TemporaryFolder;

const std::string kIdentity = "1 0 0 0 0 1 0 0 0 0 1 0";

Eigen::Isometry3d somePose(double k) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.rotate(Eigen::AngleAxisd(0.3 * k, Eigen::Vector3d(1, -2, 0.5).normalized()));
  T.translation() << k / 3, -k / 7, 1e-9 * k;
  return T;
}

TEST_F(TrajectoryIo, KittiPosesSurviveTheRoundTrip) {
  const std::vector<Eigen::Isometry3d> poses{somePose(0), somePose(1), somePose(2)};
  writeKittiPoses(folder_ / "poses.txt", poses);
  const auto read = readKittiPoses(folder_ / "poses.txt");
  ASSERT_EQ(read.size(), poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(read[i].translation(), poses[i].translation());
    EXPECT_TRUE(read[i].linear().isApprox(poses[i].linear(), 1e-14));
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1)
      << "a temporary file was left";
}

TEST_F(TrajectoryIo, MakesRotationsOrthonormal) {
  const auto file = write("poses.txt", "1.0001 0 0 5 0 0.9999 0.0002 0 0 0 1.0001 0\n");
  const Eigen::Matrix3d R = readKittiPoses(file).front().linear();
  EXPECT_TRUE((R.transpose() * R).isApprox(Eigen::Matrix3d::Identity(), 1e-14));
  EXPECT_NEAR(R(1, 2), 0.0001, 1e-6);
}

TEST_F(TrajectoryIo, RejectsMalformedTrajectories) {
  const auto errorOf = [&](const std::string& content) {
    const auto file = write("p.txt", content);
    return dataErrorOf([&] { readKittiPoses(file); }, folder_);
  };
  EXPECT_EQ(errorOf(" \r\n\n"), "/p.txt: is empty");
  EXPECT_EQ(errorOf(kIdentity + "\r\n" + kIdentity + "\r\n\r\n  \n\n"), "no error");
  EXPECT_EQ(errorOf(kIdentity + "\n1 2 3\n"), "/p.txt, line 2: has 3 numbers instead of 12");
  EXPECT_EQ(errorOf(kIdentity + "\n\n" + kIdentity), "/p.txt, line 2: has 0 numbers instead of 12");
  for (const std::string word : {"x7", "nan", "-inf", "1e999", "0x10", "1,0", "1e", "--1"}) {
    EXPECT_EQ(errorOf("1 0 0 0 0 1 0 " + word + " 0 0 1 0"),
              "/p.txt, line 1: '" + word + "' is not a finite number");
  }
  EXPECT_EQ(errorOf(std::string("\0\x01", 2) + std::string(50, '\xff')),
            "/p.txt, line 1: '" + std::string(30, '?') + "...' is not a finite number");
  EXPECT_EQ(errorOf("0 0 0 0 0 0 0 0 0 0 0 0"), "/p.txt, line 1: its 3x3 is not a rotation");
  EXPECT_EQ(errorOf("1 0 0 0 0 1 0 0 0 0 -1 0"), "/p.txt, line 1: its 3x3 is not a rotation");
}

TEST_F(TrajectoryIo, TumStampsAreExactToTheNanosecond) {
  std::vector<StampedPose> poses(5);
  poses[0].stamp_ns = -500000001;
  poses[1].stamp_ns = 0;
  poses[2].stamp_ns = 103736000;
  poses[3].stamp_ns = 1317042145964389445;
  poses[4].stamp_ns = 1317042145964389446;
  for (std::size_t i = 0; i < poses.size(); ++i) poses[i].T_a_b = somePose(static_cast<double>(i));
  writeTumTrajectory(folder_ / "t.txt", poses);
  const auto read = readTumTrajectory(folder_ / "t.txt");
  ASSERT_EQ(read.size(), poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(read[i].stamp_ns, poses[i].stamp_ns);
    EXPECT_TRUE(read[i].T_a_b.isApprox(poses[i].T_a_b, 1e-14));
  }
}

TEST_F(TrajectoryIo, TumSkipsCommentsAndRejectsBadPoses) {
  const auto good = write("good.txt", "# stamp tx ty tz qx qy qz qw\n1.5 1 2 3 0 0.71 0 0.71\n");
  ASSERT_EQ(readTumTrajectory(good).size(), 1u);
  const Eigen::Matrix3d R = readTumTrajectory(good).front().T_a_b.linear();
  EXPECT_TRUE((R.transpose() * R).isApprox(Eigen::Matrix3d::Identity(), 1e-14));
  const auto errorOf = [&](const std::string& second_line) {
    const auto file = write("p.txt", "1.5 1 2 3 0 0 0 1\n" + second_line + "\n2.5 1 2 3 0 0 0 1\n");
    return dataErrorOf([&] { readTumTrajectory(file); }, folder_);
  };
  EXPECT_EQ(errorOf(""), "/p.txt, line 2: has 0 numbers instead of 8");
  EXPECT_EQ(errorOf("2 1 1e300 3 0 0 0 1"), "/p.txt, line 2: its position is implausibly far away");
  EXPECT_EQ(errorOf("2 1 2 3 0 0 0 0"), "/p.txt, line 2: its quaternion is not of unit length");
}

}  // namespace
}  // namespace ground_scale_vo
