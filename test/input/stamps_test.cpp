#include "ground_scale_vo/input/stamps.hpp"

#include "support/test.hpp"

namespace gsv {
namespace {

/// What happens to the messages with these stamps [s], in order: "1" message 1 is processed, "<1"
/// after a jump back, "-1" it is dropped. Nothing: it is held.
std::string events(const std::vector<double>& stamps, double clock_jump_s = 1,
                   bool zero_is_unset = true, double hold_intervals = kInfinity,
                   std::string* reasons = nullptr) {
  std::string text;
  std::size_t held = 0, current = 0;
  StampFilter filter(
      clock_jump_s,
      [&](const std::string& reason) {
        const bool is_held = reason.find("not confirmed") != std::string::npos;
        text += "-" + std::to_string(is_held ? held : current) + " ";
        if (reasons) *reasons += reason + "; ";
      },
      zero_is_unset, hold_intervals);
  for (const double stamp : stamps) {
    ++current;
    filter.add(std::llround(stamp * 1e9), [&text, i = current](bool clock_jumped_back) {
      text += (clock_jumped_back ? "<" : "") + std::to_string(i) + " ";
    });
    held = current;
  }
  return text;
}

TEST(StampFilter, DropsRepeatedAndSlightlyBackwardStamps) {
  std::string reasons;
  EXPECT_EQ(events({0, 10, 10, 10.000999, 9.5, 10.1}, 1, true, kInfinity, &reasons),
            "-1 2 -3 -4 -5 6 ");
  EXPECT_EQ(reasons.substr(0, reasons.find("; ", 20)),
            "the stamp is zero; "
            "the stamp 10.000000000 is not at least 0.001 s later than the last one, 10.000000000");
}

TEST(StampFilter, ASingleStampFarAwayIsRefuted) {
  for (const double jump : {2.0, 30.0, 7200.0, -1.5, -19.0}) {
    EXPECT_EQ(events({20, 20 + jump, 20.1}), "1 -2 3 ") << jump;
  }
  EXPECT_EQ(events({20, 20.1, 20.7, 20.3, 20.4, 20.9, 21}, 1, true, 3), "1 2 -3 4 5 6 7 ");
  // Stamps from which the next one does not continue.
  EXPECT_EQ(events({20, 7210, 19000, 18999, 18999, 12, 11, 20.1}), "1 -2 -3 -4 -5 -6 -7 8 ");
  std::string reasons;
  EXPECT_EQ(events({20, 50, 0, 50.1}, 1, true, kInfinity, &reasons), "1 -2 -3 ");
  EXPECT_EQ(reasons,
            "the stamp 50.000000000 is 30 s after the last one and not confirmed by the next one; "
            "the stamp is zero; ");
}

TEST(StampFilter, AcceptsConfirmedJumpsAndLongIntervalsAndAFileThatBeginsAtZero) {
  EXPECT_EQ(events({0, 0.1, 0, 0.2}, 1, false), "1 2 -3 4 ");
  EXPECT_EQ(events({10, 7210, 7210.1, 7210.2, 10.3, 10.4, 10.5}), "1 2 3 4 <5 6 7 ");
  EXPECT_EQ(events({10, 14, 18, 22, 28, 37.1, 37}), "1 2 3 4 5 -6 7 ");
  // ros::Duration ends at 2^31 s and throws beyond, so the filter must not use it.
  constexpr double kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  EXPECT_EQ(events({1, kMaxSeconds, kMaxSeconds + 0.5, kMaxSeconds + 0.9, 1, 1.1}),
            "1 2 3 4 <5 6 ");
  EXPECT_EQ(events({100, 10, 14, 18}), "1 <2 3 4 ");
  EXPECT_EQ(events({10, 10.1, 10.2, 10.3}, 0), "1 2 3 4 ");
}

}  // namespace
}  // namespace gsv
