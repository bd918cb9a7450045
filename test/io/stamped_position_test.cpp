#include "ground_scale_vo/io/stamped_position.hpp"

#include <gtest/gtest.h>

#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

TEST(EastNorthUp, AgreesWithKnownDistances) {
  // A minute of latitude at 45 deg north is 1852.2 m, one of longitude 1314.2 m (WGS84).
  const auto p = eastNorthUp({{45, 8, 100}, {45 + 1.0 / 60, 8, 100}, {45, 8 + 1.0 / 60, 130}});
  EXPECT_NEAR(p[0].norm(), 0, 1e-8);  // not 0 where the compiler uses fused multiply-add
  EXPECT_NEAR(p[1].y(), 1852.2, 0.2);
  EXPECT_NEAR(p[1].x(), 0, 1e-6);
  EXPECT_NEAR(p[2].x(), 1314.2, 0.2);
  EXPECT_NEAR(p[2].z(), 30 - 0.135, 0.01);  // minus the curvature of the Earth
}

using StampedPositions = TemporaryFolder;

TEST_F(StampedPositions, AreReadInBothFormats) {
  const auto kitti = write("kitti", "1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 4 0 1 0 5 0 0 1 6\n");
  const auto positions = readStampedPositions(kitti, {10, 20});
  ASSERT_EQ(positions.size(), 2u);
  EXPECT_EQ(positions[1].stamp_ns, 20);
  EXPECT_EQ(positions[1].p, Eigen::Vector3d(4, 5, 6));
  for (const std::vector<std::int64_t>& stamps : {std::vector<std::int64_t>{10}, {10, 20, 30}}) {
    EXPECT_NE(dataErrorOf([&] { readStampedPositions(kitti, stamps); }, folder_).find("2 poses"),
              std::string::npos);
  }
  const auto tum = write("tum", "# stamp\n1.5 1 2 3 0 0 0 1\n1.6 4 5 6 0 1 0 0\n");
  const auto with_stamps = readStampedPositions(tum, {});
  ASSERT_EQ(with_stamps.size(), 2u);
  EXPECT_EQ(with_stamps[1].stamp_ns, 1600000000);
  EXPECT_EQ(with_stamps[1].p, Eigen::Vector3d(4, 5, 6));
  const auto same = write("same", "1.5 1 2 3 0 0 0 1\n1.5 4 5 6 0 0 0 1\n");
  EXPECT_EQ(dataErrorOf([&] { readStampedPositions(same, {}); }, folder_),
            "/same: its stamps do not increase at 1.500000000");
}

}  // namespace
}  // namespace ground_scale_vo
