#pragma once

#include <sys/types.h>

namespace ground_scale_vo {

/// What a process has used of the machine so far.
struct ProcessUsage {
  double cpu_s = 0;        ///< user and system time of all its threads, ended ones included [s]
  double rss_mb = 0;       ///< memory in use now [MiB]
  double peak_rss_mb = 0;  ///< the most it ever was [MiB]
};

/// pid 0: this process. All zero when there is no such process.
ProcessUsage processUsage(pid_t pid = 0);

/// Processor time of the calling thread so far [ms].
double threadCpuMs();

}  // namespace ground_scale_vo
