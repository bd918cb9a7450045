#include "ground_scale_vo/ros/source_guard.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

using Guard = SourceGuard<std::string>;
using SourceVerdict = Guard::Verdict;

TEST(SourceGuard, AChangeOfTheSourceIsAccepted) {
  Guard guard;
  for (const std::string source : {"a", "b", "c"}) {
    EXPECT_EQ(guard.check(source), SourceVerdict::kChanged);
    EXPECT_EQ(guard.check(source), SourceVerdict::kSame);
    EXPECT_EQ(guard.current(), source);
  }
  EXPECT_EQ(guard.other(), "b");
  for (int i = 0; i < 10; ++i) {  // messages that all differ are not a second source
    EXPECT_EQ(guard.check(std::to_string(i)), SourceVerdict::kChanged);
    EXPECT_EQ(guard.check("c"), SourceVerdict::kChanged);
  }
  EXPECT_FALSE(guard.alternates());
}

// Also of cameras at 30 Hz and 0.6 Hz.
TEST(SourceGuard, TheFirstOfTwoAlternatingSourcesStaysInUse) {
  for (const int ratio : {2, 50}) {
    Guard guard;
    guard.check("a");
    guard.check("b");
    EXPECT_EQ(guard.check("a"), SourceVerdict::kChanged);
    EXPECT_FALSE(guard.alternates());
    for (int i = 0; i < 1000; ++i) {
      const bool is_second = i % ratio == 0;
      EXPECT_EQ(guard.check(is_second ? "b" : "a"),
                is_second ? SourceVerdict::kOther : SourceVerdict::kSame);
      EXPECT_TRUE(guard.alternates());
    }
  }
}

TEST(SourceGuard, TheEndOfOneSourceEndsTheAlternation) {
  for (const std::string left : {"a", "b"}) {
    Guard guard;
    for (const char* source : {"a", "b", "a", "b"}) guard.check(source);
    EXPECT_TRUE(guard.alternates());
    for (int i = 0; i <= Guard::kMemory; ++i) guard.check(left);
    EXPECT_FALSE(guard.alternates());
    EXPECT_EQ(guard.current(), left);
  }
}

// The other one has been forgotten: changes that are undone later are not an alternation.
TEST(SourceGuard, AnEarlierChangeIsForgotten) {
  Guard guard;
  guard.check("a");
  for (int i = 0; i <= Guard::kMemory; ++i) guard.check("b");
  for (const char* source : {"a", "b"}) EXPECT_EQ(guard.check(source), SourceVerdict::kChanged);
  EXPECT_FALSE(guard.alternates());
}

}  // namespace
}  // namespace ground_scale_vo
