#include "ground_scale_vo/io/trajectory_io.hpp"

#include "common/files.hpp"
#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
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
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() << 0.5, -2, 3;
  pose.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  writeTumTrajectory(folder_ / "t.txt", {{-500000001, pose}, {1317042145964389445, pose}});
  const TextFile text(folder_ / "t.txt");
  EXPECT_EQ(text.words(0).front(), "-0.500000001");
  EXPECT_EQ(text.words(1).front(), "1317042145.964389445");
  const std::vector<double> numbers = text.numbers(1, 7, 1);
  for (const auto& [k, value] : {std::pair(0, 0.5), {1, -2.}, {2, 3.}, {3, 1.}, {6, 0.}}) {
    EXPECT_NEAR(numbers[static_cast<std::size_t>(k)], value, 1e-15) << k;
  }
}

}  // namespace
}  // namespace gsv
