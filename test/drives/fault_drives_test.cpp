// The pipeline on rendered drives with injected faults meets the thresholds of
// fault_evaluation.hpp.

#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/fault_evaluation.hpp"
#include "support/long_tests.hpp"
#include "tools/support/fault_tables.hpp"

namespace ground_scale_vo {

void PrintTo(const FaultDrive& drive, std::ostream* stream) {
  *stream << drive.name << ":";
  for (const PlacedFault& fault : drive.faults) *stream << " " << fault.name;
}

namespace {

/// The faults of these drives are in the other ones, too: they are long tests.
const std::set<std::size_t> kLongFaultDrives = {2, 4, 5};

/// The long ones, or the others.
std::vector<FaultDrive> faultDrives(bool long_ones) {
  std::vector<FaultDrive> drives;
  for (std::size_t i = 0; i < kFaultDriveCount; ++i) {
    if ((kLongFaultDrives.count(i) > 0) == long_ones) drives.push_back(faultDrive(i));
  }
  return drives;
}

TEST(FaultDrives, ContainEveryFault) {
  std::set<std::string> names;
  for (const FaultDrive& drive : faultDrives(false)) {
    for (const PlacedFault& fault : drive.faults) names.insert(fault.name);
  }
  const std::vector<std::string> all = faultNames();
  EXPECT_EQ(names, std::set<std::string>(all.begin(), all.end()));
}

class FaultDriveRun : public testing::TestWithParam<FaultDrive> {};

TEST_P(FaultDriveRun, MeetsTheThresholds) {
  const FaultDriveMetrics metrics = runFaultDrive(GetParam());
  double worst = 0;
  for (const FaultFreeSegment& s : metrics.segments) worst = std::max(worst, s.error_percent);
  std::printf("segments within %.2f %%\n", worst);
  EXPECT_EQ(violatedThreshold(metrics), "");
  EXPECT_GE(metrics.segments.size(), 2u);
}

INSTANTIATE_TEST_SUITE_P(Drives, FaultDriveRun, testing::ValuesIn(faultDrives(runsLongTests())));

}  // namespace
}  // namespace ground_scale_vo
