#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

/// What libFuzzer calls, and fuzz_driver.cpp in the ordinary build: one input, which must end
/// without a crash, an exception or a failed require().
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace ground_scale_vo::fuzz {

/// What the driver knows of a target.
struct Plan {
  int iterations = 0;               ///< of a plain test run
  std::vector<std::string> corpus;  ///< valid inputs, which are mutated
};
Plan plan();  ///< each target has its own

/// Ends the process after a sentence when the condition does not hold.
void require(bool holds, const char* what);

/// A folder of this process, in memory where there is such a place; removed at its end.
const std::string& scratchFolder();
void writeScratch(const std::string& name, const std::uint8_t* data, std::size_t size);

/// Bytes that are taken from the front; zeros when there are no more.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  bool empty() const { return size_ == 0; }
  template <typename Number>
  Number take() {
    static_assert(std::is_arithmetic_v<Number>);
    Number value{};
    const std::size_t bytes = size_ < sizeof value ? size_ : sizeof value;
    if (bytes > 0) std::memcpy(&value, data_, bytes);
    skip(bytes);
    return value;
  }
  /// In [0, count). Precondition: count > 0.
  std::size_t below(std::size_t count) { return take<std::uint16_t>() % count; }
  /// Numbers that break things: extreme, not finite, or any pattern of bits.
  double number();
  std::string text(std::size_t longest);

 private:
  void skip(std::size_t bytes) {
    data_ += bytes;
    size_ -= bytes;
  }
  const std::uint8_t* data_;
  std::size_t size_;
};

}  // namespace ground_scale_vo::fuzz
