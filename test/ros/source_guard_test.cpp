#include "ground_scale_vo/ros/source_guard.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

using Guard = SourceGuard<std::string>;
using SourceVerdict = Guard::Verdict;

TEST(SourceGuard, AChangeOfTheSourceIsAccepted) {
  Guard guard;
  EXPECT_EQ(guard.check("a"), SourceVerdict::kChanged);
  EXPECT_EQ(guard.check("a"), SourceVerdict::kSame);
  EXPECT_EQ(guard.check("b"), SourceVerdict::kChanged);
  EXPECT_EQ(guard.current(), "b");
  EXPECT_EQ(guard.other(), "a");
  EXPECT_EQ(guard.check("c"), SourceVerdict::kChanged);
  EXPECT_EQ(guard.check("c"), SourceVerdict::kSame);
  EXPECT_FALSE(guard.alternates());
}

TEST(SourceGuard, TheFirstOfTwoAlternatingSourcesStaysInUse) {
  Guard guard;
  guard.check("a");
  guard.check("b");
  EXPECT_EQ(guard.check("a"), SourceVerdict::kChanged);
  EXPECT_FALSE(guard.alternates());
  for (int i = 0; i < 1000; ++i) {
    EXPECT_EQ(guard.check(i % 2 == 0 ? "b" : "c"), SourceVerdict::kOther);
    EXPECT_TRUE(guard.alternates());
    EXPECT_EQ(guard.check("a"), SourceVerdict::kSame);
  }
}

// As two cameras at 30 Hz and 0.6 Hz.
TEST(SourceGuard, AMuchSlowerSecondSourceIsNotForgotten) {
  Guard guard;
  for (const char* source : {"a", "b", "a"}) guard.check(source);
  for (int i = 0; i < 200; ++i) {
    const bool is_second = i % 50 == 0;
    EXPECT_EQ(guard.check(is_second ? "b" : "a"),
              is_second ? SourceVerdict::kOther : SourceVerdict::kSame);
    EXPECT_TRUE(guard.alternates());
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

TEST(SourceGuard, MessagesThatAllDifferAreNotASecondSource) {
  Guard guard;
  guard.check("a");
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(guard.check(std::to_string(i)), SourceVerdict::kChanged);
    EXPECT_EQ(guard.check("a"), SourceVerdict::kChanged);
    EXPECT_FALSE(guard.alternates());
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
