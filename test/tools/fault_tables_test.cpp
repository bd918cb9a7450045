#include "tools/support/fault_tables.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

/// Metrics that violate no threshold.
FaultDriveMetrics metrics() {
  FaultDriveMetrics m;
  m.frames = 200;
  m.segments = {{10, 39, 30.25, 1.5}};
  return m;
}

TEST(FaultTables, TheSummaryFailsWithOneDriveThatViolatesAThreshold) {
  FaultDriveMetrics violated = metrics();
  violated.segments.clear();
  EXPECT_EQ(summarise({metrics(), metrics()}).exit_status, 0);
  const FaultSummary one = summarise({metrics(), violated, metrics()});
  EXPECT_EQ(one.text, "3 drives, 1 with a violated threshold\n");
  EXPECT_EQ(one.exit_status, 1);
  EXPECT_NE(faultDriveText({}, violated).find("  VIOLATED: "), std::string::npos);
}

}  // namespace
}  // namespace ground_scale_vo
