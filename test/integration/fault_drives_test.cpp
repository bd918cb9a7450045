// The pipeline on rendered drives with injected faults meets the thresholds of
// fault_evaluation.hpp.

#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <future>
#include <mutex>
#include <string>

#include "ground_scale_vo/simulation/fault_evaluation.hpp"
#include "support/sanitizer.hpp"

namespace ground_scale_vo {
namespace {

TEST(FaultDrives, MeetTheirThresholds) {
  cv::setNumThreads(1);  // two drives at once
  std::atomic<std::size_t> next{0};
  std::mutex printing;
  const auto work = [&] {
    for (std::size_t i = 0; (i = kDriveStride * next++) < kFaultDriveCount;) {
      const FaultDrive drive = faultDrive(i);
      const FaultDriveMetrics metrics = runFaultDrive(drive);
      double worst = 0;
      std::string faults;
      for (const FaultFreeSegment& s : metrics.segments) worst = std::max(worst, s.error_percent);
      for (const FaultMetrics& f : metrics.faults) faults += " " + f.name + ",";
      const std::lock_guard<std::mutex> lock(printing);
      std::printf("%s:%s segments within %.2f %%\n", drive.name.c_str(), faults.c_str(), worst);
      EXPECT_EQ(violatedThreshold(metrics), "") << drive.name;
      EXPECT_GE(metrics.segments.size(), 2u) << drive.name;
    }
  };
  std::future<void> other = std::async(std::launch::async, work);
  work();
  other.get();
  cv::setNumThreads(-1);
}

}  // namespace
}  // namespace ground_scale_vo
