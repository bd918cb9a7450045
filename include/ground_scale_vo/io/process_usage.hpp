#pragma once

#include <sys/types.h>

namespace gsv {

/// Resources that a process has used so far.
struct ProcessUsage {
  double cpu_s = 0;        ///< user and system time of all its threads, including ended ones [s]
  double rss_mb = 0;       ///< resident memory now [MiB]
  double peak_rss_mb = 0;  ///< its maximum so far [MiB]
};

/// pid 0: this process. All zero when there is no such process.
ProcessUsage processUsage(pid_t pid = 0);

/// Processor time of the calling thread so far [ms].
double threadCpuMs();

}  // namespace gsv
