#include "common/source_guard.hpp"

#include <gtest/gtest.h>

#include <string>

namespace gsv {
namespace {

using Guard = SourceGuard<std::string>;

TEST(SourceGuard, TheFirstOfTwoAlternatingSourcesStaysInUseUntilOneEnds) {
  for (const int ratio : {2, 50}) {
    for (const std::string left : {"a", "b"}) {
      Guard guard;
      for (const char* source : {"a", "b", "a"}) guard.accepts(source);
      EXPECT_FALSE(guard.refused());
      for (int i = 0; i < 1000; ++i) {
        const bool is_second = i % ratio == 0;
        EXPECT_EQ(guard.accepts(is_second ? "b" : "a"), !is_second);
        EXPECT_EQ(guard.refused(), "b");
      }
      for (int i = 0; i < Guard::kMemory; ++i) guard.accepts(left);
      EXPECT_FALSE(guard.refused());
      EXPECT_EQ(guard.current(), left);
    }
  }
}

}  // namespace
}  // namespace gsv
