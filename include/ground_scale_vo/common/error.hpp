#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace gsv {

/// Input data or an output file cannot be used. what() is the reason; for a file or folder it
/// begins with its name (and the line). Of encoded bytes (decodePixels()) the caller adds the
/// name.
class DataError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An unknown option, an option outside its range, or an argument that cannot be used. what() is
/// one sentence that names the option or argument and the reason.
class OptionError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Throws OptionError, with the option, its value and range, unless `min <= value <= max`; NaN is
/// out of range. For the validate() of an Options struct.
inline void requireInRange(const char* option, double value, double min, double max) {
  if (value >= min && value <= max) return;
  std::ostringstream sentence;
  sentence << option << " is " << value << ", it must lie in [" << min << ", " << max << "]";
  throw OptionError(sentence.str());
}

}  // namespace gsv
