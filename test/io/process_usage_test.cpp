#include "ground_scale_vo/io/process_usage.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
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

/// Resident memory of this process according to another file of the kernel [MiB].
double residentMb() {
  std::size_t size = 0, resident = 0;  // [pages]
  std::ifstream("/proc/self/statm") >> size >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

TEST(ProcessUsage, CountsTheTimeOfAllThreadsIncludingEndedOnes) {
  const double before = processUsage().cpu_s;
  work(20);
  std::thread([] { work(30); }).join();
  const double used_s = processUsage().cpu_s - before;
  EXPECT_GE(used_s, 0.0499);  // 20 + 30 ms, less rounding
  EXPECT_LT(used_s, 0.2 * kTimeoutFactor) << "threadCpuMs() is too small";
}

TEST(ProcessUsage, TheTimeOfAThreadIsItsOwn) {
  const double own_before = threadCpuMs(), total_before = 1e3 * processUsage().cpu_s;
  std::thread([] { work(50); }).join();
  const double own_ms = threadCpuMs() - own_before;
  EXPECT_GE(1e3 * processUsage().cpu_s - total_before, own_ms + 49.9);
}

TEST(ProcessUsage, ReportsMemoryAndItsPeak) {
  const ProcessUsage before = processUsage();
  EXPECT_GT(before.rss_mb, 0);
  {
    const std::vector<char> memory(64 << 20, 1);
    // back() is 1; its use keeps the compiler from removing the vector.
    EXPECT_GT(processUsage().rss_mb, before.rss_mb + 60 + memory.back() - 1);
    EXPECT_NEAR(processUsage().rss_mb, residentMb(), 1);
  }
  const ProcessUsage after = processUsage();
  EXPECT_GE(after.peak_rss_mb, before.rss_mb + 60);
  EXPECT_GE(after.peak_rss_mb, after.rss_mb);
  if (!kSanitized) {
    EXPECT_LT(after.rss_mb, before.rss_mb + 32);
  }
}

TEST(ProcessUsage, OfAnotherProcess) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    pause();
    _exit(0);
  }
  EXPECT_GT(processUsage(child).rss_mb, 0);
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_EQ(processUsage(child).cpu_s, 0) << "the process has ended";
  EXPECT_EQ(processUsage(child).rss_mb, 0);
}

}  // namespace
}  // namespace ground_scale_vo
