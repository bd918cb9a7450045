#include "ground_scale_vo/evaluation/speed_file.hpp"

#include <gtest/gtest.h>

#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

using SpeedFile = TemporaryFolder;

TEST_F(SpeedFile, SpeedsAndTheirDeviationsAreOfTheStatedUnit) {
  const std::vector<SpeedSample> speeds = readSpeeds(
      write("speeds.csv", "stamp,speed_kmh,sigma\n10.5,36,3.6\n10.6,-18,7.2\n"), "", true);
  ASSERT_EQ(speeds.size(), 2u);
  EXPECT_EQ(speeds[0].stamp_ns, 10500000000);
  EXPECT_NEAR(speeds[0].speed, 10, 1e-9);
  EXPECT_NEAR(speeds[0].sigma, 1, 1e-9);
  EXPECT_NEAR(speeds[1].speed, -5, 1e-9);
  EXPECT_NEAR(speeds[1].sigma, 2, 1e-9);
}

}  // namespace
}  // namespace gsv
