#pragma once

#include <opencv2/core/utility.hpp>

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace ground_scale_vo {

/// Calls body(cv::Range) for parts of [0, count) on OpenCV's threads, and waits for all. There are
/// a few parts per thread: more would balance the load no better, and the body may begin with an
/// expensive construction. Left to itself, OpenCV with libtbb makes over a hundred.
///
/// ThreadSanitizer does not see how libtbb, which OpenCV uses, synchronises these threads with the
/// caller: it is not built with it. So the body and the caller say it.
template <typename Body>
class ParallelLoop final : public cv::ParallelLoopBody {
 public:
  static void run(int count, const Body& body) {
    const ParallelLoop loop(body);
    loop.release();
    cv::parallel_for_({0, count}, loop, kPartsPerThread * cv::getNumThreads());
    loop.acquire();
  }

  void operator()(const cv::Range& range) const override {
    acquire();
    body_(range);
    release();
  }

 private:
  explicit ParallelLoop(const Body& body) : body_(body) {}

#ifdef __SANITIZE_THREAD__
  void acquire() const { __tsan_acquire(const_cast<ParallelLoop*>(this)); }
  void release() const { __tsan_release(const_cast<ParallelLoop*>(this)); }
#else
  void acquire() const {}
  void release() const {}
#endif

  static constexpr double kPartsPerThread = 4;
  const Body& body_;
};

template <typename Body>
void parallelLoop(int count, const Body& body) {
  ParallelLoop<Body>::run(count, body);
}

}  // namespace ground_scale_vo
