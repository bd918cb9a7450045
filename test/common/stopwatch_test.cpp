#include "ground_scale_vo/common/stopwatch.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

TEST(Stopwatch, ALapStartsTheNextOne) {
  const Stopwatch whole;
  Stopwatch laps;
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    const double lap = laps.lapMs();
    EXPECT_GE(lap, 0);
    sum += lap;
  }
  EXPECT_LE(sum, whole.ms());
}

TEST(ScopedTimer, AddsToTheEarlierTime) {
  double ms = 1e6;
  { const ScopedTimer timer(&ms); }
  EXPECT_GE(ms, 1e6);
}

}  // namespace
}  // namespace ground_scale_vo
