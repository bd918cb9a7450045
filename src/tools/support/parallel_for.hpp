#pragma once

#include <atomic>
#include <cstddef>
#include <future>
#include <vector>

namespace gsv {

/// Calls work(i) for i = 0 ... count - 1 on `threads` threads. After an exception of work no
/// further call begins, and one of the exceptions is rethrown.
template <typename Work>
void parallelFor(std::size_t count, int threads, const Work& work) {
  std::atomic<std::size_t> next{0};
  std::vector<std::future<void>> workers;
  for (int k = 0; k < threads; ++k) {
    workers.push_back(std::async(std::launch::async, [&] {
      try {
        for (std::size_t i = next++; i < count; i = next++) work(i);
      } catch (...) {
        next = count;
        throw;
      }
    }));
  }
  for (std::future<void>& worker : workers) worker.get();
}

}  // namespace gsv
