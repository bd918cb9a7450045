#include "ground_scale_vo/input/stamps.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace ground_scale_vo {
namespace {

std::int64_t ns(double seconds) { return std::llround(seconds * 1e9); }

/// The verdicts on these stamps [s], such as "accept hold ahead ".
std::string verdicts(StampGuard guard, const std::vector<double>& stamps) {
  const char* const kNames[] = {"accept ", "drop ", "hold ", "ahead ", "back "};
  std::string text;
  for (const double stamp : stamps) text += kNames[static_cast<int>(guard.check(ns(stamp)))];
  return text;
}

TEST(StampGuard, DropsRepeatedAndSlightlyBackwardStamps) {
  EXPECT_EQ(verdicts(StampGuard(1), {0, 10, 10, 10.000999, 9.5, 10.1}),
            "drop accept drop drop drop accept ");
  StampGuard guard(1.0);
  guard.check(ns(10));
  guard.check(ns(10));
  EXPECT_EQ(guard.reason(),
            "the stamp 10.000000000 is not at least 0.001 s later than the last one, 10.000000000");
}

TEST(StampGuard, AFileMayBeginAtZero) {
  EXPECT_EQ(verdicts(StampGuard(1, false), {0, 0.1, 0, 0.2}), "accept accept drop accept ");
}

TEST(StampGuard, ASingleStampFarAwayIsRefuted) {
  for (const double jump : {2.0, 30.0, 7200.0, -1.5, -19.0}) {
    EXPECT_EQ(verdicts(StampGuard(1), {20, 20 + jump, 20.1}), "accept hold accept ") << jump;
  }
  EXPECT_EQ(verdicts(StampGuard(1, true, 3), {20, 20.1, 20.7, 20.3, 20.4, 20.9, 21}),
            "accept accept hold accept accept hold ahead ");
  // Stamps from which the next one does not continue.
  EXPECT_EQ(verdicts(StampGuard(1), {20, 7210, 19000, 18999, 18999, 12, 11, 20.1}),
            "accept hold hold hold hold hold hold accept ");
  EXPECT_EQ(verdicts(StampGuard(1), {20, 7210, 0, 7210.1}), "accept hold drop hold ");
}

TEST(StampGuard, AJumpIsAcceptedWhenTheNextStampContinuesFromIt) {
  EXPECT_EQ(verdicts(StampGuard(1), {10, 7210, 7210.1, 7210.2, 10.3, 10.4, 10.5}),
            "accept hold ahead accept hold back accept ");
}

TEST(StampGuard, AcceptsImagesAtLongIntervals) {
  EXPECT_EQ(verdicts(StampGuard(1), {10, 14, 18, 22, 28, 37.1, 37}),
            "accept hold ahead accept accept hold accept ");
  // ros::Duration ends at 2^31 s and throws beyond, so the guard must not use it.
  constexpr double kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  EXPECT_EQ(verdicts(StampGuard(1), {1, kMaxSeconds, kMaxSeconds + 0.5, kMaxSeconds + 0.9, 1, 1.1}),
            "accept hold ahead accept hold back ");
  EXPECT_EQ(verdicts(StampGuard(1), {100, 10, 14, 18}), "accept hold back accept ");
  EXPECT_EQ(verdicts(StampGuard(0), {10, 10.1, 10.2, 10.3}), "accept hold ahead accept ");
}

TEST(StampFilter, PassesOnAHeldMessageWithTheOneThatConfirmsIt) {
  std::string dropped;
  StampFilter<int> filter(1.0, [&](const std::string& reason) { dropped += reason + "; "; });
  const struct {
    double stamp;
    int message;
    std::vector<std::pair<int, bool>> accepted;  ///< message, clock_jumped_back
  } kMessages[] = {{10.0, 1, {{1, false}}},
                   {40.0, 2, {}},
                   {0.0, 3, {}},
                   {40.0, 4, {}},
                   {40.1, 5, {{4, false}, {5, false}}},
                   {10.0, 6, {}},
                   {10.1, 7, {{6, true}, {7, false}}}};
  for (const auto& one : kMessages) {
    std::vector<std::pair<int, bool>> accepted;
    for (const auto& passed : filter.filter(ns(one.stamp), one.message)) {
      accepted.emplace_back(passed.message, passed.clock_jumped_back);
    }
    EXPECT_EQ(accepted, one.accepted) << one.message;
  }
  EXPECT_EQ(dropped,
            "the stamp 40.000000000 is 30 s after the last one and not confirmed by the next one; "
            "the stamp is zero; ");
}

}  // namespace
}  // namespace ground_scale_vo
