#pragma once

#include <cfloat>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <string>
#include <type_traits>
#include <vector>

/// Called by libFuzzer, or by fuzz_driver.cpp in the normal build. One input; it must not cause a
/// crash, an exception or a failed require().
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace ground_scale_vo::fuzz {

/// How the driver runs a target.
struct Plan {
  int iterations = 0;               ///< with `scripts/test --long`; by default a third
  std::vector<std::string> corpus;  ///< valid inputs to mutate
};
Plan plan();  ///< defined by each target

/// Aborts with a message if the condition does not hold. what: the condition in words.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "check failed: %s\n", what);
  std::abort();
}

/// Decodes an input from front to end; after its end all values are zero.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  bool empty() const { return size_ == 0; }
  /// The next bytes as a number.
  template <typename Number>
  Number take() {
    static_assert(std::is_arithmetic_v<Number>);
    Number value{};
    const std::size_t bytes = size_ < sizeof value ? size_ : sizeof value;
    if (bytes > 0) std::memcpy(&value, data_, bytes);
    data_ += bytes;
    size_ -= bytes;
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
  const std::uint8_t* data_;
  std::size_t size_;
};

}  // namespace ground_scale_vo::fuzz
