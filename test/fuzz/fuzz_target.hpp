#pragma once

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

/// Each target defines plan() and run(), which fuzz_driver.cpp calls.
namespace gsv::fuzz {

struct Plan {
  std::size_t inputs;               ///< with `scripts/test --long`; by default a third
  std::vector<std::string> corpus;  ///< valid inputs to mutate
};
Plan plan();

/// Processes one input; it must not cause a crash, an exception or a failed require().
void run(const std::string& input);

/// Aborts with a message if the condition does not hold. what: the condition in words.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "check failed: %s\n", what);
  std::abort();
}

/// Decodes an input from front to end; after its end all values are zero.
class Input {
 public:
  explicit Input(std::string_view bytes) : bytes_(bytes) {}

  bool empty() const { return bytes_.empty(); }
  /// The next bytes as a number.
  template <typename Number>
  Number take() {
    Number value{};
    const std::size_t count = std::min(bytes_.size(), sizeof value);
    std::memcpy(&value, bytes_.data(), count);
    bytes_.remove_prefix(count);
    return value;
  }
  /// In [0, count). Precondition: count > 0.
  std::size_t below(std::size_t count) { return take<std::uint16_t>() % count; }
  template <typename Range>
  auto& oneOf(Range& values) {
    return values[below(std::size(values))];
  }
  /// Edge-case numbers: extreme, not finite, or any bit pattern.
  double number() {
    constexpr double kNumbers[] = {0,       -0.0, 1,   -1,  NAN, INFINITY,     -INFINITY, DBL_MAX,
                                   DBL_MIN, 1e-9, 0.5, 1e3, 1e9, 4294967296.0, 1e19,      1e30,
                                   -1e30,   1e40, 0.1, 10,  1e5, 1e150,        -1e300,    1e-30};
    return below(4) > 0 ? oneOf(kNumbers) : take<double>();
  }
  std::string text(std::size_t max_size) {
    std::string text;
    for (std::size_t length = below(max_size + 1); length > 0; --length) text += take<char>();
    return text;
  }

 private:
  std::string_view bytes_;
};

}  // namespace gsv::fuzz
