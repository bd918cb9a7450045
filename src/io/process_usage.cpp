#include "ground_scale_vo/io/process_usage.hpp"

#include <time.h>
#include <unistd.h>

#include <fstream>
#include <string>

namespace gsv {

ProcessUsage processUsage(pid_t pid) {
  ProcessUsage usage;
  if (pid == 0) pid = getpid();
  clockid_t clock{};
  timespec cpu{};
  if (clock_getcpuclockid(pid, &clock) == 0 && clock_gettime(clock, &cpu) == 0) {
    usage.cpu_s = static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec);
  }
  // getrusage() would inherit the peak of the parent process.
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  for (std::string line; std::getline(status, line);) {
    const auto read = [&](const std::string& key, double* mb) {
      if (line.compare(0, key.size(), key) == 0) *mb = std::stod(line.substr(key.size())) / 1024;
    };
    read("VmHWM:", &usage.peak_rss_mb);
    read("VmRSS:", &usage.rss_mb);
  }
  return usage;
}

double threadCpuMs() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

}  // namespace gsv
