#include "ground_scale_vo/io/process_usage.hpp"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "support/sanitizer.hpp"

namespace ground_scale_vo {
namespace {

/// Uses `ms` milliseconds of processor time in the calling thread.
void work(double ms) {
  const double end = threadCpuMs() + ms;
  while (threadCpuMs() < end) {
  }
}

TEST(ProcessUsage, CountsTheTimeOfAllThreadsIncludingEndedOnes) {
  const double before = processUsage().cpu_s;
  work(20);
  std::thread([] { work(30); }).join();
  const double used_s = processUsage().cpu_s - before;
  EXPECT_GE(used_s, 0.0499);  // 20 + 30 ms, less rounding
  EXPECT_LT(used_s, 0.2 * kTimeoutFactor) << "threadCpuMs() is too small";
}

TEST(ProcessUsage, ReportsMemoryAndItsPeak) {
  const ProcessUsage before = processUsage();
  EXPECT_GT(before.rss_mb, 0);
  {
    const std::vector<char> memory(64 << 20, 1);
    // back() is 1; its use keeps the compiler from removing the vector.
    EXPECT_GT(processUsage().rss_mb, before.rss_mb + 60 + memory.back() - 1);
  }
  const ProcessUsage after = processUsage();
  EXPECT_GE(after.peak_rss_mb, before.rss_mb + 60);
  EXPECT_GE(after.peak_rss_mb, after.rss_mb);
  if (!kSanitized) {
    EXPECT_LT(after.rss_mb, before.rss_mb + 32);
  }
}

}  // namespace
}  // namespace ground_scale_vo
