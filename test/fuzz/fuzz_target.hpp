#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
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
void require(bool holds, const char* what);

/// Temporary folder of this process, in memory if possible; removed at exit.
const std::string& scratchFolder();
/// Writes a file in the scratch folder.
void writeScratch(const std::string& name, const std::uint8_t* data, std::size_t size);

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
    skip(bytes);
    return value;
  }
  /// In [0, count). Precondition: count > 0.
  std::size_t below(std::size_t count) { return take<std::uint16_t>() % count; }
  /// Edge-case numbers: extreme, not finite, or any bit pattern.
  double number();
  std::string text(std::size_t max_size);

 private:
  void skip(std::size_t bytes) {
    data_ += bytes;
    size_ -= bytes;
  }
  const std::uint8_t* data_;
  std::size_t size_;
};

}  // namespace ground_scale_vo::fuzz
