#pragma once

#include <opencv2/core/utility.hpp>

namespace ground_scale_vo {

/// Calls body(cv::Range) for parts of [0, count) on OpenCV's threads, and waits for all. There are
/// a few parts per thread: more would balance the load no better, and the body may begin with an
/// expensive construction. Left to itself, OpenCV with libtbb makes over a hundred.
template <typename Body>
void parallelLoop(int count, const Body& body) {
#ifdef __SANITIZE_THREAD__
  // ThreadSanitizer does not see how libtbb, which is built without it, synchronises the threads.
  body(cv::Range(0, count));
#else
  constexpr double kPartsPerThread = 4;
  cv::parallel_for_({0, count}, body, kPartsPerThread * cv::getNumThreads());
#endif
}

}  // namespace ground_scale_vo
