#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

TEST(FaultDrives, ContainEveryFaultWithFaultFreeSegmentsBetween) {
  std::set<std::string> names, heights;
  for (std::size_t i = 0; i < kFaultDriveCount; ++i) {
    const FaultDrive drive = faultDrive(i);
    EXPECT_NO_THROW(drive.options.validate()) << i;
    heights.insert(std::to_string(drive.options.camera_height));
    ASSERT_GE(drive.faults.size(), 2u);
    std::size_t fault_free_from = 0, hiding = 0;
    for (const PlacedFault& fault : drive.faults) {
      names.insert(fault.name);
      EXPECT_GT(fault.first, fault_free_from + 20) << drive.name << ": " << fault.name;
      EXPECT_GE(fault.last, fault.first);
      const double seconds =
          static_cast<double>(fault.last - fault.first + 1) / drive.options.frame_rate_hz;
      if (fault.hides_ground) {
        EXPECT_GT(seconds, 3) << drive.name << ": " << fault.name;
      }
      hiding += fault.hides_ground;
      fault_free_from = fault.last + 1;
    }
    EXPECT_EQ(hiding, 1u) << drive.name;
    EXPECT_GT(drive.options.frames, static_cast<int>(fault_free_from) + 20);
  }
  EXPECT_EQ(heights.size(), kFaultDriveCount);
  for (const std::string& name : faultNames()) {
    EXPECT_EQ(names.count(name), 1u) << name;
    EXPECT_EQ(faultDrive(name).faults.front().name, name);
  }
  EXPECT_NE(faultDrive(0, 1).options.random_seed, faultDrive(0, 2).options.random_seed);
  EXPECT_THROW(faultDrive(kFaultDriveCount), OptionError);
  EXPECT_THROW(faultDrive("unknown fault"), OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
